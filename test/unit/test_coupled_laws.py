"""The laws of several axes, tick by tick: decoupling, attenuation, complete ticks, refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.compensation.coupled.axes_chain import AxesChain, axes_chain, axes_loop
from piezo_hysteresis.compensation.coupled.decoupling import Decoupling, transfers
from piezo_hysteresis.compensation.coupled.matrix_attenuation import MatrixAttenuation, gains_of
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.errors import CompensationError, ModelError
from piezo_hysteresis.parameters.links import COUPLED
from piezo_hysteresis.runtime.coupled_ticks import CoupledBook, CoupledLoop
from piezo_hysteresis.waveforms import Sine
from piezo_hysteresis.waveforms.waveform import Samples
from piezo_sim.axes_plant import AxesPlant

RATE, MICRO, TICKS = 4000.0, 1e-6, 4000
LIMITS = [Limits(-20.0, 20.0, 1e6)] * 2
REST = ReferencePoint(0, 0.0, 0.0, 0.0, 0.0, 0.0)


def scanner(cross: float = 0.2, *, plays: bool = True) -> ModalModel:
    """Return two axes with cross-talk, hysteresis of voltage and elongation, and a late sensor."""
    widths = (0.3, 1.0) if plays else ()
    layout = ModalLayout(2, 2, 2, widths, (3,) if plays else (), widths)
    vector = layout.zeros()
    found = layout.named(vector)
    found['log_omega'][:] = np.log(2.0 * np.pi * np.array([310.0, 420.0]))
    found['log_damping'][:] = np.log(0.02)
    found['shape'][...] = [[1.0, 0.1], [-0.1, 1.0]]
    found['delay'][0] = 1.5 / RATE
    output = np.zeros((len(layout.signal_names), 2))
    output[:2] = MICRO * np.array([[1.0, cross], [-cross, 1.0]])
    if plays:
        found['voltage_weights'][:2] = 0.1
        found['voltage_weights'][2] = 1e-3
        found['elongation_weights'][...] = 0.05
        output[-4] = [3e-9, 1e-9]
    return ModalModel(layout, vector, output, 3.0, 1.0 / RATE)


def waves(ticks: int = TICKS) -> list[Sine]:
    return [Sine(2.0 * MICRO, each, ticks / RATE, ramp=0.1) for each in (10.0, 25.0)]


def sampled(ticks: int = TICKS) -> list[Samples]:
    time = np.arange(ticks) / RATE
    return [each.sample(time) for each in waves(ticks)]


def points_of(k: int, samples: list[Samples]) -> list[ReferencePoint]:
    return [
        ReferencePoint(k, *(float(column[k]) for column in (
            each.value, each.velocity, each.acceleration, each.frequency, each.phase)))
        for each in samples
    ]  # fmt: skip


def driven(model: ModalModel, samples: list[Samples], ticks: int) -> FloatArray:
    law = Decoupling(model)
    return np.array([law.step(points_of(k, samples)).copy() for k in range(ticks)])


@pytest.mark.component
def test_the_model_follows_the_voltages_of_its_own_feedforward() -> None:
    model, samples = scanner(), sampled()
    y = model.simulate(driven(model, samples, TICKS))
    wanted = np.stack([each.value for each in samples], 1)
    part = slice(TICKS // 2, TICKS - 100)
    left = (y - wanted)[part] - (y - wanted)[part].mean(0)
    assert np.sqrt(np.mean(left**2, 0)).max() < 3e-3 * np.sqrt(np.mean(wanted[part] ** 2))
    plain = driven(scanner(0.0, plays=False), samples, TICKS)
    alone = model.simulate(plain) - wanted
    assert np.sqrt(np.mean((alone - alone[part].mean(0))[part] ** 2, 0)).min() > 0.05 * MICRO


def test_the_series_is_that_of_the_transfer_functions() -> None:
    model = scanner(plays=False)
    law = Decoupling(model)
    s = np.array([2j * np.pi * 12.0])
    through, _ = transfers(model, s)
    series = np.einsum('dio,d->io', law.numbers.drive, s[0] ** np.arange(3))
    np.testing.assert_allclose(series @ through[0], np.eye(2), atol=2e-4)


def test_a_model_whose_axes_move_alike_has_no_voltages_that_explode() -> None:
    model = scanner(plays=False)
    model.output[:2] = MICRO
    model.output[0] *= np.nan
    with pytest.raises(ModelError):
        Decoupling(model)


def test_where_there_is_no_inverse_the_last_voltages_are_held_and_it_is_counted() -> None:
    model = scanner()
    model.parameters['voltage_weights'][2] = -1e-2  # the displacement turns back
    law = Decoupling(model)
    held = law.step([REST._replace(displacement=2.0 * MICRO), REST]).copy()
    after = law.step([REST._replace(displacement=80.0 * MICRO), REST])
    np.testing.assert_array_equal(after, held)
    assert law.counters() == {'no_inverse': 1}
    assert np.abs(held).max() > 1.0


class ModelPlant:
    """Another scanner as a plant of one tick after the other."""

    def __init__(self, gain: FloatArray) -> None:
        self._gain, self._before = gain, np.zeros(2)

    def run(self, voltages: FloatArray) -> FloatArray:
        answer = self._gain @ (self._before + 0.02 * self._before**2)
        self._before = voltages[0]
        return np.asarray(answer[None])


@pytest.mark.component
def test_attenuation_takes_the_errors_of_all_axes_by_the_matrix_of_gains() -> None:
    model, ticks = scanner(plays=False), 6 * TICKS
    gain = MICRO * np.array([[1.1, -0.1], [0.3, 0.9]])
    runs = [
        axes_loop(sampled(ticks), AxesChain(model, settings, 40.0), ModelPlant(gain), LIMITS)
        for settings in (None, MatrixSettings(orders=(0, 1, 2)))
    ]
    before, after = (np.sqrt(np.mean(run.error[-TICKS:] ** 2, 0)) for run in runs)
    assert np.all(before > 0.1 * MICRO)
    assert np.all(after < 0.2 * before)
    assert runs[1].counters['backed_off'] == 0


@pytest.mark.component
def test_a_correction_of_the_wrong_sign_is_taken_back() -> None:
    model, ticks = scanner(plays=False), 3 * TICKS
    wrong = -0.9 * MICRO * np.eye(2)
    chain = AxesChain(model, MatrixSettings(orders=(1,)), 40.0)
    run = axes_loop(sampled(ticks), chain, ModelPlant(wrong), LIMITS)
    assert run.counters['backed_off'] >= 1
    assert np.abs(run.voltage).max() <= 20.0
    free = axes_loop(sampled(ticks), AxesChain(model), ModelPlant(wrong), LIMITS)
    assert np.abs(run.error).max() < 4.0 * np.abs(free.error).max()


def test_a_sensor_that_answers_no_number_teaches_nothing() -> None:
    law = MatrixAttenuation(scanner(plays=False), MatrixSettings(orders=(0, 1)), 40.0)
    samples, received = sampled(), np.zeros(2)
    for k in range(1, 1500):
        points = points_of(k, samples)
        read = [Measured(k - 1, 0.0, 1e-7), Measured(k - 1, 0.0, 1.1e-7)]
        law.step(points, received, read)
    learnt = law.lines.copy()
    assert np.abs(learnt).max() > 1e-4
    for k in range(1500, 1600):
        law.step(points_of(k, samples), received, [Measured(k - 1, 0.0, math.nan), None])
    np.testing.assert_array_equal(law.lines, learnt)
    assert np.all(np.isfinite(received))
    assert law.counters()['not_finite'] == 100


def test_the_gains_end_at_the_highest_mode() -> None:
    gains, spacing = gains_of(scanner(plays=False))
    assert gains.shape[0] * spacing == pytest.approx(420.0, abs=2.0 * spacing)
    static = np.linalg.inv(gains[0, :, :, 0])
    assert static[1, 1] == pytest.approx(MICRO, rel=0.05)


def test_models_of_another_loop_are_refused() -> None:
    with pytest.raises(CompensationError, match='a loop of 1 axis '):
        axes_chain(scanner(), LIMITS[:1], None, RATE)
    with pytest.raises(CompensationError, match='identify it at the rate of the loop'):
        axes_chain(scanner(), LIMITS, None, 1000.0)
    with pytest.raises(CompensationError, match='orders must be different'):
        MatrixSettings(orders=(1, 1))
    with pytest.raises(CompensationError, match='step'):
        MatrixSettings(step=0.0)


def test_a_tick_is_complete_with_all_axes_in_any_order() -> None:
    book = CoupledBook(2)
    book.add_reference(0, REST, b'a')
    assert book.take() is None
    book.add_reference(1, REST, b'b')
    tick = book.take()
    assert tick is not None
    assert tick.tags == [b'a', b'b']
    assert tick.measured == [None, None]
    assert book.take() is None
    first, second = REST._replace(sample=1), Measured(0, 1.0, 2.0)
    for axis in (1, 0):
        book.add_reference(axis, first, b'')
        book.add_measured(axis, Measured(1, 0.0, 0.0))  # the next one is there already
    assert book.take() is None
    book.add_measured(0, second)
    book.add_measured(1, second)
    tick = book.take()
    assert tick is not None
    assert tick.measured == [second, second]


def test_a_tick_without_one_of_its_references_is_dropped_for_a_newer_one() -> None:
    book = CoupledBook(2)
    book.add_reference(0, REST._replace(sample=4), b'')
    for axis in range(2):
        book.add_measured(axis, Measured(4, 0.0, 0.0))
        book.add_reference(axis, REST._replace(sample=5), b'')
    tick = book.take()
    assert tick is not None
    assert tick.points[0].sample == 5
    assert book.dropped == 1
    book.add_reference(0, REST._replace(sample=4), b'')
    assert book.take() is None


def test_a_repeated_reference_does_not_wait_for_a_lost_measurement() -> None:
    book = CoupledBook(2)
    for axis in range(2):
        book.add_measured(axis, Measured(6, 0.0, float(axis)))
        book.add_reference(axis, REST._replace(sample=9), b'')
    assert book.take() is None
    book.add_reference(0, REST._replace(sample=9), b'')
    tick = book.take()
    assert tick is not None
    assert tick.measured == [Measured(6, 0.0, 0.0), Measured(6, 0.0, 1.0)]


def loop(**changes: object) -> CoupledLoop:
    values = {**COUPLED.defaults(), 'rate': RATE, **changes}
    return CoupledLoop(scanner(), values, LIMITS)


def test_a_reference_that_is_no_number_holds_the_last_one() -> None:
    laws, book = loop(), CoupledBook(2)
    asked = []
    for k, value in enumerate((1.0, 1.0, math.nan)):
        for axis in range(2):
            point = REST._replace(sample=k, displacement=value * MICRO)
            book.add_reference(axis, point, b'')
            book.add_measured(axis, Measured(k, 0.0, 0.0))
        tick = book.take()
        assert tick is not None
        asked.append(laws.voltages(tick))
    assert asked[2] == asked[1]
    assert laws.counters()['refused_references'] == 2


@pytest.mark.component
def test_nothing_is_attenuated_before_the_signs_of_all_sensors_are_known() -> None:
    laws, samples = loop(), sampled()
    book = CoupledBook(2)
    read = [Measured(-1, 0.0, 0.0)] * 2
    for k in range(2000):
        for axis, point in enumerate(points_of(k, samples)):
            book.add_measured(axis, read[axis])
            book.add_reference(axis, point, b'')
            if k > 0:
                laws.take_state(axis, read[axis])
        tick = book.take()
        assert tick is not None
        asked = laws.voltages(tick)
        # the second sensor is reversed
        read = [Measured(k, asked[0], MICRO * asked[0]), Measured(k, asked[1], -MICRO * asked[1])]
    assert laws.withheld
    assert laws.counters()['reversed_sensor'] == 1
    assert laws.chain.attenuation is not None
    assert not np.any(laws.chain.attenuation.lines)


@pytest.mark.component
def test_the_chain_drives_the_simulated_stage_within_its_limits() -> None:
    plant = AxesPlant.from_preset('xy_scanner', RATE)
    model = replace(scanner(), full_level=3.0)
    low = [Limits(-1.0, 1.5, 50.0), Limits(-2.0, 2.0, 1e5)]
    run = axes_loop(sampled(1500), AxesChain(model, MatrixSettings(), 2.5), plant, low)
    for i, each in enumerate(low):
        assert run.voltage[:, i].min() >= each.low
        assert run.voltage[:, i].max() <= each.high
        assert np.abs(np.diff(run.voltage[:, i])).max() <= each.slew / RATE * (1.0 + 1e-12)
    assert run.counters['slew_limited_1'] > 0
