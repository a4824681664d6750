"""No experiment ever exceeds what its user allows, whatever that is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from piezo_hysteresis.experiments.planned_experiment import (
    ExperimentLimits,
    InvestigationError,
    catalogue,
)
from piezo_hysteresis.runtime.sweep_plan import Sweep

RANGES = st.sampled_from([(-1.0, 1.0), (0.0, 150.0), (-30.0, 150.0), (-0.2, 7.5), (-10.0, 0.0)])


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    ends=RANGES,
    slews=st.floats(2.0, 5000.0),
    highest=st.floats(0.6, 400.0),
    heat=st.floats(0.05, 500.0),
    rate=st.sampled_from([500.0, 1000.0, 4000.0]),
)
def test_no_voltage_slew_frequency_or_heat_beyond_the_limits(
    ends: Any, slews: Any, highest: Any, heat: Any, rate: Any
) -> None:
    low, high = ends
    amplitude = 0.5 * (high - low)
    limits = ExperimentLimits(low, high, slews * amplitude, highest, heat=heat * amplitude**2)
    try:
        experiments = catalogue(limits, rate)
    except InvestigationError:
        assume(False)
    for each in experiments:
        voltage = each.voltage(rate)
        # as the excitation runs it: the record, and the way back to rest behind it
        sweep = Sweep([each.frequency], [each.amplitude], each.seconds, rate, waveform='sequence',
                      options={'parts': each.spec['parts']})  # fmt: skip
        np.testing.assert_array_equal(sweep.records[0].voltages, voltage)
        sweep.start(0)
        driven = np.array([sweep.voltage(k) for k in range(sweep.length + 1)])
        slack = 1e-9 * (high - low)
        assert driven.min() >= low - slack
        assert driven.max() <= high + slack
        change = np.abs(np.diff(driven, prepend=0.0, append=0.0)).max() * rate
        assert change <= limits.slew * (1.0 + 1e-9)
        assert each.frequency <= highest
        moved = np.abs(np.diff(voltage)) * np.abs(0.5 * (voltage[1:] + voltage[:-1]))
        assert moved.sum() / (2.0 * each.seconds) <= limits.heat * (1.0 + 1e-3)


def test_the_heat_of_a_sine_is_frequency_times_amplitude_squared() -> None:
    from piezo_hysteresis.experiments.planned_experiment import heat_of

    time = np.arange(10_000) / 10_000.0
    assert np.isclose(heat_of(3.0 * np.sin(2 * np.pi * 20.0 * time), 1e-4), 180.0, rtol=1e-3)
