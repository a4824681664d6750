"""The verbs import, export, info, record and play."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import piezo_hysteresis as ph
from piezo_hysteresis.cli.main import main, parser_of
from piezo_hysteresis.cli.shared_options import statements_of
from piezo_hysteresis.records import Record, RecordInfo, read_bag, read_csv, write_bag
from piezo_hysteresis.reporting.folder import MARKER

ROWS = [f'{k / 1000},{k % 11},{0.25 * (k % 7)}' for k in range(60)]
CSV = '\n'.join(['time_s,voltage_V,displacement_um', *ROWS]) + '\n'


def test_csv_to_bag_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ('one', 'two'):
        (tmp_path / f'{name}.csv').write_text(CSV)
    bag, out = tmp_path / 'bag', tmp_path / 'out'
    files = [str(tmp_path / 'one.csv'), str(tmp_path / 'two.csv')]
    assert main(['import', *files, '--out', str(bag), '--actuator', 'bimorph']) == 0
    assert '2 records' in capsys.readouterr().out
    assert [(r.name, r.info.actuator) for r in read_bag(bag)] == [
        ('one', 'bimorph'), ('two', 'bimorph')]  # fmt: skip
    assert main(['export', str(bag), '--out', str(out)]) == 0
    assert '2 files' in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {
        'one.csv', 'two.csv', 'records.yaml', MARKER,
    }  # fmt: skip
    for name in ('one', 'two'):
        first, again = read_csv(tmp_path / f'{name}.csv'), read_csv(out / f'{name}.csv')
        np.testing.assert_array_equal(again.voltage, first.voltage)
        np.testing.assert_allclose(again.displacement, first.displacement, rtol=1e-15)
        assert again.info.actuator == 'bimorph'
        assert again.dt == first.dt


def test_export_makes_file_names_of_any_record_names(tmp_path: Path) -> None:
    info = RecordInfo('x', 'sine', 5.0, 10.0, 0.01, 'V')
    signal = np.linspace(0, 1, 50)
    names = ['sine 5 Hz', 'sine/5/Hz', '../up', '...', 'Sine_5_Hz']
    records = [Record(name, 1e-3, signal, 1e-6 * signal, info=info) for name in names]
    write_bag(tmp_path / 'bag', records)
    out = tmp_path / 'out'
    assert main(['export', str(tmp_path / 'bag'), '--out', str(out), '--unit', 'm']) == 0
    files = yaml.safe_load((out / 'records.yaml').read_text())
    assert [entry['record'] for entry in files.values()] == names
    assert all((out / file).is_file() for file in files)
    assert {path.name for path in tmp_path.iterdir()} == {'bag', 'out'}
    again = read_csv(out / next(iter(files)))
    assert (again.name, again.info) == ('sine 5 Hz', info)
    np.testing.assert_array_equal(again.displacement, 1e-6 * signal)


def test_info_lists_records_topics_and_damage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signal = np.arange(4000.0)
    info = RecordInfo('bimorph', 'sine', 23.0)
    write_bag(tmp_path / 'bag', [Record('a', 1e-3, signal, 1e-9 * signal, info=info)])
    assert main(['info', str(tmp_path / 'bag')]) == 0
    text = capsys.readouterr().out
    for part in ('/piezo/actuator/state', 'piezo_interfaces/msg/ActuatorState', '4000', '1000',
                 'sine 23 Hz', 'bimorph', 'storage mcap: bag_0.mcap', '3.999'):  # fmt: skip
        assert part in text
    file = tmp_path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[:200_000])
    assert main(['info', str(tmp_path / 'bag')]) == 2
    printed = capsys.readouterr()
    assert 'damage: ' in printed.out
    assert 'ends early' in printed.out
    assert 'need --salvage' in printed.err


def test_damage_is_refused_or_salvaged(tmp_path: Any, capsys: Any) -> None:
    lines = CSV.split('\n')
    del lines[21]
    file = tmp_path / 'a.csv'
    file.write_text('\n'.join(lines))
    words = ['import', str(file), '--out', str(tmp_path / 'bag')]
    assert main(words) == 2
    printed = capsys.readouterr().err
    assert printed.startswith('error: ')
    assert printed.count('\n') == 1
    assert '1 sample is missing in 1 gap' in printed
    assert not (tmp_path / 'bag').exists()
    assert main([*words, '--salvage']) == 0
    printed = capsys.readouterr()
    assert 'salvaged: ' in printed.err
    assert [(r.name, len(r)) for r in read_bag(tmp_path / 'bag')] == [('a.1', 20), ('a.2', 39)]


def test_a_bag_without_records_still_shows_its_topics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from piezo_hysteresis.records.recorder import Recorder

    with Recorder(tmp_path / 'bag') as recorder:
        topic = recorder.add_topic('/chatter', 'std_msgs/msg/String')
        recorder.write(topic, b'\0\1\0\0\2\0\0\0x\0', 5)
    assert main(['info', str(tmp_path / 'bag')]) == 2
    printed = capsys.readouterr()
    assert '/chatter' in printed.out
    assert 'record the topic actuator/state' in printed.err


def test_existing_output_is_not_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'a.csv').write_text(CSV)
    (tmp_path / 'out').mkdir()
    words = [str(tmp_path / 'a.csv'), '--out', str(tmp_path / 'out')]
    assert main(['import', *words]) == 2
    assert 'exists already' in capsys.readouterr().err
    assert not list((tmp_path / 'out').iterdir())
    (tmp_path / 'out' / 'a.csv').write_text('mine')
    assert main(['export', *words]) == 2
    assert 'files that are no results' in capsys.readouterr().err
    assert [path.read_text() for path in (tmp_path / 'out').iterdir()] == ['mine']
    for more in (['--overwrite'], []):  # then it is a folder of `export`
        assert main(['export', *words, *more]) == 0
        assert 'voltage' in (tmp_path / 'out' / 'a.csv').read_text()


WITHOUT_ROS = (
    'import sys; sys.modules["rclpy"] = None; from piezo_hysteresis.cli.main import main; '
    'sys.exit(main(sys.argv[1:]))'
)


@pytest.mark.component
@pytest.mark.parametrize(
    'words',
    [
        ['record', '--out', 'x'],
        ['play', 'x'],
        ['dashboard'],
        ['param', 'list'],
        ['demo', '--out', 'x'],
    ],
)
def test_without_ros_verbs_that_need_it_state_the_remedy(tmp_path: Path, words: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS, *words],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert 'run `source setup.bash`' in done.stderr
    assert len(done.stderr.splitlines()) == 1


STATED = '--interval 0.002 --sign -1 --unit nm --decimal , --time-from header'


@pytest.mark.parametrize(
    'words',
    [
        'import a.csv --out o',
        'info a.csv',
        'identify a.csv --out o',
        'discover a.csv --baseline classical --out o',
        'validate a.csv --model m.yaml --out o',
        'linear a.csv --out o',
    ],
)
def test_every_verb_takes_what_files_do_not_state(words: str) -> None:
    verb, *rest = words.split()
    arguments = parser_of(verb).parse_args([*rest, *STATED.split()])
    stated = statements_of(arguments)
    assert stated == ph.ReadOptions({}, None, 0.002, -1.0, 'nm', ',', 'header')


def test_a_fit_reads_files_as_stated(tmp_path: Path) -> None:
    u = 50.0 * (1.0 - np.cos(2.0 * np.pi * 0.004 * np.arange(1000)))
    noise = 0.01 * np.random.default_rng(0).standard_normal(u.size)
    y = 9.0 - 0.05 * u + noise
    rows = [f'{a:.4f};{b:.4f}'.replace('.', ',') for a, b in zip(u, y, strict=True)]
    file = tmp_path / 'distance.csv'
    file.write_text('\n'.join(['voltage_V;displacement', *rows]))
    stated = ph.ReadOptions(interval=0.002, sign=-1.0, unit='um')
    found = ph.identify(file, 'linear_mode', reading=stated)
    (record,) = found.data
    assert record.dt == 0.002
    assert np.polyfit(record.voltage, record.displacement, 1)[0] == pytest.approx(5e-8, rel=1e-3)
