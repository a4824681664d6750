"""Adaptive feedforward cancellation of harmonics by complex gain."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import (
    Harmonic,
    accumulate,
    folded,
    resonant_orders,
    separable_orders,
    solve_lines,
)
from piezo_hysteresis.compensation.harmonics.settings import AttenuationSettings
from piezo_hysteresis.compensation.linear_gain import LinearGain

# What was believed before weighs this much against clear observations, which fade by the memory.
_PRIOR = 0.1
_MEMORY = 0.6
# An observation, or an error, is clear where it stands so many deviations out of the noise.
_SIGNIFICANCE = 4.0
# Share of the changes of all other lines that may show in one line.
_COUPLING = 0.005
# The gain stays within this factor of the modelled magnitude; its phase is free.
_GAIN_RANGE = 8.0
# Relative change of the frequency from one tick to the next that is a step, not a chirp.
_FREQUENCY_STEP = 2e-3
# So many windows of growth in a row, up to what the correction itself does, are divergence.
_RISES = 3
# Orders that are strong in the error of a hysteretic plant, and of an asymmetric one besides.
_STRONG = (1, 2, 3, 5, 7, 9)
_STRONG_EVEN = (6,)


@dataclass
class _Line:
    """One order: its correction theta [V], last error [m] and gain, as modelled times a ratio."""

    theta: complex = 0j
    error: complex = 0j
    modelled: complex = 0j
    ratio: complex = 1.0 + 0j
    weight: float = _PRIOR
    moved: complex = 0j
    rises: int = 0
    seen: bool = False

    @property
    def gain(self) -> complex:
        """Gain [m/V] as it is believed now."""
        return self.modelled * self.ratio

    def observe(self, change: complex, clearness: float) -> None:
        """Learn from the change of the error [m] that followed the last step."""
        if not (self.moved and self.modelled):
            return
        seen = -change / self.moved / self.modelled
        kept = _MEMORY * self.weight
        self.weight = kept + clearness
        ratio = (kept * self.ratio + clearness * seen) / self.weight
        size = abs(ratio)
        if size > 0.0:
            self.ratio = ratio * min(max(size, 1.0 / _GAIN_RANGE), _GAIN_RANGE) / size


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

    def disturb(self) -> None:
        """Begin the window anew and learn nothing from what the last step seemed to do."""
        if self._frequency > 0.0:
            self._drop_window(self._frequency)

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
        # Strong lines that are not cancelled would leak into a short window and pass for noise:
        # what hysteresis makes, and where a plant is so asymmetric that the second is cancelled,
        # its odd multiple. Which even ones are fitted moves the error left by 3 % at most.
        others = (*_STRONG, *(_STRONG_EVEN if 2 in wanted else ()))
        self._fitted = separable_orders([*wanted, *others], frequency, dt, span)

    def _reschedule(self, frequency: float) -> None:
        """Carry each line to `frequency`: the correction stays, the gain moves as modelled."""
        for order in self._orders:
            line = self._lines.setdefault(order, _Line())
            line.modelled = self._gain(folded(order * frequency, self._dt))
            line.rises, line.seen, line.moved = 0, False, 0j
        for order in [order for order in self._lines if order not in self._orders]:
            del self._lines[order]
        self._mean.modelled = complex(self._gain(0.0).real)

    def _close_window(self) -> None:
        mean, phasors, deviation = solve_lines(self._normal, self._ticks - self._skip)
        if not math.isfinite(deviation):  # a window that tells nothing moves nothing
            self._drop_window_keep_lines()
            return
        self._counts['windows'] += 1
        errors = dict(zip(self._fitted, map(complex, phasors), strict=True))
        seen = [(self._lines[order], errors[order]) for order in self._orders]
        if 0 in self._settings.orders:
            seen.append((self._mean, complex(mean)))
        # The hysteresis couples the orders: what one line does may come from the others' moves.
        changes = [abs(error - line.error) if line.seen else 0.0 for line, error in seen]
        total = sum(changes)
        for (line, error), change in zip(seen, changes, strict=True):
            foreign = math.hypot(deviation, _COUPLING * (total - change))
            self._move(line, error, deviation, foreign)
        self._mean.theta = complex(self._mean.theta.real)
        self._drop_window_keep_lines()

    def _drop_window_keep_lines(self) -> None:
        """Begin the next window; a chirp may have moved the frequency meanwhile."""
        before = {order: (w.seen, w.moved, w.rises) for order, w in self._lines.items()}
        self._drop_window(self._frequency)
        for order, (seen, moved, rises) in before.items():
            if order in self._lines:
                line = self._lines[order]
                line.seen, line.moved, line.rises = seen, moved, rises

    def _move(self, line: _Line, error: complex, deviation: float, foreign: float) -> None:
        """Refine the gain from what the last step did, then take the next step."""
        settings = self._settings
        if line.seen:
            change = error - line.error
            expected = max(abs(change), abs(line.gain * line.moved))
            line.observe(change, _clearness(expected, foreign))
        grown = line.seen and abs(error) > 1.1 * abs(line.error) + 3.0 * deviation
        line.rises = line.rises + 1 if grown else 0
        line.error, line.seen = error, True
        before = line.theta
        if line.rises >= _RISES and abs(error) > 0.5 * abs(line.gain * line.theta):
            self._counts['restarts'] += 1
            line.theta, line.rises = 0j, 0
            line.ratio, line.weight = 1.0 + 0j, _PRIOR
        elif line.gain:
            # What may be noise is followed less, so that noise is not fed into the voltage.
            step = settings.step_size * _clearness(abs(error), deviation) * error / line.gain
            size = abs(step)
            if size > settings.largest_step:
                step *= settings.largest_step / size
            line.theta += step
            if abs(line.theta) > settings.largest_correction:
                line.theta *= settings.largest_correction / abs(line.theta)
                self._counts['bounded'] += 1
        line.moved = line.theta - before


def _clearness(size: float, deviation: float) -> float:
    """Return 0..1: how clearly an amplitude stands out of the noise."""
    noise = _SIGNIFICANCE * deviation
    return size**2 / (size**2 + noise**2) if size > 0.0 else 0.0
