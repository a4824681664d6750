"""Whatever comes in, what goes out is finite, in range, and no faster than allowed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.compensation.inverses.physical import ExtendedInverse, PhysicalInverse
from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
from piezo_hysteresis.compensation.link import Limits, ReferencePoint

DT = 1e-3
anything = st.floats(allow_nan=True, allow_infinity=True)
moderate = st.floats(-1e-3, 1e-3)


@given(st.lists(anything, max_size=60), st.floats(-5.0, 0.0), st.floats(0.1, 5.0))
def test_limiter_is_safe_for_any_input(voltages: Any, low: Any, high: Any) -> None:
    limiter = Limiter(Limits(low, high, 300.0), DT)
    last = limiter.voltage
    for voltage in voltages:
        safe = limiter.apply(voltage)
        assert math.isfinite(safe)
        assert low <= safe <= high
        assert abs(safe - last) <= 0.3 + 1e-12
        last = safe


@given(
    st.lists(anything, max_size=200),
    st.floats(1e-9, 10.0),
    st.floats(1e-9, 1e-3),
    st.floats(0.011, 10.0),
    st.lists(st.sampled_from([1e-3, 0.1, 7.0]), max_size=3),
)
def test_mean_power_never_exceeds_its_limit(
    voltages: Any, power: Any, capacitance: Any, window: Any, later: Any
) -> None:
    limits, low = Limits(-2.0, 3.0, 1e9), power
    energy = EnergyLimits(power, capacitance, window, 5.0)
    limiter = Limiter(limits, DT, energy=energy)
    for k, voltage in enumerate(voltages):
        if later and k % 50 == 49:
            low = power * later.pop()
            limiter.retune(limits, EnergyLimits(low, capacitance, window, 5.0))
        before, mean = limiter.voltage, limiter.mean_power
        safe = limiter.apply(voltage)
        assert -2.0 <= safe <= 3.0
        # Above a limit that was lowered it can only fall.
        assert limiter.mean_power <= max(low * (1 + 1e-9), mean)
        spent = 0.5 * capacitance * 5.0 * abs(safe - before) / DT
        expected = mean + DT / window * (spent - mean)
        assert abs(limiter.mean_power - expected) <= 1e-9 * (mean + spent) + 1e-300


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(anything, anything, anything), min_size=1, max_size=40))
def test_inverse_answers_a_finite_voltage_in_range_for_any_reference(rows: Any) -> None:
    values = {'A1': 150e-6, 'A': 40e-6, 'beta': 1.0, 'gamma': 0.1, 'offset': 6e-6}
    limits = Limits(-1.0, 1.0)
    links = [
        ExtendedInverse({**values, 'c1': 0.47, 'c2': -0.79}, DT, limits=limits),
        PhysicalInverse(
            {**values, 'natural_frequency': 68.0, 'damping_ratio': 0.015}, DT, limits=limits
        ),
    ]
    for k, (d, v, a) in enumerate(rows):
        for link in links:
            voltage = link.step(ReferencePoint(k, d, v, a, 0.0, 0.0))
            assert -1.0 <= voltage <= 1.0


@settings(max_examples=60, deadline=None)
@given(
    st.floats(20e-6, 300e-6),
    st.floats(0.0, 0.9),
    st.floats(0.05, 5.0),
    st.floats(-0.9, 0.9),
    st.lists(moderate, min_size=5, max_size=80),
)
def test_exact_inverse_undoes_the_model_wherever_the_slope_is_positive(
    a1: Any, a: Any, beta: Any, gamma: Any, path: Any
) -> None:
    from piezo_hysteresis.compensation.inverses.physical import least_slope
    from piezo_hysteresis.models.named import named

    values = {'A1': a1, 'A': a * a1, 'A0': 0.0, 'beta': beta, 'gamma': gamma * beta}
    if least_slope(values) < 0.15 * a1:
        return
    link = PhysicalInverse(values, DT, start=0.0)
    model = named('classical')
    wanted = np.array(path)
    answer = model.respond(link.respond(wanted), model.pack({**values, 'offset': 0.0}), DT)
    np.testing.assert_allclose(answer, wanted, atol=1e-12)
    assert link.counters()['clamped_slopes'] == 0
