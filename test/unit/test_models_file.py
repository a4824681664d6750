"""Model files, and what a model missed in phase with the drive."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis import models
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models import Condition, Discrepancy, ModelFile, Provenance
from piezo_hysteresis.models.repeating import (
    MOST,
    SAME,
    KnownResidual,
    repeating,
    stretches_of,
    usual_powers,
)


@pytest.fixture
def written() -> ModelFile:
    model = models.named('classical')
    return ModelFile(
        model,
        model.defaults(),
        {'A': 1e-9, 'beta': 0.25},
        Provenance(
            data=('sweep.mcap', 'rest.csv'),
            date='2026-11-30T12:00:00',
            fit='output_error',
            rate=1000.0,
            noise_floor=2.1e-8,
            notes={'seed': 7, 'converged': True},
        ),
    )


def test_a_saved_model_is_loaded_as_it_was(written: ModelFile, tmp_path: Path) -> None:
    written.save(tmp_path / 'model.yaml')
    read = ModelFile.load(tmp_path / 'model.yaml')
    assert read.to_dict() == written.to_dict()
    assert read.provenance == written.provenance
    np.testing.assert_array_equal(read.packed, written.packed)
    assert [path.name for path in tmp_path.iterdir()] == ['model.yaml']


def edited(written: ModelFile, tmp_path: Path, change: Callable[..., Any]) -> Path:
    content = written.to_dict()
    change(content)
    path = tmp_path / 'model.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return path


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda c: c.update(schema='other'), 'schema'),
        (lambda c: c.pop('chain'), 'chain must be a list'),
        (lambda c: c['chain'].append('flux_capacitor'), 'there is no block flux_capacitor'),
        (lambda c: c['chain'].reverse(), 'out of order'),
        (lambda c: c['chain'].insert(0, 'bouc_wen_exact|bouc_wen'), 'parallel'),
        (lambda c: c['parameters'].pop('beta'), 'lacks a value for beta'),
        (lambda c: c['parameters'].update(zeta={'value': 1.0}), 'unknown zeta'),
        (lambda c: c['parameters']['beta'].update(value=-1.0), 'outside'),
        (lambda c: c['parameters']['beta'].update(value=float('nan')), 'outside'),
        (lambda c: c['parameters']['beta'].update(value='fast'), 'beta must be a number'),
        (lambda c: c['parameters']['beta'].update(value=True), 'beta must be a number'),
        (lambda c: c['parameters']['beta'].update(unit='1/mV'), 'expected 1/V'),
        (lambda c: c['parameters']['beta'].update(limit=3), 'unknown limit'),
        (lambda c: c.update(parameters=[1, 2]), 'parameters must be a mapping'),
        (lambda c: c.update(comment='x'), 'unknown comment'),
        (lambda c: c['provenance'].update(colour='red'), 'unknown colour'),
    ],
)
def test_bad_files_are_refused_in_one_sentence(
    written: ModelFile, tmp_path: Path, change: Callable[..., Any], message: str
) -> None:
    path = edited(written, tmp_path, change)
    with pytest.raises(ModelError, match=message) as caught:
        ModelFile.load(path)
    assert '\n' not in str(caught.value)
    assert str(path) in str(caught.value)


def test_numbers_that_yaml_takes_for_text_are_numbers(written: ModelFile, tmp_path: Path) -> None:
    path = edited(written, tmp_path, lambda c: c['parameters']['A'].update(value='3e-5'))
    assert ModelFile.load(path).values['A'] == 3e-5


@pytest.mark.parametrize('text', ['', '[1, 2', 'just words', '!!python/object:os.system {}'])
def test_what_is_no_model_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'model.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(ModelError):
        ModelFile.load(path)
    with pytest.raises(ModelError):
        ModelFile.load(tmp_path / 'absent.yaml')


def test_a_failed_save_leaves_the_old_file(written: ModelFile, tmp_path: Path) -> None:
    target = tmp_path / 'model.yaml'
    target.mkdir()
    with pytest.raises(ModelError, match='cannot write'):
        written.save(target)
    assert [path.name for path in tmp_path.iterdir()] == ['model.yaml']


def test_node_parameters_are_flat_and_typed(written: ModelFile, tmp_path: Path) -> None:
    written.save_ros_parameters(tmp_path / 'params.yaml')
    content = yaml.safe_load((tmp_path / 'params.yaml').read_text(encoding='utf-8'))
    parameters = content['/**']['ros__parameters']
    assert parameters['model.chain'] == ['bouc_wen_exact', 'offset']
    assert all(
        isinstance(parameters[f'model.{name}'], float) for name in written.model.parameter_names
    )
    again = ModelFile.from_ros_parameters(parameters)
    assert again.values == written.values
    assert again.model.held == {'A0': 0.0}


def test_unknown_models_and_parameters_name_the_choices() -> None:
    with pytest.raises(ModelError, match='classical'):
        models.named('quantum')
    model = models.named('classical')
    with pytest.raises(ModelError, match='beta'):
        model.pack({'betta': 1.0})
    with pytest.raises(ModelError, match='holds A0'):
        model.pack({'A0': 1e-6})
    assert model.free('A0').pack({'A0': 1e-6})[2] == 1e-6
    with pytest.raises(ModelError, match='unstable'):
        models.named('extended').pack({'c1': 0.9, 'c2': 0.9})
    assert np.isfinite(models.named('extended').pack({'c1': 9.0}, checked=False)).all()
    with pytest.raises(ModelError, match='moves'):
        models.for_range(model, 0.0, 1e-6)


def test_held_parameters_are_marked_and_not_fitted() -> None:
    model = models.named('prandtl_ishlinskii')
    assert 'pi_range' not in model.free_names
    suited = models.for_range(model, 150.0, 20e-6)
    assert suited.held == {'pi_range': 150.0}
    assert suited.defaults()['w0'] == pytest.approx(1e-4 * 20 / 130 / 150)
    known = model.hold(pi_range=75.0)
    assert models.for_range(known, 150.0, 20e-6).held == {'pi_range': 75.0}


STROKE = 1e-4


def missed(frequency: float, amplitude: float, size: float, phase: float | None) -> Condition:
    phases = {} if phase is None else {3: phase}
    return Condition(frequency, amplitude, STROKE, size, None, {3: size}, {}, phases)


def test_what_is_known_is_met_and_what_is_far_is_open() -> None:
    places = np.array([[1.0, 1.0], [4.0, 1.0]])
    phasors = np.array([[1e-2 + 1e-2j, 1e-2 + 2e-2j]])
    wanted = np.array([[1.0, 1.0], [2.0, 1.0], [1e4, 1.0]])
    mean, square = repeating(places, phasors, wanted)
    assert mean[0, 0] == pytest.approx(phasors[0, 0], rel=0.05)
    assert abs(mean[0, 2]) < 0.3 * abs(mean[0, 0])
    assert square[0, 0] < 0.1 * square[0, 1] < 0.1 * square[0, 2]
    assert square[0, 2] == pytest.approx(np.mean(np.abs(phasors) ** 2), rel=0.6)


def test_phases_that_turn_are_less_sure_than_those_that_stay() -> None:
    places = np.array([[f, 1.0] for f in (1.0, 2.0, 4.0, 8.0)])
    wanted = np.array([[2.8, 1.0]])
    stays = 1e-2 * np.ones((1, 4), np.complex128)
    turns = 1e-2 * np.exp(2.4j * np.arange(4.0))[None, :]
    mean, square = repeating(places, stays, wanted)
    other, more = repeating(places, turns, wanted)
    assert abs(mean[0, 0] - 1e-2) < 1e-3
    assert square[0, 0] < 0.3 * more[0, 0]
    assert abs(other[0, 0]) < abs(mean[0, 0])


def test_a_discrepancy_repeats_itself_where_all_its_phases_are_known() -> None:
    at = np.array([0.5, 1.0])
    known = Discrepancy(True, (missed(5.0, 1.0, 2e-7, 0.7),))
    found = known.repeats(5.0, at)
    assert found is not None
    assert sorted(found) == list(range(1, 13))
    assert np.angle(found[3].mean[1]) == pytest.approx(0.7)
    assert abs(found[3].mean[1]) == pytest.approx(2e-3, rel=0.05)
    assert found[3].square[0] > found[3].square[1]
    assert found[1].mean[1] == 0.0
    assert known.repeats(0.0, at) is None
    assert known.octaves_from(10.0, 2.0) == pytest.approx(2.0)
    blind = Discrepancy(True, (missed(5.0, 1.0, 2e-7, 0.7), missed(9.0, 1.0, 2e-7, None)))
    assert blind.repeats(5.0, at) is None


def test_phases_are_written_and_read() -> None:
    known = Discrepancy(True, (missed(5.0, 1.0, 2e-7, -1.5),))
    assert Discrepancy.parse(known.to_dict()) == known
    with pytest.raises(ModelError, match='phases'):
        missed(5.0, 1.0, 2e-7, float('nan'))


def test_a_fundamental_that_a_fit_absorbed_is_expected_elsewhere() -> None:
    phasors = np.array([[1e-4], [1e-2], [3e-3]], np.complex128)
    places, wanted = np.array([[1.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 0.25]])
    _, square = repeating(places, phasors, wanted)
    here, there = np.sqrt(square[0])
    assert here < 2e-3  # known where it was fitted
    assert 5e-3 < there < 2e-2  # as large as the higher harmonics at another amplitude


def test_usual_powers_are_those_of_the_higher_harmonics() -> None:
    phasors = np.outer(1.0 / np.arange(1.0, 13.0), np.exp(1j * np.arange(3)))
    power = np.mean(np.abs(phasors) ** 2, axis=1)
    phasors[0] = 0.0
    np.testing.assert_allclose(usual_powers(phasors), power, rtol=1e-12)


DT, PERIOD = 1e-3, 100


def trace(periods: int = 6, begins: str = '') -> KnownResidual:
    k = np.arange(PERIOD * periods, dtype=np.float64)
    voltage = np.sin(2 * np.pi * k / PERIOD)
    return KnownResidual(voltage, k * 1e-9, DT, begins)


def test_every_stretch_under_the_same_voltage_is_found_once() -> None:
    found = trace().stretches(trace(2).voltage, DT)
    begins = [round(error[0] / 1e-9) for _, error in found]
    assert begins == [0, 100, 200, 300, 400]
    assert all(error.size == 2 * PERIOD and off < 1e-9 for off, error in found)


@pytest.mark.parametrize(
    ('factor', 'dt', 'periods'), [(1.1, DT, 2), (1.0, 2 * DT, 2), (1.0, DT, 7), (0.0, DT, 2)]
)
def test_another_drive_rate_or_length_is_found_nowhere(
    factor: float, dt: float, periods: int
) -> None:
    assert trace().stretches(factor * trace(periods).voltage, dt) == []
    assert stretches_of([trace()], factor * trace(periods).voltage, dt) is None


def test_a_voltage_that_was_measured_with_noise_is_the_same() -> None:
    voltage = trace(2).voltage
    noise = np.random.default_rng(1).standard_normal(voltage.size) * np.std(voltage)
    assert len(trace().stretches(voltage + 0.5 * SAME * noise, DT)) == 5
    assert trace().stretches(voltage + 2.0 * SAME * noise, DT) == []


def test_the_nearest_stretches_of_all_records_come_first_and_are_not_too_many() -> None:
    near, far = trace(40), trace(40)
    far = KnownResidual(1.01 * far.voltage, far.error + 1.0, DT)
    found = stretches_of([far, near], trace(2).voltage, DT, stride=7)
    assert found is not None
    assert found.shape == (MOST, len(range(0, 2 * PERIOD, 7)))
    assert np.all(found < 1.0)
    assert found[0, 1] - found[0, 0] == pytest.approx(7e-9)


def test_a_record_began_so_where_drive_and_way_are_the_same() -> None:
    known, voltage = trace(begins='estimate'), trace(8).voltage
    assert known.began_similarly(voltage, DT, 'estimate')
    assert not known.began_similarly(voltage, DT, 'step')
    assert not known.began_similarly(voltage[PERIOD // 4 :], DT, 'estimate')
    assert not known.began_similarly(voltage, 2 * DT, 'estimate')
