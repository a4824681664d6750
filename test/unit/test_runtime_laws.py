"""ROS-free parts of the links: laws, hand-over, ticks, a sensor that is reversed or stuck."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.node_sheet import Level
from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.feedback.pid import Pid
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    HarmonicAttenuation,
    ScheduledAttenuation,
)
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import CrossFade, Limits, Measured, ReferencePoint
from piezo_hysteresis.errors import CompensationError, PiezoError
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.parameters.links import ATTENUATION, FEEDBACK, FEEDFORWARD
from piezo_hysteresis.runtime.laws import FeedbackLaws, HarmonicLaws, Inversion, chain_settings
from piezo_hysteresis.runtime.link_health import LinkHealth, SensorSign, Sign, StuckSensor
from piezo_hysteresis.runtime.synchronizer import LONGEST, SampleSynchronizer
from piezo_sim.plant import Plant

DT = 1e-3


def values_of(table: ParameterTable, **changes: Any) -> dict[str, Any]:
    return {**table.defaults(), 'rate': 1.0 / DT, **changes}


def step(law: Any, k: int, error: float) -> float:
    point = ReferencePoint(k, error, 0.0, 0.0, 5.0, 0.0)
    return float(law.step(point, 0.1, Measured(k - 1, 0.0, 0.0)))


def test_gains_of_a_pid_change_in_place_and_its_integral_carries_on() -> None:
    laws, values = FeedbackLaws(), values_of(FEEDBACK, method='pid')
    values |= {'pid.proportional': 0.0, 'pid.integral': 1e4, 'pid.derivative': 0.0}
    law = laws.build(values, DT)
    assert isinstance(law, Pid)
    before = [step(law, k, 1e-6) for k in range(50)][-1]
    assert before > 0.1
    values['pid.integral'] = 0.0
    assert laws.adjust(law, values, ['pid.integral'])
    assert step(law, 50, 1e-6) == pytest.approx(before, rel=0.05)
    assert not laws.adjust(law, values, ['pid.integral', 'limits.high'])


def test_only_parameters_of_the_method_in_force_shape_the_feedback() -> None:
    laws = FeedbackLaws()
    none, pid = (values_of(FEEDBACK, method=method) for method in ('none', 'pid'))
    assert laws.build(none, DT) is None
    assert not laws.shapes(none, 'pid.integral')
    assert laws.shapes(pid, 'pid.integral')
    assert not laws.shapes(pid, 'h_infinity.bandwidth')
    assert laws.shapes(none, 'method')


def test_half_a_plant_is_refused_with_the_reason() -> None:
    values = values_of(FEEDBACK, method='h_infinity', **{'plant.numerator': [1.0]})
    with pytest.raises(CompensationError, match='belong together'):
        FeedbackLaws().build(values, DT)


def test_a_new_gain_of_the_plant_keeps_the_attenuation_and_orders_make_a_new_one() -> None:
    laws, values = HarmonicLaws(), values_of(ATTENUATION)
    law = laws.build(values, DT)
    assert isinstance(law, HarmonicAttenuation)
    values['plant.gain'] = 2.0 * values['plant.gain']
    assert laws.adjust(law, values, ['plant.gain'])
    assert not laws.adjust(law, values, ['plant.gain', 'orders'])
    assert laws.shapes(values, 'orders')
    assert not laws.shapes(values, 'limits.high')
    assert laws.build({**values, 'enabled': False}, DT) is None


def test_a_schedule_makes_a_new_attenuation_and_another_one_is_taken_in_place() -> None:
    values, laws = values_of(ATTENUATION, enabled=True), HarmonicLaws()
    plain = ModelFile.from_name('classical')
    point = OperatingPoint(10.0, 1.0, 1e-4, 0, plain)
    whole = replace(plain, schedule=Schedule((point,)))
    law = laws.build(values, DT, plain)
    assert laws.adjust(law, values, ['plant.gain'], plain)
    assert not laws.adjust(law, values, ['plant.gain'], whole)
    law = laws.build(values, DT, whole)
    assert isinstance(law, ScheduledAttenuation)
    other = replace(whole, schedule=Schedule((replace(point, frequency=23.0),)))
    assert laws.adjust(law, values, ['plant.gain'], other)
    assert not laws.adjust(law, values, ['plant.gain'], plain)
    # a plant by number wins over the model
    values['plant.gain'] = 1e-4
    assert not isinstance(laws.build(values, DT, whole), ScheduledAttenuation)


SPAN = 2.4
GAIN = 1.2e-4
KNOWN = ModeGain(GAIN, 68.0, 0.015, DT)
UNKNOWN = ModeGain(math.inf, dt=DT)
# Smallest amplitude of a sinusoid that is enough, relative to the range of the voltage.
ENOUGH = 0.02


def measured(voltage: FloatArray) -> FloatArray:
    """Return what the simulated bender answers, with its hysteresis, mode, creep and noise [m]."""
    return Plant.from_preset('fdk_pzba_00030', rate=1.0 / DT, seed=3).run(voltage)


def sine(amplitude: float, frequency: float, offset: float = 0.0) -> FloatArray:
    time = DT * np.arange(3000)
    rise = np.minimum(1.0, time / 0.2)
    return np.asarray(rise * (offset + amplitude * np.sin(2 * math.pi * frequency * time)))


def checked(voltage: FloatArray, displacement: FloatArray, plant: ModeGain) -> SensorSign:
    sign = SensorSign(DT)
    sign.expect(plant, SPAN)
    for v, y in zip(voltage.tolist(), displacement.tolist(), strict=True):
        sign.update(v, y)
    return sign


@pytest.mark.parametrize('plant', [KNOWN, UNKNOWN])
@pytest.mark.parametrize('frequency', [0.5, 5.0, 20.0])
@pytest.mark.parametrize('amplitude', [ENOUGH * SPAN, 0.8])
def test_the_sign_is_known(plant: ModeGain, frequency: float, amplitude: float) -> None:
    voltage = sine(amplitude, frequency)
    displacement = measured(voltage)
    right = checked(voltage, displacement, plant)
    assert right.found is Sign.RIGHT
    assert right.may_close()
    wrong = checked(voltage, -displacement, plant)
    assert wrong.found is Sign.REVERSED
    assert not wrong.may_close()
    assert wrong.counters() == {'reversed_sensor': 1, 'still_sensor': 0}


@pytest.mark.parametrize('frequency', [40.0, 68.0, 90.0, 200.0])
def test_no_right_sensor_is_refused_about_a_resonance(frequency: float) -> None:
    """There the displacement is opposite to the voltage, whatever the sensor."""
    voltage = sine(0.1, frequency)
    displacement = measured(voltage)
    for plant in (KNOWN, UNKNOWN):
        assert checked(voltage, displacement, plant).found in (Sign.RIGHT, Sign.UNKNOWN)


@pytest.mark.parametrize('drift', [-1e-6, 1e-6])
def test_a_small_reference_decides_nothing_against_drift(drift: float) -> None:
    voltage = sine(0.1 * ENOUGH * SPAN, 5.0)
    displacement = measured(voltage) + drift * DT * np.arange(voltage.size)
    sign = checked(voltage, displacement, KNOWN)
    assert sign.found is Sign.UNKNOWN
    assert not sign.may_close()  # it waits from when the law first acts
    for _ in range(2001):
        sign.update(0.0, 0.0)
    assert sign.may_close()
    assert not any(sign.counters().values())


def test_a_sensor_that_does_not_follow_is_refused_where_the_gain_is_known() -> None:
    voltage = sine(0.5, 5.0)
    noise = 2e-8 * np.random.default_rng(5).standard_normal(voltage.size)
    assert checked(voltage, noise, KNOWN).found is Sign.STILL
    assert checked(voltage, noise, UNKNOWN).found is not Sign.STILL


def test_a_plant_that_falls_is_expected_to_fall() -> None:
    voltage = sine(0.5, 5.0)
    displacement = measured(voltage)
    falling = KNOWN._replace(gain=-GAIN)
    assert checked(voltage, -displacement, falling).found is Sign.RIGHT
    assert checked(voltage, displacement, falling).found is Sign.REVERSED


def test_another_model_of_the_same_sign_leaves_a_loop_closed() -> None:
    voltage = sine(0.5, 5.0)
    sign = checked(voltage, measured(voltage), KNOWN)
    sign.expect(KNOWN._replace(gain=2.0 * GAIN), SPAN)
    assert sign.may_close()
    sign.expect(KNOWN._replace(gain=-GAIN), SPAN)
    assert not sign.may_close()


@pytest.mark.parametrize('flicker', [0.0, 1e-12])
def test_a_stuck_sensor_is_counted(flicker: float) -> None:
    """Also where the last bit of its float32 flickers."""
    sensor = StuckSensor(DT)
    for k in range(1000):
        voltage = math.sin(2 * math.pi * 5.0 * k * DT)
        sensor.update(voltage, 1e-4 * voltage if k < 500 else 3e-5 + flicker * (k % 2))
    assert 300 < sensor.ticks <= 400


@pytest.mark.parametrize('kind', ['moves', 'rests', 'saturated', 'settles', 'not_a_number'])
def test_a_sound_sensor_is_not(kind: str) -> None:
    sensor = StuckSensor(DT)
    rng = np.random.default_rng(1)
    for k in range(2000):
        voltage = 1.0 + {'moves': math.sin(0.03 * k), 'settles': math.exp(-0.02 * k)}.get(
            kind, 0.0
        )
        noise = 1e-9 * rng.standard_normal() if kind == 'moves' else 0.0
        displacement = math.nan if kind == 'not_a_number' else 1e-4 * voltage + noise
        sensor.update(voltage, displacement)
    assert sensor.ticks == 0


def test_it_is_named_in_the_diagnostics() -> None:
    class Quiet:
        stale, newest = False, 0

    health = LinkHealth(Limits())
    numbers = {'sample': 1, 'active': True}
    found = health.judge(numbers, {'stuck_sensor': 3}, Quiet())  # type: ignore[arg-type]
    assert found.level == Level.ERROR
    assert 'the sensor is stuck' in found.message


LIMITS = Limits(-1.2, 1.2, 2000.0)


def points(count: int, first: int = 0) -> list[ReferencePoint]:
    w = 2 * np.pi * 5.0
    t = (first + np.arange(count)) * DT
    x, v, a = 1e-4 * np.sin(w * t), 1e-4 * w * np.cos(w * t), -1e-4 * w * w * np.sin(w * t)
    return [
        ReferencePoint(first + k, float(x[k]), float(v[k]), float(a[k]), 5.0, 0.0)
        for k in range(count)
    ]


def model(name: str, **values: float) -> ModelFile:
    chosen = named(name)
    usual = {'A1': 1e-4, 'A': 2e-5, 'beta': 0.6, 'gamma': 0.1}
    known = {key: v for key, v in {**usual, **values}.items() if key in chosen.parameter_names}
    return ModelFile(chosen, {**chosen.defaults(), **known})


def test_a_new_chain_takes_over_as_if_it_had_always_been_there() -> None:
    inversion = Inversion(Controllers(DT, LIMITS, start=0.0, transition=0.1))
    assert inversion.voltage(points(1)[0]) is None
    inversion.restart()
    assert inversion.take(model('classical'))
    for point in points(HISTORY - 200):
        inversion.voltage(point)
    assert inversion.take(model('bouc_wen_mode', natural_frequency=70.0, damping_ratio=0.02))
    got = [inversion.voltage(point) for point in points(200, HISTORY - 200)]
    loaded = inversion.loaded
    assert loaded is not None
    fresh = inverse_for(loaded.model, loaded.values, DT, limits=LIMITS, start=0.0)
    expected = [fresh.step(point) for point in points(HISTORY)]
    assert got == expected[-200:]


def test_the_same_chain_goes_over_by_itself() -> None:
    inversion = Inversion(Controllers(DT, LIMITS, start=0.0, transition=0.1))
    inversion.take(model('classical'))
    before = [inversion.voltage(point) for point in points(300)]
    assert not inversion.take(model('classical', A1=1.3e-4))
    after = inversion.voltage(points(1, 300)[0])
    assert after is not None
    assert before[-1] is not None
    assert abs(after - before[-1]) < 0.05


def test_a_model_without_an_inverse_leaves_the_one_before() -> None:
    inversion = Inversion(Controllers(DT, LIMITS, start=0.0, transition=0.1))
    good = model('classical')
    inversion.take(good)
    with pytest.raises(PiezoError):
        inversion.take(model('classical', A1=1e-5))
    assert inversion.loaded is good
    assert inversion.voltage(points(1)[0]) is not None


def test_a_crossfade_begins_at_the_last_share_and_ends_at_the_new_one() -> None:
    fade = CrossFade(DT, 0.05)
    fade.start()
    assert fade.apply(0.5) == 0.5  # nothing to go over from
    fade.start()
    shares = [fade.apply(-1.0) for _ in range(60)]
    assert shares[0] == 0.5
    assert shares[-1] == -1.0
    assert np.all(np.diff(shares) <= 0.0)
    assert np.abs(np.diff(shares)).max() < 1.875 * 1.5 * DT / 0.05 * 1.01


def test_a_book_answers_each_tick_once_in_any_order() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        book: SampleSynchronizer[str] = SampleSynchronizer()
        calls: list[Callable[[], object]] = []
        for k, point in enumerate(points(5)):
            calls += [
                partial(book.add_reference, point),
                partial(book.add_voltage, k, 0.1 * k, 'tag'),
                partial(book.add_measured, Measured(k, 0.0, 1e-6 * k)),
            ]
        # In lock-step nothing of tick k comes before tick k - 1 was answered.
        answered = []
        for k in range(5):
            own = [calls[3 * k], calls[3 * k + 1], *([calls[3 * k - 1]] if k else [])]
            rng.shuffle(own)
            for add in own:
                add()
                while (tick := book.take()) is not None:
                    answered.append(tick)
        assert [tick.point.sample for tick in answered] == list(range(5))
        assert [tick.received for tick in answered] == [0.1 * k for k in range(5)]
        newest = [tick.measured and tick.measured.sample for tick in answered]
        assert newest == [None, 0, 1, 2, 3]


def test_a_book_without_voltages_stays_small() -> None:
    book: SampleSynchronizer[str] = SampleSynchronizer()
    for point in points(3 * LONGEST):
        book.add_reference(point)
        book.add_measured(Measured(point.sample, 0.0, 0.0))
    assert book.waiting <= 2 * LONGEST
    held: SampleSynchronizer[str] = SampleSynchronizer()
    for point in points(3):
        held.add_reference(point)
    for k in range(5):
        held.add_voltage(k, 0.1, 'tag')
    held.add_measured(Measured(0, 0.0, 0.0))
    assert held.waiting == 3 + 5 + 1


def test_each_law_of_a_chain_has_the_plant_of_its_own_parameters() -> None:
    model = ModelFile(named('bouc_wen_mode'), {**named('bouc_wen_mode').defaults(), 'A1': 2e-4})

    def chain(**changes: float) -> Controllers:
        own, feedback = values_of(ATTENUATION), values_of(FEEDBACK, method='h_infinity')
        for name, value in changes.items():
            node, parameter = name.split('_', 1)
            table = {'attenuation': own, 'feedback': feedback}[node]
            table[f'plant.{parameter}'] = value
        values = {'feedforward': values_of(FEEDFORWARD), 'attenuation': own, 'feedback': feedback}
        return chain_settings(values, DT, model)

    def plants(found: Controllers) -> tuple[float, float]:
        modes = found.mode(), found.mode(of_feedback=True)
        assert None not in modes
        return tuple(0.0 if mode is None else mode.gain for mode in modes)  # type: ignore[return-value]

    plain = plants(chain())
    assert plain[0] == plain[1] > 0.0
    assert plants(chain(attenuation_gain=1e-3)) == (1e-3, plain[1])
    assert plants(chain(feedback_gain=1e-3)) == (plain[0], 1e-3)
    assert plants(chain(attenuation_gain=1e-3, feedback_gain=2e-3)) == (1e-3, 2e-3)
