"""Laws that are kernels answer what the plain recursions of their papers do, to the last bit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.compensation.harmonics.repetitive import (
    OddRepetitive,
    RepetitiveSettings,
    mode_cancelling,
)
from piezo_hysteresis.compensation.inverses.frequency_switch import FrequencySwitch
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.sensor_guard import SensorWatch
from piezo_hysteresis.compensation.transition import CrossFade, Transition
from piezo_hysteresis.models import named
from piezo_hysteresis.numerics.smooth import smooth_step

DT = 1e-3
LIMITS = Limits(-1.2, 1.2, 200.0)
TAPS = (-0.0625, 0.25, 0.625, 0.25, -0.0625)


def walk(rng: np.random.Generator, ticks: int) -> Iterator[Any]:
    """Return points whose frequency changes, with measurements late or missing at times."""
    phase = 0.0
    frequency = 0.3
    for k in range(ticks):
        if rng.random() < 0.01:
            frequency = float(rng.choice([0.0, 0.3, 0.7, 1.0, 3.0, 23.0, 90.0]))
        phase += 2.0 * math.pi * frequency * DT
        w = 2.0 * math.pi * frequency
        d = 4e-5 * math.sin(phase)
        point = ReferencePoint(k, d, 4e-5 * w * math.cos(phase), -d * w * w, frequency, phase)
        late = int(rng.integers(1, 4))
        measured = Measured(k - late, 0.1, float(d + 1e-6 * rng.standard_normal()))
        yield point, measured if k >= late and rng.random() > 0.05 else None


def chosen_by_hand(
    slow: Any, fast: Any, border: Any, transition: float, points: list[Any]
) -> Iterator[float]:
    """Return what two links and a transition give, one object each."""
    change, before = Transition(DT, transition, LIMITS.slew), None
    for k, (point, measured) in enumerate(points):
        received = 0.01 * (k % 3)
        voltages = [link.step(point, received, measured) for link in (slow, fast)]
        now = point.frequency > border
        if before is not None and now != before:
            change.start()
        before = now
        yield received + change.apply(voltages[now] - received)


@given(seed=st.integers(0, 2**32 - 1), border=st.sampled_from([0.5, 1.0, 10.0]))
@settings(max_examples=10)
def test_the_switch_between_slow_and_fast_models_has_the_bits_of_its_parts(
    seed: Any, border: Any
) -> None:
    points = list(walk(np.random.default_rng(seed), 1500))

    def links() -> list[Any]:
        return [
            inverse_for(named(name), named(name).defaults(), DT, limits=LIMITS)
            for name in ('classical', 'bouc_wen_mode')
        ]

    slow, fast = links()
    link = FrequencySwitch(slow, fast, border, DT, transition=0.1, limits=LIMITS)
    ours = [link.step(p, 0.01 * (k % 3), m) for k, (p, m) in enumerate(points)]
    slow, fast = links()
    assert ours == list(chosen_by_hand(slow, fast, border, 0.1, points))
    first = ours[:200]
    link.reset()
    assert [link.step(p, 0.01 * (k % 3), m) for k, (p, m) in enumerate(points[:200])] == first


def recalled(ring: list[float], newest: Any, back: Any) -> float:
    """Return a ring some samples ago, low-passed, cubic between samples."""
    whole = int(np.floor(back))
    t = back - whole
    weights = (
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    )
    total = 0.0
    for i, tap in enumerate(TAPS):
        place = newest - whole + i - 2
        a, b, c, d = (float(ring[(place + j) % len(ring)]) for j in (1, 0, -1, -2))
        total += tap * (weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d)
    return total


def repeated_by_hand(s: RepetitiveSettings, points: list[Any]) -> Iterator[float]:
    """Return odd repetitive control written out over dictionaries of Python's own numbers."""
    size = int(0.5 / (s.lowest_frequency * DT)) + 16
    learned, errors, past = [0.0] * size, [0.0] * size, (0.0, 0.0, 0.0, 0.0)
    b0, b1, b2, a1, a2 = mode_cancelling(s, DT)
    watch = SensorWatch(DT)
    for point, measured in points:
        pair = watch.pair(point, measured)
        errors[point.sample % size] = 0.0
        if pair is not None:
            partner, displacement = pair
            error = partner.displacement - displacement
            e1, e2, v1, v2 = past
            value = b0 * error + b1 * e1 + b2 * e2 - a1 * v1 - a2 * v2
            past = (error, e1, value, v1)
            errors[partner.sample % size] = value
        voltage = 0.0
        if point.frequency >= s.lowest_frequency:
            half = 0.5 / (point.frequency * DT)
            if half > 6:
                before = recalled(learned, point.sample, half)
                lead = min(s.lead_ticks, half - 4.0)
                error = recalled(errors, point.sample, half - lead)
                voltage = -(before + s.learning * error)
        learned[point.sample % size] = voltage
        yield 0.1 + voltage


@given(
    seed=st.integers(0, 2**32 - 1),
    frequency=st.sampled_from([0.0, 68.0, 300.0]),
    lead=st.floats(0.0, 30.0),
)
@settings(max_examples=10)
def test_repetitive_control_has_the_bits_of_its_recursion(
    seed: Any, frequency: Any, lead: Any
) -> None:
    points = list(walk(np.random.default_rng(seed), 1500))
    chosen = RepetitiveSettings(115e-6, frequency, 0.015, lead_ticks=lead)
    law = OddRepetitive(chosen, DT)
    ours = [law.step(point, 0.1, measured) for point, measured in points]
    assert ours == list(repeated_by_hand(chosen, points))
    law.reset()
    assert [law.step(point, 0.1, measured) for point, measured in points[:99]] == ours[:99]


@given(
    shares=st.lists(st.floats(-2.0, 2.0), min_size=5, max_size=80),
    starts=st.sets(st.integers(0, 80)),
    duration=st.sampled_from([0.0, 0.004, 0.05]),
)
def test_a_crossfade_has_the_bits_of_its_formula(shares: Any, starts: Any, duration: Any) -> None:
    fade, elapsed, before, last = CrossFade(DT, duration), None, 0.0, None
    for k, raw in enumerate(shares):
        if k in starts:
            fade.start()
            if last is not None:
                before, elapsed = last, 0
        last = raw
        if elapsed is not None:
            done = elapsed * DT / max(duration, DT)
            last = before + smooth_step(done)[0] * (raw - before)
            elapsed = None if done >= 1.0 else elapsed + 1
        assert fade.apply(raw) == last
