"""The names of the package itself: what a notebook needs, without slowing the import."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.records.record import Record


def record(name: str = 'a', gain: float = 1e-4) -> Record:
    time = np.arange(1000) * 1e-3
    voltage = np.sin(2 * np.pi * 5.0 * time)
    noise = 1e-8 * np.random.default_rng(0).standard_normal(time.size)
    return ph.Record(name, 1e-3, voltage, gain * voltage + noise)


def test_every_name_is_there_and_is_listed() -> None:
    assert set(ph.__all__) < set(dir(ph))
    for name in ph.__all__:
        assert getattr(ph, name).__doc__, name
    with pytest.raises(AttributeError, match='no attribute'):
        ph.nothing  # noqa: B018


def test_the_import_stays_fast_and_knows_no_library() -> None:
    code = (
        'import sys, piezo_hysteresis; '
        'print([m for m in ("numpy", "scipy", "numba", "rclpy") if m in sys.modules])'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'


@pytest.fixture(scope='module')
def found() -> Identification:
    return ph.identify(record(), 'linear_mode')


def test_one_record_and_the_name_of_a_model_are_enough(
    found: Identification, tmp_path: Path
) -> None:
    assert found.model.name == 'linear_mode-mode'  # the record shows no mode
    moved = ph.simulate(found, record())
    assert np.std(moved - record().displacement) < 1e-6
    found.model_file().save(tmp_path / 'model.yaml')
    saved = ph.ModelFile.load(tmp_path / 'model.yaml')
    np.testing.assert_allclose(ph.simulate(saved, record()), moved, atol=1e-9)
    again = ph.identify([record()], tmp_path / 'model.yaml')
    assert again.values['A1'] == pytest.approx(found.values['A1'], rel=1e-3)


def test_one_path_need_not_be_a_list(tmp_path: Path) -> None:
    file = tmp_path / 'r.csv'
    rows = '\n'.join(f'{k / 1000},{k % 7},{k % 7}' for k in range(200))
    file.write_text(f'time_s,voltage_V,displacement_um\n{rows}\n')
    for given in (file, str(file), [file]):
        (loaded,) = ph.load(given)
        assert len(loaded) == 200


def test_blocks_stand_behind_the_name_as_on_the_command_line() -> None:
    from piezo_hysteresis.models.choice import chain_of

    assert 'mains_hum' in {b.name for b in chain_of('classical+mains_hum')[0].blocks}
    assert chain_of(ph.named('classical'))[0].name == 'classical'


WRONGLY: Any = ph  # what mypy would refuse


@pytest.mark.parametrize(
    ('call', 'says'),
    [
        (lambda: WRONGLY.identify([record()], 'clasical'), 'did you mean classical'),
        (
            lambda: WRONGLY.identify('sweep.csv', 'classical'),
            'not of type str; `piezo_hysteresis.load',
        ),
        (lambda: WRONGLY.identify([1.0], 'classical'), 'not of type float'),
        (lambda: WRONGLY.identify(None, 'classical'), 'not of type NoneType'),
        (lambda: WRONGLY.identify(record(), 3), 'a model is its name'),
        (lambda: WRONGLY.discover(record(), 'clasical'), 'did you mean classical'),
        (lambda: WRONGLY.discover(record(), None), 'not of type NoneType'),
        (lambda: WRONGLY.discover({}, 'classical'), 'no record'),
        (lambda: WRONGLY.simulate('classical', record()), 'simulate takes what identify returned'),
    ],
)
def test_what_is_not_meant_is_said_in_a_sentence(call: Callable[..., Any], says: str) -> None:
    with pytest.raises(ph.PiezoError, match=says):
        call()


def test_a_result_is_shown_in_a_few_lines(found: Identification) -> None:
    lines = repr(found).splitlines()
    assert lines[0] == 'Identification of linear_mode-mode by output_error, converged'
    assert any(line.startswith('  A1 = ') and line.endswith(' m/V') for line in lines)
    assert len(lines) == 2 + len(found.model.parameters)
    assert all(len(line) < 90 for line in lines)


@pytest.mark.slow
def test_a_discovery_by_name_is_shown_in_a_few_lines() -> None:
    missing = ph.discover([record('a'), record('b', 1.01e-4)], 'linear_mode', workers=1)
    assert missing.verdict.baseline == 'linear_mode'
    lines = repr(missing).splitlines()
    assert lines[0] == f'Discovery: {missing.verdict.summary}'
    assert len(lines) == 1 + len(missing.verdict.effects)
