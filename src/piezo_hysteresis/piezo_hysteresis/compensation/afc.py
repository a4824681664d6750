"""Adaptive feedforward cancellation of harmonics by complex gain."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.attenuation_settings import AttenuationSettings
from piezo_hysteresis.compensation.harmonics import (
    Harmonic,
    accumulate,
    folded,
    resonant_orders,
    separable_orders,
    solve_lines,
)
from piezo_hysteresis.compensation.linear_gain import LinearGain

# Weight of what was known of the gain before, against one new observation of it.
_PRIOR_WEIGHT = 0.1
_GAIN_MEMORY = 0.7
# An observation of the gain counts only where the change of the line stands this many deviations
# out of the noise; below it, noise would turn a right gain.
_SIGNIFICANCE = 6.0
# The adapted gain stays within this factor of the modelled magnitude; its phase is free.
_GAIN_RANGE = 8.0
# Relative change of the frequency from one tick to the next that is a step, not a chirp.
_FREQUENCY_STEP = 2e-3
# So many windows of growth in a row are divergence, not the start of a reference.
_RISES = 3


@dataclass
class _Line:
    """One order: its correction theta [V], gain estimate [m/V] and last error [m]."""

    theta: complex = 0j
    error: complex = 0j
    modelled: complex = 0j
    numerator: complex = 0j
    weight: float = 0.0
    moved: complex = 0j
    rises: int = 0
    seen: bool = False

    @property
    def gain(self) -> complex:
        """Gain [m/V] as it is believed now."""
        if self.weight <= 0.0:
            return self.modelled
        estimate = self.numerator / self.weight
        low, high = abs(self.modelled) / _GAIN_RANGE, abs(self.modelled) * _GAIN_RANGE
        size = abs(estimate)
        if size < 1e-300:
            return self.modelled
        return estimate * min(max(size, low), high) / size


class ComplexGainCancellation:
    """Removes chosen orders of the error by sines whose complex gain is found while running.

    In windows locked to the reference's phase, the error of each order, ``Re(E exp(j n phi))``,
    is found by least squares; the correction moves by ``step_size E / G``, and the change that
    follows refines G. A wrong sign, a resonance that has moved or a frequency that steps is
    thereby followed. An error that keeps growing makes the order start anew from 0.

    Parameters
    ----------
    settings : AttenuationSettings
        Method ``afc``.
    gain : callable
        Modelled plant gain [m/V] by frequency [Hz].
    dt : float
        Sampling interval [s].
    """

    def __init__(self, settings: AttenuationSettings, gain: LinearGain, dt: float) -> None:
        self._settings = settings
        self._gain = gain
        self._dt = dt
        self.reset()

    def reset(self) -> None:
        """Forget every correction."""
        self._lines: dict[int, _Line] = {}
        self._mean = _Line()
        self._orders: tuple[int, ...] = ()
        self._fitted: tuple[int, ...] = ()
        self._frequency: float = 0.0
        self._counts: dict[str, int] = {'windows': 0, 'restarts': 0, 'bounded': 0}
        self._drop_window(0.0)

    def update(self, error: float, frequency: float, phase: float) -> None:
        """Take the error y - d [m] at `frequency` [Hz] and accumulated `phase` [rad]."""
        if frequency <= 0.0:
            self._drop_window(0.0)
            return
        if abs(frequency - self._frequency) > _FREQUENCY_STEP * frequency or not self._orders:
            self._drop_window(frequency)
        self._frequency = frequency
        self._ticks += 1
        if self._ticks <= self._skip:
            return
        accumulate(error, phase, self._numbers, self._basis, self._normal)
        if self._ticks >= self._skip + self._length:
            self._close_window()

    def voltage(self, frequency: float, phase: float) -> float:
        """Answer what to subtract from the voltage [V] at `phase` [rad]."""
        total = self._mean.theta.real
        for order in self._orders:
            theta = self._lines[order].theta
            if theta:
                angle = order * phase
                total += theta.real * math.cos(angle) - theta.imag * math.sin(angle)
        return total

    def harmonics(self) -> list[Harmonic]:
        """Return error and correction of every order."""
        rows = [(0, self._mean)] if 0 in self._settings.orders else []
        rows += [(order, self._lines[order]) for order in self._orders]
        return [
            Harmonic(n, abs(w.error), cmath.phase(w.error), abs(w.theta), cmath.phase(w.theta))
            for n, w in sorted(rows, key=lambda row: row[0])
        ]

    def gains(self) -> dict[int, complex]:
        """Return the plant gain [m/V] as it is believed now, by order."""
        return {order: self._lines[order].gain for order in self._orders}

    def counters(self) -> dict[str, int]:
        """Return windows evaluated and orders that were restarted or held at their bound."""
        return dict(self._counts)

    def set_gain(self, gain: LinearGain) -> None:
        """Take a new model of the plant gain; what was found about its error is kept."""
        self._gain = gain
        self._reschedule(self._frequency)

    def _drop_window(self, frequency: float) -> None:
        """Begin a window; choose its length and orders for `frequency`."""
        settings, dt = self._settings, self._dt
        periods = max(1, round(settings.span * frequency)) if frequency > 0 else 0
        self._length = round(periods / (frequency * dt)) if frequency > 0 else 0
        # Nothing has been changed before the first window, so nothing has to settle.
        fresh = self._counts['windows'] == 0 and self._frequency == 0.0
        self._skip = 0 if fresh else max(round(settings.settle / dt), self._length // 2)
        self._ticks = 0
        if frequency > 0:
            self._choose_orders(frequency)
            self._reschedule(frequency)
        self._numbers = np.array(self._fitted, dtype=np.float64)
        m = 1 + 2 * self._numbers.size
        self._basis: FloatArray = np.zeros(m)
        self._normal: FloatArray = np.zeros((m + 1, m + 1))

    def _choose_orders(self, frequency: float) -> None:
        settings, dt = self._settings, self._dt
        wanted = [order for order in settings.orders if order > 0]
        if settings.resonance > 0:
            wanted += resonant_orders(frequency, settings.resonance, dt)
        span = self._length * dt
        separable = separable_orders([*wanted, 1], frequency, dt, span)
        self._orders = tuple(order for order in separable if order in wanted)
        # Neighbours that are strong and not cancelled would leak into a short window.
        neighbours = [8 - order for order in wanted if 8 - order > 0]
        self._fitted = separable_orders([*wanted, 1, *neighbours], frequency, dt, span)

    def _reschedule(self, frequency: float) -> None:
        """Carry each line to `frequency`: the correction stays, the gain moves as modelled."""
        for order in self._orders:
            line = self._lines.setdefault(order, _Line())
            self._remodel(line, self._gain(folded(order * frequency, self._dt)))
            line.rises, line.seen, line.moved = 0, False, 0j
        for order in [order for order in self._lines if order not in self._orders]:
            del self._lines[order]
        self._remodel(self._mean, complex(self._gain(0.0).real))

    @staticmethod
    def _remodel(line: _Line, modelled: complex) -> None:
        if line.modelled and modelled:
            line.numerator *= modelled / line.modelled
        line.modelled = modelled

    def _close_window(self) -> None:
        mean, phasors, deviation = solve_lines(self._normal, self._ticks - self._skip)
        self._counts['windows'] += 1
        if 0 in self._settings.orders:
            self._move(self._mean, complex(mean), deviation)
            self._mean.theta = complex(self._mean.theta.real)
        for order, phasor in zip(self._fitted, phasors, strict=True):
            if order in self._orders:
                self._move(self._lines[order], complex(phasor), deviation)
        self._drop_window_keep_lines()

    def _drop_window_keep_lines(self) -> None:
        """Begin the next window; a chirp may have moved the frequency meanwhile."""
        before = {order: (w.seen, w.moved, w.rises) for order, w in self._lines.items()}
        self._drop_window(self._frequency)
        for order, (seen, moved, rises) in before.items():
            if order in self._lines:
                line = self._lines[order]
                line.seen, line.moved, line.rises = seen, moved, rises

    def _move(self, line: _Line, error: complex, deviation: float) -> None:
        """Refine the gain from what the last step did, then take the next step."""
        settings = self._settings
        if line.seen and line.moved:
            change = error - line.error
            if max(abs(change), abs(line.gain * line.moved)) > _SIGNIFICANCE * deviation:
                if line.weight <= 0.0:
                    line.weight = _PRIOR_WEIGHT * abs(line.moved) ** 2
                    line.numerator = line.modelled * line.weight
                line.numerator = _GAIN_MEMORY * line.numerator - change * line.moved.conjugate()
                line.weight = _GAIN_MEMORY * line.weight + abs(line.moved) ** 2
        grown = line.seen and abs(error) > 1.1 * abs(line.error) + 3.0 * deviation
        line.rises = line.rises + 1 if grown else 0
        line.error, line.seen = error, True
        before = line.theta
        if line.rises >= _RISES:
            self._counts['restarts'] += 1
            line.theta, line.rises, line.weight = 0j, 0, 0.0
        elif line.gain:
            step = settings.step_size * error / line.gain
            size = abs(step)
            if size > settings.largest_step:
                step *= settings.largest_step / size
            line.theta += step
            if abs(line.theta) > settings.largest_correction:
                line.theta *= settings.largest_correction / abs(line.theta)
                self._counts['bounded'] += 1
        line.moved = line.theta - before
