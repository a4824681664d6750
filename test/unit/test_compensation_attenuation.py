"""Harmonics of the error are taken away, and nothing worse happens when things go wrong."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.node_sheet import Level
from piezo_hysteresis.common.parameter_table import specs_of
from piezo_hysteresis.compensation.controllers import UNKNOWN_PLANT
from piezo_hysteresis.compensation.harmonics import harmonic_rls
from piezo_hysteresis.compensation.harmonics.afc import gains
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    OWN,
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.harmonics.lines import (
    Harmonic,
    fill_resonant,
    fill_separable,
    folded,
)
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import Limits, Measured
from piezo_hysteresis.compensation.offline_loop import (
    LoopResult,
    ModelPlant,
    closed_loop,
    reference_points,
    tracking_metrics,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.named import named
from piezo_hysteresis.numerics.harmonics import line_amplitudes
from piezo_hysteresis.parameters.links import ATTENUATION
from piezo_hysteresis.runtime.laws import HarmonicLaws
from piezo_hysteresis.runtime.link_health import LinkHealth, Watchdog
from piezo_hysteresis.waveforms import Sine
from piezo_hysteresis.waveforms.waveform import Samples

DT = 1e-3
LIMITS = Limits(-3.0, 3.0, 1e4)
VALUES = {'A1': 150e-6, 'A': 40e-6, 'A0': 0.0, 'beta': 1.0, 'gamma': 0.1, 'offset': 6e-6,
          'natural_frequency': 68.0, 'damping_ratio': 0.015}  # fmt: skip
GAIN = ModeGain(115e-6, 68.0, 0.015, DT)
# Two windows, of which the error must be the same before afc begins [s].
STARTED = 0.4


class Proportional:
    """Feedforward without any model."""

    def step(self, point: Any, received: Any, measured: Any = None) -> Any:
        return received + point.displacement / 125e-6

    def reset(self) -> None:
        pass

    def counters(self) -> dict[Any, Any]:
        return {}


class Late:
    """Switches a link on after some seconds."""

    def __init__(self, link: HarmonicAttenuation, seconds: Any) -> None:
        self.link, self.begin = link, seconds

    def step(self, point: Any, received: Any, measured: Any = None) -> Any:
        if point.sample * DT < self.begin:
            return received
        return self.link.step(point, received, measured)

    def reset(self) -> None:
        self.link.reset()

    def counters(self) -> dict[str, int]:
        return self.link.counters()


def plant(**changes: Any) -> ModelPlant:
    return ModelPlant(named('bouc_wen_mode'), {**VALUES, **changes}, DT, noise=20e-9, seed=1)


def sine(frequency: float, seconds: Any, amplitude: float = 125e-6) -> Samples:
    time = np.arange(round(seconds / DT)) * DT
    return Sine(amplitude, frequency, seconds, ramp=1.0).sample(time)


def amplitude(result: LoopResult, order: int, begin: Any, end: Any) -> Any:
    part = slice(round(begin / DT), round(end / DT))
    _, phasors = line_amplitudes(result.error[part], result.phase[part], (1, 3, 5))
    return abs(phasors[(1, 3, 5).index(order)])


def run(
    frequency: float,
    settings: AttenuationSettings,
    gain: Any = GAIN,
    begin: float = 4.0,
    seconds: float = 9.0,
    **changes: Any,
) -> Any:
    """Return amplitude before the link is switched on, ratio at the end, seconds to 10 %."""
    order = settings.orders[-1]
    link = HarmonicAttenuation(settings, gain, DT)
    result = closed_loop(
        sine(frequency, seconds), [Proportional(), Late(link, begin)], plant(**changes), LIMITS, DT
    )
    before = amplitude(result, order, begin - 1.0, begin)
    window = 3.0 / frequency
    times = np.arange(begin, seconds - window, 0.05)
    course = np.array([amplitude(result, order, t - window / 2, t + window / 2) for t in times])
    above = np.flatnonzero(course > 0.1 * before)
    settled = 0.05 * (above[-1] + 1) if above.size else 0.0
    end = amplitude(result, order, seconds - 1.0, seconds)
    return before, end / before, settled, link


@pytest.mark.parametrize('frequency', [14.0, 18.0, 22.0, 23.0, 24.0, 28.0])
def test_afc_reaches_a_tenth_a_second_after_the_start_has_settled(frequency: float) -> None:
    order = 5 if frequency == 14.0 else 3
    _, ratio, settled, _ = run(frequency, AttenuationSettings(orders=(order,)))
    assert settled <= STARTED + 1.0
    assert ratio < 10 ** (-40 / 20)


@pytest.mark.component
@pytest.mark.parametrize('frequency', [14.0, 22.0, 23.0, 28.0])
def test_afc_finds_a_wrong_sign_two_seconds_after_the_start_has_settled(frequency: float) -> None:
    order = 5 if frequency == 14.0 else 3
    wrong = ModeGain(-115e-6, 68.0, 0.015, DT)
    _, ratio, settled, _ = run(frequency, AttenuationSettings(orders=(order,)), wrong)
    assert settled <= STARTED + 2.0
    assert ratio < 10 ** (-40 / 20)


def test_afc_finds_a_resonance_that_has_moved() -> None:
    settings = AttenuationSettings(orders=(3,))
    moved = ModeGain(115e-6, 70.0, 0.015, DT)
    _, ratio, settled, link = run(23.0, settings, moved)
    assert settled <= 2.2
    assert ratio < 1e-2
    found = gains(link.memory[OWN:])[3]
    assert found / GAIN(69.0) == pytest.approx(1.0, abs=0.35)


# Gain, natural frequency and damping ratio as multiples of the true ones; then nothing known.
STARTS = [
    (1, 1, 1), (0.3, 1, 1), (3, 1, 1), (1, 0.3, 1), (1, 3, 1), (1, 1, 0.3), (1, 1, 3), (-1, 1, 1),
    (0.3, 0.3, 0.3), (3, 3, 3), (-0.3, 3, 1), (-3, 0.3, 3), None,
]  # fmt: skip


def rms(error: FloatArray, begin: Any, end: Any) -> float:
    return float(np.sqrt(np.mean(error[round(begin / DT) : round(end / DT)] ** 2)))


@pytest.mark.parametrize('start', STARTS, ids=str)
def test_afc_settles_from_a_wrong_plant_and_never_does_much_harm(start: Any) -> None:
    values = AttenuationSettings()
    if start is None:
        gain, values = ModeGain(1e-4, dt=DT), replace(values, first_step=UNKNOWN_PLANT)
    else:
        gain = ModeGain(115e-6 * start[0], 68.0 * start[1], 0.015 * start[2], DT)
    link = HarmonicAttenuation(values, gain, DT)
    time = np.arange(10000.0) * DT
    wanted = Sine(60e-6, 23.0, 10.0, ramp=0.5).sample(time)
    error = closed_loop(wanted, [Proportional(), link], plant(), LIMITS, DT).error
    alone = closed_loop(wanted, [Proportional()], plant(), LIMITS, DT).error
    before = rms(alone, 3.0, 4.0)
    assert before > 10e-6
    assert rms(error, 9.0, 10.0) < 0.02 * before
    worst = max(rms(error, t, t + 0.25) for t in np.arange(0.0, 9.5, 0.25))
    assert worst < 3.5 * max(before, rms(alone, 0.0, 1.0))


def test_a_correction_that_increases_the_error_fades_out_with_a_message() -> None:
    settings = AttenuationSettings(method='rls', orders=(3,), forgetting=0.998)
    wrong = ModeGain(-115e-6, 68.0, 0.015, DT)
    link = HarmonicAttenuation(settings, wrong, DT)
    result = closed_loop(
        sine(23.0, 24.0), [Proportional(), Late(link, 4.0)], plant(), LIMITS, DT
    )  # fmt: skip
    before = rms(result.error, 3.0, 4.0)
    counts = link.counters()
    assert counts['backed_off'] >= 2  # it tries again, and again in vain
    quiet = [rms(result.error, t, t + 0.5) for t in np.arange(5.0, 23.5, 0.5)]
    assert sum(each < 1.1 * before for each in quiet) > len(quiet) / 3
    watchdog = Watchdog(Limiter(LIMITS, DT), 50, 0.0, 1.0)
    finding = LinkHealth(Limits()).judge({'sample': 1, 'active': True}, {'faded_out': 1}, watchdog)
    assert finding.level == Level.ERROR
    assert 'larger' in finding.message


def test_a_larger_error_that_is_not_its_doing_leaves_the_correction_in_force() -> None:
    link = HarmonicAttenuation(AttenuationSettings(method='rls', orders=(3,)), GAIN, DT)
    disturbed = [
        point._replace(
            displacement=point.displacement + (20e-6 if k % 9 < 4 else 0.0) * (k > 8000)
        )
        for k, point in enumerate(reference_points(sine(23.0, 16.0)))
    ]
    closed_loop(disturbed, [Proportional(), link], plant(), LIMITS, DT)
    counts = link.counters()
    assert counts['backed_off'] == 0
    assert counts['faded_out'] == 0
    assert link.harmonics()[0].correction_amplitude > 0.005


@pytest.mark.component
@pytest.mark.parametrize(
    ('frequency', 'fit'),
    [
        (18.0, 'recursion'),
        (22.0, 'recursion'),
        (24.0, 'recursion'),
        (18.0, 'sines'),
        (24.0, 'sines'),
    ],
)
def test_rls_with_the_computed_factor_attenuates_by_its_loop_gain(
    frequency: Any, fit: Any
) -> None:
    strength = 1.0 / 60e-6
    settings = AttenuationSettings(
        method='rls', orders=(3,), fit=fit, gain=strength, forgetting=0.9998
    )
    _, ratio, _, link = run(frequency, settings, begin=4.0, seconds=24.0)
    kappa = abs(harmonic_rls.kappa(3 * frequency, link.memory[OWN:], link.packed, DT))
    predicted = 1.0 / (1.0 + strength * kappa * abs(GAIN(3 * frequency)))
    assert 20 * math.log10(ratio / predicted) == pytest.approx(0.0, abs=3.0)
    assert ratio < 0.7


def test_the_printed_sign_rule_with_a_plain_sine_fit_does_harm_and_is_faded_out() -> None:
    settings = AttenuationSettings(method='rls', orders=(3,), fit='sines', sign_rule='printed')
    _, ratio, _, link = run(24.0, settings)
    counts = link.counters()
    assert counts['bounded'] > 0  # it drives to the bound
    assert counts['backed_off'] > 0
    assert ratio < 1.5
    assert link.harmonics()[0].correction_amplitude <= 0.5 + 1e-12


def test_several_orders_and_the_mean_at_once() -> None:
    settings = AttenuationSettings(
        orders=(0, 1, 3), resonance=68.0, settle=0.4, span=0.4, step_size=0.6
    )
    link = HarmonicAttenuation(settings, GAIN, DT)
    wanted = sine(14.0, 12.0)
    open_loop = closed_loop(wanted, [Proportional()], plant(), LIMITS, DT)
    result = closed_loop(wanted, [Proportional(), link], plant(), LIMITS, DT)
    before, after = (tracking_metrics(each, 9.0) for each in (open_loop, result))
    assert before.rms > 10e-6
    assert abs(after.mean) < 10e-9
    assert after.rms < 0.2e-6
    assert 5 in [line.order for line in link.harmonics()]


def test_frequency_steps_are_followed() -> None:
    parts, phase = [], 0.0
    for frequency in (22.0, 23.0, 24.0):
        time = np.arange(5000.0) * DT
        wave = Sine(125e-6, frequency, 5.0, phase=phase).sample(time)
        phase += 2 * np.pi * frequency * 5.0
        parts.append(wave)
    wanted = Samples(*(np.concatenate(each) for each in zip(
        *((p.value, p.velocity, p.acceleration, p.frequency, p.phase) for p in parts),
        strict=True)))  # fmt: skip
    link = HarmonicAttenuation(AttenuationSettings(orders=(3,)), GAIN, DT)
    result = closed_loop(wanted, [Proportional(), link], plant(), LIMITS, DT)
    for end in (5.0, 10.0, 15.0):
        assert amplitude(result, 3, end - 2.0, end) < 0.3e-6


def test_a_measurement_that_is_old_is_compared_with_the_reference_of_its_tick() -> None:
    link = HarmonicAttenuation(AttenuationSettings(orders=(3,)), GAIN, DT)
    actuator = plant()
    late: list[Measured] = []
    errors = []
    for point in reference_points(sine(23.0, 8.0)):
        measured = late[-6] if len(late) >= 6 else None
        voltage = link.step(point, point.displacement / 125e-6, measured)
        y = actuator.exchange(voltage)
        late.append(Measured(point.sample, voltage, y))
        errors.append(y - point.displacement)
    phase = sine(23.0, 8.0).phase[-2000:]
    _, phasors = line_amplitudes(np.array(errors[-2000:]), phase, (1, 3))
    assert abs(phasors[1]) < 0.3e-6


@pytest.mark.parametrize('fault', ['lost', 'frozen', 'not_a_number'])
def test_the_correction_is_kept_while_the_sensor_fails(fault: str) -> None:
    link = HarmonicAttenuation(AttenuationSettings(orders=(3,)), GAIN, DT)
    actuator, measured, held = plant(), None, 0.0
    learned: list[Harmonic] = []
    for point in reference_points(sine(23.0, 8.0)):
        voltage = link.step(point, point.displacement / 125e-6, measured)
        y = actuator.exchange(voltage)
        if point.sample < 4000:
            held = y
        elif point.sample == 4100:
            learned = link.harmonics()
        measured = Measured(point.sample, voltage, y)
        if point.sample >= 4000:
            bad = {'lost': None, 'frozen': held, 'not_a_number': math.nan}[fault]
            measured = None if bad is None else Measured(point.sample, voltage, bad)
    counters = link.counters()
    name = {'lost': 'missing', 'frozen': 'frozen', 'not_a_number': 'not_finite'}[fault]
    assert counters[name] > 3000
    if fault != 'frozen':  # the first readings of a frozen sensor are not yet known to be so
        assert link.harmonics() == learned
    assert link.harmonics()[0].correction_amplitude == pytest.approx(
        learned[0].correction_amplitude, rel=0.05
    )


def test_nothing_is_subtracted_where_the_reference_has_no_fundamental() -> None:
    link = HarmonicAttenuation(AttenuationSettings(orders=(3,)), GAIN, DT)
    time = np.arange(500) * DT
    flat = Samples(*(np.zeros(500) for _ in range(5)))
    result = closed_loop(flat, [link], plant(), LIMITS, DT)
    assert not result.voltage.any()
    assert time.size == 500


def resonant(frequency: float, natural_frequency: float) -> list[float]:
    orders = np.empty(6)
    return list(orders[: fill_resonant(frequency, natural_frequency, DT, 75, orders)])


def test_orders_are_chosen_by_the_resonance_and_its_images() -> None:
    assert resonant(14.0, 68.0)[0] == 5
    assert resonant(23.0, 68.0)[0] == 3
    assert 19 in resonant(49.0, 68.0)
    assert folded(19 * 49.0, DT) == pytest.approx(-69.0)
    assert resonant(0.0, 68.0) == []


def test_orders_whose_images_coincide_are_not_fitted_together() -> None:
    # 3 x 50 Hz and 17 x 50 Hz are the same samples at 1 kHz; 20 x 50 Hz is the mean.
    kept = np.empty(4)
    count = fill_separable(np.array([3.0, 17.0, 20.0, 5.0]), 50.0, DT, 0.5, kept)
    assert list(kept[:count]) == [3, 5]


def test_gain_of_a_mode() -> None:
    mode = ModeGain(110e-6, 68.0, 0.015, DT)
    assert mode(0.0) == pytest.approx(110e-6)
    assert abs(mode(68.0)) == pytest.approx(110e-6 / 0.03, rel=1e-6)


@pytest.mark.parametrize(
    'wrong',
    [
        {'method': 'magic'},
        {'orders': (3, -2)},
        {'step_size': 0.0},
        {'gain': math.nan},
        {'forgetting': 0.5},
        {'sign_rule': 'maybe'},
        {'method': 'rls', 'orders': (0, 3)},
        {'method': 'rls', 'orders': (3,), 'resonance': 68.0},
    ],
)
def test_impossible_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(CompensationError) as refused:
        AttenuationSettings(**wrong)
    assert len(str(refused.value).splitlines()) == 1
    assert list(wrong)[-1] in str(refused.value) or 'method' in str(refused.value)


def test_there_is_one_default_of_the_attenuation() -> None:
    one = AttenuationSettings()
    table = ATTENUATION.defaults()
    for field in fields(one):
        value = getattr(one, field.name)
        assert table[field.name] == (list(value) if isinstance(value, tuple) else value)
    for name in (spec.name for spec in specs_of(AttenuationSettings)):
        assert f'    {name} : ' in (AttenuationSettings.__doc__ or '')


def test_what_a_method_ignores_is_refused_by_the_table_of_the_node() -> None:
    changes = {'method': 'rls'}
    for orders in ([0, 3], [-1, 3]):
        refusal = ATTENUATION.judge(ATTENUATION.defaults(), {**changes, 'orders': orders})
        assert 'order 0' in refusal
    assert ATTENUATION.judge(ATTENUATION.defaults(), {**changes, 'orders': [3]}) == ''
    # order -1 is that of a schedule, which only the model shows
    with pytest.raises(CompensationError, match='by number'):
        HarmonicLaws().build({**ATTENUATION.defaults(), **changes}, 1e-3)
    resonant = {**changes, 'orders': [3], 'resonance': 68.0}
    assert 'set resonance to 0' in ATTENUATION.judge(ATTENUATION.defaults(), resonant)
