"""What the feedback links share: the error of the right tick, a watch over the plant, a bound."""

from __future__ import annotations

import math

from piezo_hysteresis.compensation.base import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.polarity import PolarityWatch
from piezo_hysteresis.compensation.sensor import SensorWatch
from piezo_hysteresis.errors import CompensationError


class FeedbackLink:
    """Base of the feedback links: adds ``law(error)`` to the voltage that it receives.

    The measurement is compared with the reference of its own tick. While there is none that may
    be believed the law is asked for what it holds; when the plant is found to answer with the
    opposite sign the law is switched off for good, which `counters` says.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        Range of the voltage passed on [V]; the law learns what it was cut to (anti-windup).
    resonance : float
        Natural frequency above which the plant rightly answers in opposition [Hz]; 0 if none.
    """

    def __init__(self, dt: float, limits: Limits | None = None, resonance: float = 0.0) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.dt = dt
        self._low = -math.inf if limits is None else limits.low
        self._high = math.inf if limits is None else limits.high
        self._sensor = SensorWatch(dt)
        self._polarity = PolarityWatch(dt, resonance)
        self._saturated = 0

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Answer `received` plus the share of the law [V]."""
        pair = self._sensor.pair(point, measured)
        if self._polarity.inverted:
            return received
        if pair is None or measured is None:
            return received + self._hold()
        partner, displacement = pair
        self._polarity.see(measured.voltage, displacement, partner.frequency)
        share = self._law(partner.displacement - displacement)
        wanted = received + share
        safe = min(max(wanted, self._low), self._high)
        if safe != wanted:
            self._saturated += 1
        self._cut(safe - wanted)
        return safe

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far, by name."""
        return {
            'saturated': self._saturated,
            'inverted_plant': int(self._polarity.inverted),
            **self._sensor.counters(),
        }

    def reset(self) -> None:
        """Forget everything but the parameters."""
        self._sensor.reset()
        self._polarity.reset()
        self._saturated = 0

    def _law(self, error: float) -> float:
        """Answer the share of the voltage [V] for the error d - y [m]."""
        raise NotImplementedError

    def _hold(self) -> float:
        """Answer the share while no measurement can be believed [V]."""
        raise NotImplementedError

    def _cut(self, excess: float) -> None:
        """Take note that the voltage was changed by `excess` behind the law [V]."""
