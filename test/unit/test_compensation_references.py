"""A reference of a file is read as records are, also without a voltage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import CompensationError, PiezoError
from piezo_hysteresis.interface.compensate_runs import reference_of
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import ReadOptions

STEP = 2e-3
WISH = 3.0 + 2.0 * np.sin(2 * np.pi * 4.0 * STEP * np.arange(500))  # um
MODEL = ModelFile(named('classical'), named('classical').defaults())


def written(path: Path, head: str, *columns: Any, separator: str = ',') -> Path:
    table = np.column_stack(columns)
    np.savetxt(path, table, '%.9g', separator, header=head, comments='')
    return path


def wave(path: Path, **stated: Any) -> Any:
    return reference_of(path, None, MODEL, ReadOptions(**stated))[0]


def test_time_and_reference_are_enough(tmp_path: Path) -> None:
    found = wave(written(tmp_path / 'a.csv', 'time_s,reference_um', STEP * np.arange(500), WISH))
    assert found.dt == pytest.approx(STEP)
    np.testing.assert_allclose(found.values, 1e-6 * WISH, rtol=1e-8)


def test_what_the_file_does_not_state_is_stated(tmp_path: Path) -> None:
    path = written(tmp_path / 'a.csv', 'displacement', WISH)
    found = wave(path, interval=STEP, unit='um', sign=-1.0)
    assert found.dt == pytest.approx(STEP)
    np.testing.assert_allclose(found.values, -1e-6 * WISH, rtol=1e-8)


def test_of_a_record_the_reference_counts(tmp_path: Path) -> None:
    columns = STEP * np.arange(500), 20.0 * WISH, WISH + 0.1, WISH
    head = 'time_ms;voltage_V;displacement_um;reference_um'
    path = written(tmp_path / 'a.csv', head, 1e3 * columns[0], *columns[1:], separator=';')
    np.testing.assert_allclose(wave(path).values, 1e-6 * WISH, rtol=1e-8)


def test_an_uneven_reference_is_refused(tmp_path: Path) -> None:
    times = STEP * np.arange(500)
    times[300:] += 7.4 * STEP
    with pytest.raises(PiezoError, match='missing'):
        wave(written(tmp_path / 'a.csv', 'time_s,reference_um', times, WISH))


def test_options_of_a_file_need_a_file() -> None:
    with pytest.raises(CompensationError, match='needs a reference that is one'):
        reference_of('sine:frequency=3,amplitude=1e-6', None, MODEL, ReadOptions(unit='um'))


@pytest.mark.component
def test_the_verb_takes_the_options(tmp_path: Path) -> None:
    MODEL.save(tmp_path / 'model.yaml')
    path = written(tmp_path / 'wish.csv', 'displacement', 10.0 * WISH)
    words = ['--model', str(tmp_path / 'model.yaml'), '--plant', str(tmp_path / 'model.yaml')]
    asked = ['compensate', *words, '--reference', str(path), '--out', str(tmp_path / 'out')]
    assert main(asked) == 2
    assert main([*asked, '--interval', '0.002', '--unit', 'um']) == 0
    assert (tmp_path / 'out' / 'report.html').exists()
