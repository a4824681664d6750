"""The discrepancy of a model: from residuals, in model.yaml, and for new records."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.identification.model_discrepancy import (
    RecordResidual,
    condition_of,
    discrepancy_of,
)
from piezo_hysteresis.identification.validate import compared, comparison_text
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, write_csv
from piezo_hysteresis.records.record import RecordInfo

DT = 1e-3
TIME = np.arange(4000) * DT


def residual(
    error: Any,
    frequency: Any = 5.0,
    amplitude: float = 1.0,
    stroke: Any = 1e-4,
    noise: Any = float('nan'),
) -> RecordResidual:
    voltage = amplitude * np.sin(2 * np.pi * frequency * DT * np.arange(error.size))
    return RecordResidual('r', error, DT, frequency, amplitude, stroke, noise, 0.0, voltage)


def waves(frequency: float = 5.0, **orders: Any) -> Any:
    return sum(
        size * np.sqrt(2) * np.cos(2 * np.pi * int(order[1:]) * frequency * TIME + 0.3)
        for order, size in orders.items()
    )


# --- from residuals -----------------------------------------------------------------------------


def test_harmonics_are_reported_in_rms_without_small_ones() -> None:
    found = condition_of(residual(2e-7 + waves(h1=3e-7, h3=6e-7, h5=1e-9), noise=1e-8))
    assert found.harmonics == pytest.approx({0: 2e-7, 1: 3e-7, 3: 6e-7}, rel=1e-6)
    assert found.rms == pytest.approx(7e-7, rel=1e-4)
    assert found.noise == 1e-8
    assert not found.bands


def test_a_drive_that_is_not_periodic_has_octaves() -> None:
    error = 1e-7 + np.sqrt(2) * 3e-7 * np.sin(2 * np.pi * 10 * TIME)
    found = condition_of(residual(error, frequency=0.0))
    assert found.frequency == 0.0
    assert found.noise is None
    assert found.bands == pytest.approx({0.0: 1e-7, 8.0: 3e-7}, rel=1e-6)
    assert sum(size**2 for size in found.bands.values()) == pytest.approx(found.rms**2)


def test_less_than_a_period_is_not_periodic() -> None:
    assert condition_of(residual(waves(h1=1e-7), frequency=0.1)).frequency == 0.0


def test_repeats_are_one_condition_and_rest_is_none() -> None:
    known = discrepancy_of(
        [
            residual(waves(h1=3e-7)), residual(waves(h1=4e-7, h3=1e-7)),
            residual(waves(20.0, h1=1e-7), frequency=20.0),
            residual(waves(h1=1e-7), stroke=0.0), residual(np.full(4000, np.inf)),
        ],
        held_out=True,
    )  # fmt: skip
    assert known is not None
    assert [c.frequency for c in known.conditions] == [5.0, 5.0, 20.0]
    assert [(c.frequency, c.amplitude) for c in known.kinds] == [(5.0, 1.0), (20.0, 1.0)]
    both = known.kinds[0]
    assert both.rms == pytest.approx(np.sqrt((9 + 17) / 2) * 1e-7)
    # their phases are known: the mean of (3, 4) and of (0, 1)
    assert both.harmonics == pytest.approx({1: 3.5e-7, 3: 0.5e-7}, rel=1e-6)
    assert discrepancy_of([residual(np.full(9, np.nan))], held_out=False) is None


def test_only_an_error_above_the_known_one_is_a_new_deviation() -> None:
    known = discrepancy_of([residual(waves(h1=1e-7))], held_out=False)
    assert known is not None
    usual, larger = compared([residual(waves(h3=1.2e-7)), residual(waves(h1=2e-7))], known)
    assert not usual.new_deviation
    assert usual.ratio == pytest.approx(1.2)
    assert larger.new_deviation
    assert larger.ratio == pytest.approx(2.0)
    assert comparison_text([usual], known) == (
        'the error is near the known discrepancy of the model; the largest on r: 1.2 times the '
        '0.1 µm expected from the fitted records, which is not new below 1.5 times'
    )
    smaller = compared([residual(waves(h1=9e-8))], known)
    assert 'is within the known discrepancy of the model' in comparison_text(smaller, known)
    assert 'on 1 of 2 records; most on r: 2 times the 0.1 µm' in comparison_text(
        [usual, larger], known
    )
    (diverged,) = compared([residual(np.full(9, np.nan))], known)
    assert diverged.new_deviation
    assert 'has no discrepancy' in comparison_text([], None)


# --- in the verbs -------------------------------------------------------------------------------


def record(
    frequency: Any, creep: Any = 0.0, seed: int = 1, name: str = '', amplitude: Any = 1.0
) -> Record:
    """Return a record of a Bouc-Wen actuator that may creep with its voltage."""
    model = named('classical')
    voltage = amplitude * np.sin(2 * np.pi * frequency * TIME)
    moved = model.respond(voltage, model.pack({}), DT)
    slow = np.cumsum(voltage - 0.5) * DT
    noise = 2e-8 * np.random.default_rng(seed).standard_normal(TIME.size)
    # the displacement is read before the voltage of its tick acts
    late = np.concatenate([[0.0], moved[:-1]])
    return Record(
        name or f'f{frequency:g}', DT, voltage, late + creep * slow + noise,
        info=RecordInfo(frequency=frequency, amplitude=amplitude),
    )  # fmt: skip


@pytest.fixture(scope='module')
def fitted() -> Identification:
    return identify([record(5.0), record(20.0)], named('classical'))


def test_an_identification_knows_what_it_misses(fitted: Identification) -> None:
    known = fitted.discrepancy
    assert known is not None
    assert not known.held_out
    assert [c.frequency for c in known.conditions] == [5.0, 20.0]
    assert known.rms == pytest.approx(2e-8, rel=0.05)
    saved = fitted.model
    names, matrix = saved.covariance()
    assert set(names) == {'A1', 'A', 'beta', 'gamma', 'offset'}
    np.testing.assert_allclose(
        np.sqrt(np.diag(matrix)), [saved.deviations[name] for name in names]
    )
    at = [fitted.names.index(name) for name in names]
    spread = np.sqrt(np.diag(matrix))
    np.testing.assert_allclose(
        matrix / np.outer(spread, spread), fitted.correlation[np.ix_(at, at)], atol=1e-8
    )
    assert fitted.summary()['discrepancy']['judged_on'] == 'fitted'


def test_recursive_methods_know_it_too() -> None:
    found = identify([record(5.0), record(20.0)], named('classical'), method='rls_ud')
    assert found.discrepancy is not None
    assert ModelFile.parse(found.model.text()).correlation is not None


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with records and the model of two of them."""
    where = tmp_path_factory.mktemp('known')
    records = {
        'one': record(5.0), 'two': record(20.0), 'more': record(11.0, seed=2, amplitude=0.8),
        'crept': record(11.0, creep=2e-6, seed=3),
    }  # fmt: skip
    for name, each in records.items():
        write_csv(where / f'{name}.csv', replace(each, name=name))
    words = ['identify', str(where / 'one.csv'), str(where / 'two.csv'), '--model', 'classical']
    assert main([*words, '--out', str(where / 'model')]) == 0
    return where


@pytest.mark.component
def test_identify_evaluates_on_held_out_records(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['identify', str(folder / 'one.csv'), '--model', 'classical']
    held = ['--held-out', str(folder / 'more.csv')]
    assert main([*words, *held, '--out', str(tmp_path / 'out')]) == 0
    assert 'over all records that were not fitted' in capsys.readouterr().out
    known = ModelFile.load(tmp_path / 'out' / 'model.yaml').discrepancy
    assert known is not None
    assert known.held_out
    assert [c.frequency for c in known.conditions] == pytest.approx([11.0])
    twice = ['--held-out', str(folder / 'one.csv')]
    assert main([*words, *twice, '--out', str(tmp_path / 'no')]) == 2
    assert 'one.csv is fitted and held out' in capsys.readouterr().err


@pytest.mark.slow
def test_validate_reports_an_error_above_the_known_discrepancy(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['validate', '--model', str(folder / 'model' / 'model.yaml')]
    assert main([*words, str(folder / 'more.csv'), '--out', str(tmp_path / 'more')]) == 0
    assert 'the known discrepancy of the model; the largest on' in capsys.readouterr().out
    assert main([*words, str(folder / 'crept.csv'), '--out', str(tmp_path / 'crept')]) == 0
    assert 'exceeds the known discrepancy of the model on 1 of 1' in capsys.readouterr().out
    content = {
        name: json.loads((tmp_path / name / 'summary.json').read_text())['discrepancy']
        for name in ('more', 'crept')
    }
    assert not content['more']['larger']
    assert content['crept']['larger']
    (row,) = content['crept']['records']
    assert row['ratio'] > 3
    evaluated = ModelFile.load(tmp_path / 'crept' / 'model.yaml').discrepancy
    assert evaluated is not None
    assert evaluated.held_out
    assert evaluated.rms > 3 * row['expected_rms_m']


@pytest.mark.slow
def test_validate_of_a_model_without_discrepancy(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = ModelFile.load(folder / 'model' / 'model.yaml')
    replace(saved, discrepancy=None).save(tmp_path / 'old.yaml')
    words = ['validate', str(folder / 'more.csv'), '--model', str(tmp_path / 'old.yaml')]
    assert main([*words, '--out', str(tmp_path / 'out')]) == 0
    assert 'the model has no discrepancy' in capsys.readouterr().out
    assert json.loads((tmp_path / 'out' / 'summary.json').read_text())['discrepancy'] is None
    evaluated = ModelFile.load(tmp_path / 'out' / 'model.yaml')
    assert evaluated.discrepancy is not None
    assert evaluated.values == saved.values
