"""What the live page draws: nothing hidden by decimation, nothing invented."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.dashboard.live_plots import (
    columns,
    live_spectrum,
    path,
    unbroken_end,
    whole_periods,
)
from piezo_hysteresis.dashboard.live_state import Signals, State


@pytest.mark.parametrize('n', [1, 2, 599, 600, 601, 1201, 5000, 40000])
@pytest.mark.parametrize('first', [0, 7, 123456])
def test_every_extreme_of_every_column_is_drawn(n: int, first: int) -> None:
    values = np.random.default_rng(n).normal(size=n)
    samples, drawn = columns(first, values, 600)
    assert samples.size <= max(2 * 601, n if n <= 1200 else 0)
    assert np.all(np.diff(samples) >= 0)
    np.testing.assert_array_equal(drawn, values[samples - first])  # only points that there are
    width = -(-n // 600)
    for k in range(first // width, (first + n - 1) // width + 1) if width > 2 else ():
        inside = slice(max(k * width - first, 0), (k + 1) * width - first)
        shown = drawn[(samples // width) == k]
        assert shown.min() == values[inside].min()
        assert shown.max() == values[inside].max()


def test_a_spike_of_one_sample_keeps_its_height_while_it_moves() -> None:
    values = np.zeros(30000)
    values[17001] = 3.0
    values[17004] = -2.0
    for shift in range(0, 90, 7):
        samples, drawn = columns(shift, values[shift : shift + 20000], 500)
        assert drawn.max() == 3.0
        assert drawn.min() == -2.0
        assert samples[np.argmax(drawn)] == 17001


def test_the_middle_of_a_moving_window_does_not_shimmer() -> None:
    values = np.random.default_rng(1).normal(size=12000)
    pictures = []
    for shift in (0, 1, 5):
        samples, drawn = columns(shift, values[shift : shift + 10000], 500)
        inside = (samples >= 1000) & (samples < 9000)
        pictures.append((samples[inside], drawn[inside]))
    for samples, drawn in pictures[1:]:
        np.testing.assert_array_equal(samples, pictures[0][0])
        np.testing.assert_array_equal(drawn, pictures[0][1])


def test_lost_samples_break_the_line() -> None:
    values = np.ones(10000)
    values[4000:5000] = np.nan
    samples, drawn = columns(0, values, 100)
    lost = samples[np.isnan(drawn)]
    assert lost.size
    assert lost.min() >= 3900
    assert lost.max() < 5100
    assert np.all(np.isfinite(drawn[(samples < 3900) | (samples >= 5100)]))


def test_no_room_is_refused() -> None:
    with pytest.raises(ValueError, match='at least 1'):
        columns(0, np.zeros(10), 0)


def test_a_loop_keeps_the_extremes_of_both_axes() -> None:
    phase = np.linspace(0.0, 20.0, 30000)
    x, y = np.sin(phase), np.cos(phase)
    x[12345], y[23456] = 5.0, -7.0
    across, up = path(x, y, 1000)
    assert across.size <= 1000
    assert across.max() == 5.0
    assert up.min() == -7.0
    assert up[np.argmax(across)] == y[12345]


def state(sample: int, value: Any = 1.0) -> State:
    return State(sample, sample * 2_000_000, value, 1e-6 * value)


def test_topics_are_joined_by_the_number_of_the_sample() -> None:
    signals = Signals(64)
    signals.add_references([0, 1, 2, 3, 4, 5], [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    signals.add_states([state(k, float(k)) for k in (0, 1, 2, 4)])
    window = signals.window(1.0)
    assert signals.rate == 500.0
    assert (window.first, window.newest) == (0, 4)
    np.testing.assert_array_equal(window.voltage, [0.0, 1.0, 2.0, np.nan, 4.0])
    np.testing.assert_allclose(window.reference, [0.0, 0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(window.error[4], 4e-6 - 0.4)
    assert window.tracked
    assert len(window.last(0.004)) == 2
    assert window.last(0.004).first == 3


def test_old_samples_are_dropped_and_a_restart_clears_all() -> None:
    signals = Signals(64)
    for k in range(500):
        signals.add_states([state(k)])
    window = signals.window(10.0)
    assert window.newest == 499
    assert len(window) == 32
    assert np.all(np.isfinite(window.voltage))
    assert not window.tracked
    signals.add_states([state(0, 3.0), state(1, 3.0)])
    window = signals.window(10.0)
    np.testing.assert_array_equal(window.voltage, [3.0, 3.0])
    assert len(Signals().window(1.0)) == 0


@pytest.mark.parametrize('fundamental', [0.5, 5.0, 7.3, 23.0, 83.3])
def test_harmonics_are_measured_to_a_thousandth(fundamental: float) -> None:
    dt = 1e-3
    turn = 2 * np.pi * fundamental * dt * np.arange(4000)
    true = {1: 50e-6, 2: 0.5e-6, 3: 8e-6, 5: 0.2e-6}
    signal = 7e-6 + sum(a * np.sin(k * turn + k) for k, a in true.items())
    found = live_spectrum(signal, dt, fundamental)
    assert found is not None
    measured = dict(zip(found.orders, found.harmonics, strict=True))
    for order, amplitude in true.items():
        assert measured[order] == pytest.approx(amplitude, abs=1e-3 * 50e-6)
    assert found.amplitude.max() == pytest.approx(50e-6, rel=0.02)


def test_a_spectrum_needs_unbroken_samples() -> None:
    signal = np.sin(0.1 * np.arange(1000))
    signal[600] = np.nan
    assert unbroken_end(signal).size == 399
    signal[-3:] = np.nan
    assert unbroken_end(signal).size == 396
    assert unbroken_end(np.full(5, np.nan)).size == 0
    assert live_spectrum(np.full(500, np.nan), 1e-3, 5.0) is None
    assert live_spectrum(np.zeros(10), 1e-3, 5.0) is None


def test_whole_periods_are_whole() -> None:
    assert whole_periods(4000, 23.0, 1e-3) == 4000
    assert whole_periods(4000, 7.0, 1e-3) == 4000
    assert whole_periods(3999, 10.0, 1e-3) == 3900
    assert whole_periods(50, 10.0, 1e-3) == 50
    assert whole_periods(4000, 0.0, 1e-3) == 4000
