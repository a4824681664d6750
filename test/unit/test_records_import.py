"""Foreign columns, two rates and jitter become records by `import`; its messages."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.cli.verbosity import ProgressLines, remaining_time_text
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, read_bag, read_csv
from piezo_hysteresis.records.sampling import resampled


def scope(
    path: Path,
    names: str = 'Time (s),CH1 (V),CH2',
    n: int = 2000,
    dt: float = 1e-3,
    jitter: float = 0.0,
) -> Any:
    """Write what an oscilloscope does; return time and displacement [um]."""
    time = np.arange(n) * dt
    stamped = time + jitter * np.random.default_rng(1).uniform(-1, 1, n)
    wave = np.sin(2 * np.pi * 5 * stamped)
    np.savetxt(path, np.c_[stamped, 2 * wave, 30 * wave], delimiter=',', header=names, comments='')
    return time, 30 * np.sin(2 * np.pi * 5 * time)


@pytest.mark.parametrize(
    'words',
    [
        ('--time', 'Time (s)', '--voltage', 'CH1 (V)', '--displacement', 'CH2:um'),
        ('--time', '1', '--voltage', '2:V', '--displacement', '3:um'),
    ],
    ids=['by name', 'by number'],
)
def test_columns_are_named_on_the_command_line(tmp_path: Path, words: tuple[str, ...]) -> None:
    _, displacement = scope(tmp_path / 'a.csv')
    assert main(['import', str(tmp_path / 'a.csv'), '--out', str(tmp_path / 'bag'), *words]) == 0
    (record,) = read_bag(tmp_path / 'bag')
    assert record.rate == pytest.approx(1000.0)
    assert 1e6 * record.displacement == pytest.approx(displacement, abs=1e-9)
    assert np.ptp(record.voltage) == pytest.approx(4.0, rel=1e-3)


def test_a_force_is_named_likewise(tmp_path: Path) -> None:
    scope(tmp_path / 'a.csv')
    words = ['--time', '1', '--force', 'CH1 (V):mN', '--displacement', 'CH2:um']
    assert main(['import', str(tmp_path / 'a.csv'), '--out', str(tmp_path / 'bag'), *words]) == 0
    (record,) = read_bag(tmp_path / 'bag')
    assert record.info.input_unit == 'N'
    assert np.ptp(record.voltage) == pytest.approx(4e-3, rel=1e-3)


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        (('--time', '1', '--voltage', 'CH9', '--displacement', '3'), "no column 'CH9', but Time"),
        (('--time', '1', '--voltage', '2:um', '--displacement', '3'), "'um' is no unit of a volt"),
        (('--voltage', '2', '--force', '2', '--displacement', '3'), 'a voltage or a force'),
        ((), '--time COLUMN:UNIT'),
    ],
)
def test_an_unknown_column_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[Any, ...], reason: str
) -> None:
    scope(tmp_path / 'a.csv', names='t,CH1,CH2')
    if 'Time' in reason:
        scope(tmp_path / 'a.csv')
    assert main(['import', str(tmp_path / 'a.csv'), '--out', str(tmp_path / 'b'), *words]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / 'b').exists()


def test_two_rates_become_one(tmp_path: Path) -> None:
    head = 'time_s,voltage_V,displacement_um'
    scope(tmp_path / 'slow.csv', head)
    scope(tmp_path / 'fast.csv', head, n=5000, dt=4e-4)
    files = [str(tmp_path / name) for name in ('slow.csv', 'fast.csv')]
    assert main(['import', *files, '--out', str(tmp_path / 'bag'), '--resample', '1000']) == 0
    slow, fast = read_bag(tmp_path / 'bag')
    assert slow.rate == fast.rate == pytest.approx(1000.0)
    assert len(fast) == len(slow)
    inside = slice(100, -100)
    assert fast.displacement[inside] == pytest.approx(slow.displacement[inside], abs=3e-8)


def test_what_the_new_rate_cannot_hold_is_filtered_off() -> None:
    time = np.arange(20000) * 1e-4
    low, high = np.sin(2 * np.pi * 7 * time), np.sin(2 * np.pi * 1900 * time)
    record = Record('r', 1e-4, low + high, 1e-6 * (low + high))
    found = resampled(record, 1000.0)
    wanted = np.sin(2 * np.pi * 7 * found.time)
    inside = slice(100, -100)
    assert np.std(found.voltage[inside] - wanted[inside]) < 2e-3
    assert found.displacement[inside] == pytest.approx(1e-6 * found.voltage[inside], abs=1e-12)
    same = resampled(record, record.rate)
    np.testing.assert_array_equal(same.voltage, record.voltage)
    with pytest.raises(RecordError, match='above 0'):
        resampled(record, 0.0)
    with pytest.raises(RecordError, match='a thousand'):
        resampled(record, 1.0)
    odd = resampled(record, 1000.0 * np.pi / 3)
    assert np.std((odd.voltage - np.sin(2 * np.pi * 7 * odd.time))[inside]) < 2e-3


def test_jitter_is_refused_with_the_remedy_and_interpolated_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head = 'time_s,voltage_V,displacement_um'
    _, displacement = scope(tmp_path / 'a.csv', head, jitter=1.5e-4)
    file, bag = str(tmp_path / 'a.csv'), str(tmp_path / 'bag')
    with pytest.raises(RecordError, match='--resample'):
        read_csv(file)
    assert main(['import', file, '--out', bag, '--resample', '1000']) == 0
    assert 'interpolated' in capsys.readouterr().err
    (record,) = read_bag(bag)
    inside = slice(50, 1900)
    assert record.rate == pytest.approx(1000.0)
    assert 1e6 * record.displacement[inside] == pytest.approx(displacement[inside], abs=0.3)


def test_salvage_reports_its_changes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head = 'time_s,voltage_V,displacement_um'
    scope(tmp_path / 'a.csv', head)
    lines = (tmp_path / 'a.csv').read_text().splitlines()
    lines[300] = lines[300].rsplit(',', 1)[0] + ',nan'
    (tmp_path / 'a.csv').write_text('\n'.join([*lines[:1000], *lines[1060:]]) + '\n')
    words = ['import', str(tmp_path / 'a.csv'), '--out', str(tmp_path / 'bag'), '--salvage']
    assert main(words) == 0
    printed = capsys.readouterr().err
    assert 'salvaged: ' in printed
    assert 'left out' in printed
    assert 'samples are missing in 2 gaps' in printed
    assert 'cut into records there' in printed
    assert main([*words[:3], str(tmp_path / 'again'), '--salvage', '-q']) == 0
    assert capsys.readouterr().err == ''


# --- how much is said ---------------------------------------------------------------------------


def test_in_a_pipe_progress_is_a_line_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    tell = ProgressLines('discover', 30.0, now=lambda: now[0])
    for second in range(100):
        now[0] = float(second)
        tell(second / 200, 'fits')
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[1] == 'discover: 30 %, fits, 1 min 00 s, about 2 min 20 s left'
    assert remaining_time_text(0.0, 9.0) == remaining_time_text(1.0, 9.0) == ''
    assert 'about 9 min' in remaining_time_text(0.1, 60.0)
    assert remaining_time_text(0.1, 60.0, 300.0) == ', at most 4 min 00 s left'
    assert remaining_time_text(0.1, 310.0, 300.0) == ''


def test_a_verbose_error_states_its_origin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['info', str(tmp_path / 'no.csv'), '-v']) == 2
    assert 'Traceback' in capsys.readouterr().err
    assert main(['info', str(tmp_path / 'no.csv')]) == 2
    assert 'Traceback' not in capsys.readouterr().err
    assert verbosity.level() == verbosity.Verbosity.USUAL


def completed(script: str, line: str) -> list[str]:
    """Return what bash offers behind a line."""
    words = line.split(' ')
    text = f'{script}\nCOMP_WORDS=({line} "")\nCOMP_CWORD={len(words)}\n'
    if not line.endswith(' '):
        text = f'{script}\nCOMP_WORDS=({line})\nCOMP_CWORD={len(words) - 1}\n'
    text += '_shtab_piezo\necho "${COMPREPLY[@]}"\n'
    done = subprocess.run(['bash', '-c', text], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_bash_completes_verbs_options_and_choices(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['completion', 'bash']) == 0
    script = capsys.readouterr().out
    assert completed(script, 'piezo comp') == ['compensate', 'completion']
    assert {'--resample', '--salvage'} <= set(completed(script, 'piezo import --'))
    assert completed(script, 'piezo export --unit u') == ['um']
