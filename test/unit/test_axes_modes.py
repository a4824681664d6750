"""Models of several axes: simulation, derivatives, files, and their identification."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_discovery import discover_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.cross_talk import cross_talk
from piezo_hysteresis.axes.frequency_response import response, vector_fit
from piezo_hysteresis.axes.modal_fit import ModalDerivatives, ModalFit, ModalFitData
from piezo_hysteresis.axes.modal_gradient import gradient
from piezo_hysteresis.axes.modal_model import (
    AxesDrive,
    ModalLayout,
    ModalModel,
    delayed,
    play_bank,
)
from piezo_hysteresis.axes.modal_search import identify_axes, levels_of, rms_error
from piezo_hysteresis.errors import IdentificationError, ModelError, RecordError
from piezo_hysteresis.models.modelfile import is_modal

RATE, SAMPLES = 2000.0, 1024
FREQUENCY = np.array([150.0, 240.0, 410.0])
DAMPING = np.array([0.02, 0.015, 0.01])
SHAPE = np.array([[0.6, 0.3, -0.4], [0.2, -0.5, 0.5]])
MICRO = 1e-6


def layout(**parts: object) -> ModalLayout:
    return replace(ModalLayout(2, 2, 3, (0.05, 0.3), (2,), (0.1, 0.4), True, 1), **parts)  # type: ignore[arg-type]


def model(kind: ModalLayout, seed: int = 0) -> ModalModel:
    """Return a model with every effect of its layout."""
    rng = np.random.default_rng(seed)
    vector = kind.zeros()
    found = kind.named(vector)
    found['log_omega'][:] = np.log(2.0 * np.pi * FREQUENCY[: kind.modes])
    found['log_damping'][:] = np.log(DAMPING[: kind.modes])
    found['shape'][:2] = SHAPE[:, : kind.modes]
    found['shape'][2:] = 0.3
    found['rate_shape'][...] = 0.05 * rng.standard_normal(found['rate_shape'].shape)
    found['delay'][0] = 0.7 / RATE
    found['softening'][...] = 0.01
    found['level_damping'][...] = 0.1
    found['voltage_weights'][...] = 0.1 * rng.standard_normal(found['voltage_weights'].shape)
    found['elongation_weights'][...] = 0.03
    found['square'][...] = 0.01
    found['cube'][...] = 0.005
    output = MICRO * rng.standard_normal((len(kind.signal_names), kind.outputs))
    return ModalModel(kind, vector, output, 1.0, 1.0 / RATE)


def voltage(seed: int, level: float = 1.0, inputs: int = 2, highest: float = 0.4) -> FloatArray:
    """Return one period of a multisine up to a part of the rate, independent for each input."""
    rng = np.random.default_rng(seed)
    spectrum = np.zeros((SAMPLES // 2 + 1, inputs), complex)
    lines = np.arange(4, int(highest * SAMPLES))
    spectrum[lines] = np.exp(2j * np.pi * rng.random((lines.size, inputs)))
    x = np.fft.irfft(spectrum, SAMPLES, axis=0)
    return np.asarray(level * x / np.sqrt(np.mean(x**2)))


def linear_response(x: FloatArray, omega: FloatArray, damping: FloatArray) -> FloatArray:
    """Return the steady state of modes in continuous time, by lines: an independent way."""
    s = 2j * np.pi * np.fft.rfftfreq(SAMPLES, 1.0 / RATE)[:, None]
    gain = omega**2 / (s**2 + 2.0 * damping * omega * s + omega**2)
    q = gain * (np.fft.rfft(x, axis=0) @ SHAPE)
    return np.asarray(np.fft.irfft(q @ (MICRO * SHAPE.T), SAMPLES, axis=0))


def record(name: str, u: FloatArray, y: FloatArray, level: str = '') -> AxesRecord:
    return AxesRecord(name, 1.0 / RATE, u, y, periods=1, level=level)


def test_a_play_follows_behind_its_half_width() -> None:
    out = np.empty((4, 1))
    play_bank(np.array([1.0, 2.0, 1.5, 0.0]), np.array([0.5]), out, 1)
    assert np.allclose(out[:, 0], [0.5, 1.5, 1.5, 0.5])


def test_linear_modes_are_those_of_continuous_time() -> None:
    kind = ModalLayout(2, 2, 3)
    vector = kind.zeros()
    found = kind.named(vector)
    omega = 2.0 * np.pi * FREQUENCY
    found['log_omega'][:], found['log_damping'][:] = np.log(omega), np.log(DAMPING)
    found['shape'][...] = SHAPE
    output = np.zeros((len(kind.signal_names), 2))
    output[:3] = MICRO * SHAPE.T
    u = voltage(1)
    y = ModalModel(kind, vector, output, 1.0, 1.0 / RATE).simulate(record('a', u, u))
    expected = linear_response(u, omega, DAMPING)
    slow = slice(1, SAMPLES // 4)  # a drive linear within a tick is weaker at fast lines
    error = np.fft.rfft(y - expected, axis=0)[slow]
    assert np.linalg.norm(error) < 0.05 * np.linalg.norm(np.fft.rfft(expected, axis=0)[slow])


def test_a_record_from_rest_joins_its_steady_state() -> None:
    made = model(layout())
    u = voltage(2, 0.7)
    steady = made.simulate(record('a', u, u))
    longer = AxesRecord('b', 1.0 / RATE, np.tile(u, (6, 1)), np.tile(u, (6, 1)))
    flat = replace(made, vector=made.vector.copy())
    flat.parameters['softening'][...] = 0.0
    flat.parameters['level_damping'][...] = 0.0
    steady = flat.simulate(record('a', u, u))
    last = flat.simulate(longer)[-SAMPLES:]
    last = last - last.mean(0)
    assert np.std(last - steady) < 0.1 * np.std(steady)


@pytest.mark.parametrize('name', list(layout().places))
def test_derivatives_are_those_of_differences(name: str) -> None:
    """Modes are exact; hysteresis of the elongation is taken as a gain, to about a tenth."""
    kind = layout()
    made = model(kind)
    products = [place for place, each in enumerate(kind.signal_names) if 'elongations' in each]
    made.output[products] = 0.0  # products of elongations are held in a step of a fit
    for effect, size in (('elongation_weights', 0.01), ('square', 1e-3), ('cube', 5e-4)):
        made.parameters[effect][...] = size
    u = voltage(3, 0.8, highest=0.23)
    at, _ = kind.places[name]
    drive = AxesDrive(record('a', u, made.simulate(record('a', u, u))), kind)
    signals = made.signals(drive)
    found = ModalDerivatives(made, drive, signals).of([name])
    for place in (0, at.stop - at.start - 1):
        step = 1e-5 / (RATE if name == 'delay' else 1.0)
        moved = []
        for sign in (1.0, -1.0):
            vector = made.vector.copy()
            vector[at.start + place] += sign * step
            if name == 'delay':  # the measurement comes earlier by it
                moved.append(-delayed(drive.record.displacement, -vector[at.start] * RATE))
            else:
                other = replace(made, vector=vector).signals(drive)
                moved.append(other @ made.output)
        change = np.fft.rfft(moved[0] - moved[1], axis=0)[1:] / (2.0 * step)
        change = change * np.sqrt(2.0 / SAMPLES)
        error = np.linalg.norm(change - found[place]) / np.linalg.norm(change)
        assert error < 0.25, (name, place, error)


@pytest.mark.parametrize('name', [each for each in layout().places if each != 'delay'])
def test_the_gradient_is_that_of_differences(name: str) -> None:
    """Exact with plays and powers of the elongation, but for what one period does not settle."""
    kind = layout()
    made = model(kind)
    made.parameters['log_damping'][...] = np.log(0.03)
    u = voltage(3, 0.8)
    drive = AxesDrive(record('a', u, u), kind)
    by_signals = np.random.default_rng(1).standard_normal(made.signals(drive).shape)
    at, _ = kind.places[name]
    found = gradient(made, drive, by_signals)[at]
    changes = []
    for place in range(at.start, at.stop):
        costs = []
        for step in (1e-6, -1e-6):
            vector = made.vector.copy()
            vector[place] += step
            costs.append(np.sum(by_signals * replace(made, vector=vector).signals(drive)))
        changes.append((costs[0] - costs[1]) / 2e-6)
    assert np.linalg.norm(found - changes) < 2e-3 * np.linalg.norm(changes)


@pytest.mark.component
def test_a_fit_finds_strong_hysteresis_of_the_elongation() -> None:
    kind = ModalLayout(2, 2, 3, (), (), (0.3, 1.0))
    made = model(kind)
    for name in ('rate_shape', 'softening', 'level_damping'):
        made.parameters[name][...] = 0.0
    made.parameters['elongation_weights'][...] = 0.08
    made.output[...] = 0.0
    made.output[:3] = MICRO * SHAPE.T
    records = [record('a', u, made.simulate(record('a', u, u))) for u in (voltage(8), voltage(9))]
    start = replace(made, vector=made.vector.copy())
    start.parameters['elongation_weights'][...] = 0.0
    fit = ModalFit(start, ModalFitData.of(records, kind, np.full(2, 1.0 / MICRO)))
    found = fit.run(['log_omega', 'log_damping', 'shape', 'elongation_weights'], 40)
    left = rms_error(found, records[0]) / records[0].displacement.std()
    assert left < 5e-3, left  # with slopes that take it as a gain, 0.038


def test_a_file_gives_the_same_displacement(tmp_path: Path) -> None:
    made = model(layout())
    path = tmp_path / 'model.yaml'
    modal_file.save(made, path)
    assert is_modal(path)
    u = voltage(4)
    again = modal_file.load(path).simulate(record('a', u, u))
    expected = made.simulate(record('a', u, u))
    assert np.allclose(again, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('frequency_Hz: 1', 'frequency_Hz: -1', 'must be positive'),
        ('delay_s', 'delay', 'unknown delay'),
        ('inputs: 2', 'inputs: 3', 'shape'),
        ('piezo_hysteresis/modes/1', 'piezo_hysteresis/model/2', 'no model of several axes'),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    path = tmp_path / 'model.yaml'
    modal_file.save(model(layout()), path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ModelError, match=sentence):
        modal_file.load(path)


def linear_records(noise: float = 0.0, softening: float = 0.0) -> list[AxesRecord]:
    """Return four realisations of two levels of modes that soften with the level."""
    found = []
    rng = np.random.default_rng(5)
    for place, level in enumerate((0.5, 1.0)):
        omega = 2.0 * np.pi * FREQUENCY * (1.0 - softening * level)
        for k in range(4):
            u = voltage(10 * place + k, level)
            y = linear_response(u, omega, DAMPING)
            y += noise * MICRO * rng.standard_normal(y.shape)
            found.append(record(f'{level}/{k}', u, y, f'{level} V'))
    return found


def test_vector_fitting_finds_the_poles() -> None:
    measured = response(linear_records()[:4])
    poles = vector_fit(measured, 3, 0.0).poles
    assert np.allclose(np.abs(poles) / (2.0 * np.pi), FREQUENCY, rtol=1e-5)
    assert np.allclose(-poles.real / np.abs(poles), DAMPING, rtol=1e-3)


def test_records_that_drive_one_axis_only_are_refused() -> None:
    records = [
        replace(each, voltage=np.repeat(each.voltage[:, :1], 2, axis=1))
        for each in linear_records()[:4]
    ]
    with pytest.raises(RecordError, match='independently'):
        response(records)


def test_a_play_wider_than_every_voltage_is_left_alone() -> None:
    records = linear_records(noise=0.003)[:2]
    kind = ModalLayout(2, 2, 3, (0.05, 100.0))
    made = model(kind)
    fit = ModalFit(made, ModalFitData.of(records, kind, np.ones(2)))
    found = fit.run(['voltage_weights'], 1)
    assert np.isfinite(found.output).all()
    assert not found.output[-2:].any()
    assert np.isfinite(rms_error(found, records[0]))


def test_levels_are_stated_or_found() -> None:
    records = linear_records()
    assert {name: len(those) for name, those in levels_of(records).items()} == {
        '0.5 V': 4, '1.0 V': 4,
    }  # fmt: skip
    unnamed = [replace(each, level='') for each in records]
    assert [len(those) for those in levels_of(unnamed).values()] == [4, 4]


def test_too_few_records_are_refused() -> None:
    with pytest.raises(IdentificationError, match='3 periodic ones, of which one is held out'):
        identify_axes(linear_records()[:2])


@pytest.mark.component
def test_softening_is_named_and_nothing_else() -> None:
    found = identify_axes(linear_records(noise=0.003, softening=0.02), modes=3)
    assert [step.effect for step in found.steps] == ['linear', 'level_softening', 'all together']
    frequency = np.exp(found.model.parameters['log_omega']) / (2.0 * np.pi)
    soft = found.model.modes_at(np.array([0.5, 1.0]))[0] / (2.0 * np.pi)
    assert np.allclose(np.sort(soft[1]), 0.98 * FREQUENCY, rtol=1e-3), (soft, frequency)
    assert np.allclose(np.sort(soft[0]), 0.99 * FREQUENCY, rtol=1e-3)
    held = linear_records(softening=0.02)[3]
    assert rms_error(found.model, held) < 0.02 * held.displacement.std()


@pytest.mark.component
def test_one_axis_is_a_model_of_several_with_one(tmp_path: Path) -> None:
    kind = ModalLayout(1, 1, 1, voltage_plays=(0.3, 1.0))
    vector = kind.zeros()
    made = kind.named(vector)
    made['log_omega'][:], made['log_damping'][:] = np.log(2.0 * np.pi * 240.0), np.log(0.015)
    made['shape'][...], made['voltage_weights'][...] = 1.0, 0.1
    output = np.zeros((len(kind.signal_names), 1))
    output[0] = MICRO
    plant = ModalModel(kind, vector, output, 1.0, 1.0 / RATE)
    rng = np.random.default_rng(4)
    records = []
    for seed in range(4):
        u = voltage(seed, inputs=1)
        y = plant.simulate(record('plant', u, u))
        y += 1e-3 * MICRO * rng.standard_normal(y.shape)
        records.append(record(f'run {seed}', u, y, '1V'))
    found = identify_axes(records, modes=1, effects=['voltage_hysteresis'])
    linear, hysteretic, *_ = found.steps
    assert hysteretic.held_out['1V'] < 0.2 * linear.held_out['1V']
    frequency = np.exp(found.model.layout.named(found.model.vector)['log_omega'][0])
    assert frequency == pytest.approx(2.0 * np.pi * 240.0, rel=1e-3)
    modal_file.save(found.model, tmp_path / 'model.yaml')
    kept = modal_file.load(tmp_path / 'model.yaml')
    left = records[0].displacement - kept.simulate(records[0])
    assert np.std(left) < 0.01 * np.std(records[0].displacement)


@pytest.mark.component
def test_linear_modes_need_nothing() -> None:
    found = identify_axes(linear_records(noise=0.003), modes=3)
    assert [step.effect for step in found.steps] == ['linear', 'all together']


@pytest.mark.component
def test_hysteresis_of_the_elongation_is_named() -> None:
    kind = ModalLayout(2, 2, 3, (), (), (0.3, 1.0))
    made = model(kind)
    for name in ('square', 'cube', 'rate_shape', 'softening', 'level_damping'):
        made.parameters[name][...] = 0.0
    made.parameters['elongation_weights'][...] = 0.08
    made.output[...] = 0.0
    made.output[:3] = MICRO * SHAPE.T
    records = []
    rng = np.random.default_rng(6)
    for place, level in enumerate((0.5, 1.0)):
        for k in range(4):
            u = voltage(50 + 10 * place + k, level)
            y = made.simulate(record('a', u, u))
            y += 0.02 * MICRO * rng.standard_normal(y.shape)
            records.append(record(f'{level}/{k}', u, y, f'{level} V'))
    found = identify_axes(records, modes=3, report=print)
    assert found.steps[1].effect == 'elongation_hysteresis'
    last, first = found.steps[-1].held_out, found.steps[0].held_out
    assert all(last[level] < 0.2 * first[level] for level in last)


@pytest.mark.component
def test_hysteresis_of_joints_is_found_where_the_actuators_have_none() -> None:
    kind = ModalLayout(2, 2, 3, (), (), (0.1, 0.3), joints=1)
    made = model(kind)
    for name in ('square', 'cube', 'rate_shape', 'softening', 'level_damping'):
        made.parameters[name][...] = 0.0
    made.parameters['elongation_weights'][...] = [[0.0, 0.0, 0.15]]
    made.output[...] = 0.0
    made.output[:3] = MICRO * SHAPE.T
    records = []
    rng = np.random.default_rng(7)
    for place, level in enumerate((0.5, 1.0)):
        for k in range(4):
            u = voltage(70 + 10 * place + k, level)
            y = made.simulate(record('a', u, u))
            y += 0.02 * MICRO * rng.standard_normal(y.shape)
            records.append(record(f'{level}/{k}', u, y, f'{level} V'))
    effects = ['elongation_hysteresis', 'joint_hysteresis', 'structural_mode']
    less = identify_axes(records, modes=3, effects=effects[:1]).steps[-1].held_out
    more = identify_axes(records, modes=3, effects=effects).steps[-1].held_out  # a mode after it
    assert all(more[level] < 0.9 * less[level] for level in less), (less, more)


def test_the_inverse_decouples_the_axes() -> None:
    kind = ModalLayout(2, 2, 3, (0.05, 0.3), (), (0.3, 1.0))
    made = model(kind)
    made.output[...] = 0.0
    made.output[:3] = MICRO * SHAPE.T
    t = np.arange(SAMPLES) / SAMPLES
    triangle = 0.2 * MICRO * (2.0 * np.abs(2.0 * ((8.0 * t) % 1.0) - 1.0) - 1.0)
    target = np.stack([triangle, np.zeros(SAMPLES)], 1)
    found = made.inverse(target)
    played = made.simulate(record('a', found.voltage, target))
    assert np.allclose(played, found.displacement, atol=1e-12)
    assert found.error.max() < 0.02 * triangle.std()
    single = found.voltage.copy()
    single[:, 1] = 0.0  # axis 1 alone moves axis 2 as well
    assert np.std(made.simulate(record('a', single, target))[:, 1]) > 20.0 * found.error[1]
    with pytest.raises(ModelError, match='finite numbers of shape'):
        made.inverse(target[:, :1])


@pytest.mark.parametrize('hidden', [(), ((0, 1),), ((1, 0), (0, 1))])
def test_cross_talk_is_named_by_its_pair(hidden: tuple[tuple[int, int], ...]) -> None:
    """One per cent of the stroke, in noise of one per cent; five draws."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        gain = np.eye(2)
        for voltage_of, moved in hidden:
            gain[moved, voltage_of] = 0.01
        records = []
        for k in range(3):
            u = voltage(100 * seed + k)
            y = MICRO * u @ gain.T
            y += 0.01 * MICRO * rng.standard_normal(y.shape)
            records.append(record(str(k), u, y))
        found = cross_talk(records, below=100.0)
        assert {(each.voltage - 1, each.displacement - 1) for each in found} == set(hidden)
        assert all(abs(each.size - 0.01) < 4.0 * each.std for each in found)


@pytest.mark.slow
def test_a_kept_model_shows_what_has_changed_and_nothing_where_nothing_has(tmp_path: Path) -> None:
    before = identify_axes(linear_records(noise=0.003), modes=3, effects=[])
    file = str(tmp_path / 'model.yaml')
    before.save(file)
    assert discover_axes(linear_records(noise=0.003), file).effects == ()
    softer = discover_axes(linear_records(noise=0.003, softening=0.02), file)
    assert {step.effect for step in softer.steps} <= {'level_softening', 'mode_change'}
    assert softer.identification is not None
    first, last = softer.identification.steps[0], softer.identification.steps[-1]
    assert first.effect == 'baseline'
    assert min(first.held_out[each] / last.held_out[each] for each in first.held_out) > 3.0
    grown = [replace(each, displacement=1.1 * each.displacement) for each in linear_records(0.003)]
    assert discover_axes(grown, file).effects == ('output_change',)
    other = replace(before.model, dt=2.0 * before.model.dt)
    with pytest.raises(IdentificationError, match='the baseline has 2 voltages'):
        identify_axes(linear_records(), kept=other)
    with pytest.raises(IdentificationError, match=r'or the model\.yaml of several axes'):
        discover_axes(linear_records(), 'nowhere.yaml')
