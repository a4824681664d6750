"""Switch between a feedforward for slow and one for fast drives; Fang et al. 2019 use 1 Hz."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.inverses import inverse_link
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, Run
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.sensor_guard import FREQUENCY, POINT_SIZE, write_point
from piezo_hysteresis.compensation.transition import FADE_SIZE, begin_fade, fade, reset_fade
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import jit, leaf

# Indices in the memory: whether the fast one is active (-1 before the first tick), number of
# changes; then the memory of the transition.
_FAST, SWITCHES, _FADING = range(3)
SWITCH_SIZE = _FADING + FADE_SIZE

# Indices in the settings.
DT, BORDER, DURATION, SLEW = range(4)


@jit
def reset_switch(memory: FloatArray) -> None:
    """Reset the active inverse and every transition."""
    memory[_FAST], memory[SWITCHES] = -1.0, 0.0
    reset_fade(memory[_FADING:])


@leaf
def choose(
    slow: float, fast: float, received: float, frequency: float,
    memory: FloatArray, settings: FloatArray,
) -> float:  # fmt: skip
    """Return the voltage of the active inverse [V], with a smooth transition after a change."""
    now = 1.0 if frequency > settings[BORDER] else 0.0
    changing = memory[_FADING:]
    if memory[_FAST] >= 0.0 and now != memory[_FAST]:
        memory[SWITCHES] += 1.0
        begin_fade(changing)
    memory[_FAST] = now
    share = (fast if now > 0.0 else slow) - received
    return received + fade(share, changing, settings[DT], settings[DURATION], settings[SLEW])


@functools.cache
def stepping(slow: Run, fast: Run) -> Callable[..., float]:
    """Return the kernel for two inverses: memories, settings and parameters, slow first."""
    step_slow, step_fast = inverse_link.stepping(slow), inverse_link.stepping(fast)

    @jit
    def step(
        point: FloatArray, received: float, memory: FloatArray, settings: FloatArray,
        slow_memory: FloatArray, slow_settings: FloatArray, slow_p: FloatArray,
        fast_memory: FloatArray, fast_settings: FloatArray, fast_p: FloatArray,
    ) -> float:  # fmt: skip
        slow_voltage = step_slow(point, received, slow_memory, slow_settings, slow_p)
        fast_voltage = step_fast(point, received, fast_memory, fast_settings, fast_p)
        return choose(slow_voltage, fast_voltage, received, point[FREQUENCY], memory, settings)

    return step


class FrequencySwitch:
    """A link with one of two inverses active, selected by frequency: Fang 2019 (switch).

    Both run continuously, so that each hysteresis has the whole history; a change of the active
    one is a smooth transition.

    Parameters
    ----------
    slow, fast : InverseLink
        Active up to `frequency`, and above it.
    frequency : float
        Switching frequency of the fundamental of the reference [Hz]; 1 in the paper.
    dt : float
        Sampling interval [s].
    transition : float
        Duration of a transition [s].
    limits : Limits, optional
        Their slew limits the rate of the transition.

    Raises
    ------
    CompensationError
        If the frequency is not positive.
    """

    def __init__(
        self,
        slow: InverseLink,
        fast: InverseLink,
        frequency: float,
        dt: float,
        *,
        transition: float = 0.2,
        limits: Limits | None = None,
    ) -> None:
        if not (math.isfinite(frequency) and frequency > 0.0):
            raise CompensationError(
                f'the frequency of the switch must be positive, got {frequency:g} Hz'
            )
        self.slow, self.fast = slow, fast
        slew = math.inf if limits is None else limits.slew
        self.settings = np.array([dt, frequency, transition, slew], dtype=np.float64)
        self._memory, self._point = np.zeros(SWITCH_SIZE), np.zeros(POINT_SIZE)
        self._step = stepping(slow.run, fast.run)
        reset_switch(self._memory)

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return the voltage of the active link [V]; both are updated."""
        write_point(self._point, point)
        slow, fast = self.slow, self.fast
        return self._step(
            self._point, float(received), self._memory, self.settings,
            slow.memory, slow.settings, slow.packed, fast.memory, fast.settings, fast.packed,
        )  # fmt: skip

    def counters(self) -> dict[str, int]:
        """Return the number of changes and the counters of both links."""
        slow, fast = self.slow.counters(), self.fast.counters()
        both = {name: slow.get(name, 0) + fast.get(name, 0) for name in {**slow, **fast}}
        return {'switches': int(self._memory[SWITCHES]), **both}

    def reset(self) -> None:
        """Reset both links."""
        self.slow.reset()
        self.fast.reset()
        reset_switch(self._memory)
