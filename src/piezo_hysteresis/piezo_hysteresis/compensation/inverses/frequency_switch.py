"""One feedforward for slow and one for fast drives: Fang et al. 2019 divide them at 1 Hz."""

from __future__ import annotations

import math

from piezo_hysteresis.compensation.base import Limits, Link, Measured, ReferencePoint
from piezo_hysteresis.compensation.transition import Transition
from piezo_hysteresis.errors import CompensationError


class FrequencySwitch:
    """A link that passes on what one of two links answers, by the frequency of the reference.

    Both run all the time, so that the hysteresis of either has the whole history; a change of the
    one in charge goes over along a smooth step.

    Parameters
    ----------
    slow, fast : Link
        In charge up to `frequency`, and above it.
    frequency : float
        Of the fundamental of the reference [Hz]; 1 in the paper.
    dt : float
        Sampling interval [s].
    transition : float
        Seconds that a change takes [s].
    limits : Limits, optional
        Their slew bounds the pace of the change.

    Raises
    ------
    CompensationError
        If the frequency is not positive.
    """

    def __init__(
        self,
        slow: Link,
        fast: Link,
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
        self._links = slow, fast
        self._frequency = frequency
        self._transition = Transition(dt, transition, math.inf if limits is None else limits.slew)
        self._fast: bool | None = None
        self._switches = 0

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return what the link in charge passes on [V]; both take part."""
        slow, fast = (link.step(point, received, measured) for link in self._links)
        now = point.frequency > self._frequency
        if self._fast is not None and now != self._fast:
            self._switches += 1
            self._transition.start()
        self._fast = now
        return received + self._transition.apply((fast if now else slow) - received)

    def counters(self) -> dict[str, int]:
        """Return the changes so far and the counters of both links."""
        slow, fast = (link.counters() for link in self._links)
        both = {name: slow.get(name, 0) + fast.get(name, 0) for name in {**slow, **fast}}
        return {'switches': self._switches, **both}

    def reset(self) -> None:
        """Reset both links."""
        for link in self._links:
            link.reset()
        self._transition.reset()
        self._fast, self._switches = None, 0
