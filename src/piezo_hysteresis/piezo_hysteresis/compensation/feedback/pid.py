"""PID with filtered derivative and anti-windup, Zhou 2021 figure 10, Fang 2019 figure 5."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.feedback.feedback_link import (
    OWN,
    FeedbackLaw,
    FeedbackLink,
    stepping,
)
from piezo_hysteresis.compensation.feedback.feedback_settings import PidGains
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.jit import jit, leaf

__all__ = ['Pid', 'PidGains']

# Places in the memory of the law: integral [V], filtered slope of the error [m/s], the last error
# [m] and whether there was one.
_INTEGRAL, SLOPE, _LAST, _STARTED = range(4)
PID_SIZE = 4
# Places in the parameters, in the order of `PidGains`.
PROPORTIONAL, INTEGRAL, _DERIVATIVE, _FILTER, _TRACKING = range(5)
GAINS = 5


@leaf
def pid(
    error: float,
    proportional: float,
    integral: float,
    memory: FloatArray,
    p: FloatArray,
    dt: float,
) -> float:
    """Return the share of the voltage [V] by gains that may differ from those in `p`."""
    last = memory[_LAST] if memory[_STARTED] > 0.0 else error
    memory[_INTEGRAL] += 0.5 * dt * integral * (error + last)
    twice = 2.0 * p[_FILTER]
    memory[SLOPE] = ((twice - dt) * memory[SLOPE] + 2.0 * (error - last)) / (twice + dt)
    memory[_LAST], memory[_STARTED] = error, 1.0
    return float(proportional * error + memory[_INTEGRAL] + p[_DERIVATIVE] * memory[SLOPE])


@leaf
def plain(error: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
    """Return the share of the voltage [V]."""
    return pid(error, p[PROPORTIONAL], p[INTEGRAL], memory, p, dt)


@leaf
def hold(memory: FloatArray, p: FloatArray) -> float:
    """Return the share without a measurement: the integral [V]."""
    return float(memory[_INTEGRAL])


@leaf
def cut(excess: float, memory: FloatArray, p: FloatArray, dt: float) -> None:
    """Anti-windup: let the integral follow the limited voltage [V]."""
    memory[_INTEGRAL] += excess * min(1.0, dt / p[_TRACKING])


@jit
def take_gains(memory: FloatArray, before: float, proportional: float) -> None:
    """Bumpless change of the proportional gain: the integral compensates it."""
    if memory[_STARTED] > 0.0:
        memory[_INTEGRAL] += (before - proportional) * memory[_LAST]


LAW = FeedbackLaw(plain, hold, cut)


class Pid(FeedbackLink):
    """PID feedback as a link of the chain, Fang 2019 (PID).

    The integral is trapezoidal; the derivative is of the error, behind a first-order low-pass by
    the bilinear rule. Gains may be changed while running without a jump: the integral is kept in
    volts.

    Parameters
    ----------
    gains : PidGains
        The gains.
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        As in `FeedbackLink`.
    """

    kernel = staticmethod(stepping(LAW))

    def __init__(self, gains: PidGains, dt: float, *, limits: Limits | None = None) -> None:
        super().__init__(dt, limits, PID_SIZE)
        self._gains = gains
        self.packed = self._pack()

    @property
    def gains(self) -> PidGains:
        """Gains in force."""
        return self._gains

    def set_gains(self, gains: PidGains) -> None:
        """Change the gains without a jump; the integral compensates the difference."""
        take_gains(self.memory[OWN:], float(self._gains.proportional), float(gains.proportional))
        self._gains = gains
        self.packed[:] = self._pack()

    def _pack(self) -> FloatArray:
        return np.array(astuple(self._gains), dtype=np.float64)
