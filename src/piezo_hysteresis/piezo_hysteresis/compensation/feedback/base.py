"""What the feedback links share: the error of the right tick, a watch over the plant, a bound."""

from __future__ import annotations

import math

from piezo_hysteresis.compensation.base import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.feedback.polarity import PolarityWatch
from piezo_hysteresis.compensation.sensor import SensorWatch
from piezo_hysteresis.compensation.transition import Transition
from piezo_hysteresis.errors import CompensationError

# A window in which the voltage was cut off for this share of the time, while what the link
# receives is within the range, is looked at: cut at both ends the loop swings between its limits,
# cut at one end and answered by the opposite sign the plant is inverted.
_CUT_SHARE = 0.25
_BOTH_ENDS = 0.08
_WINDOW = 0.5
_FADE = 0.2


class FeedbackLink:
    """Base of the feedback links: adds ``law(error)`` to the voltage that it receives.

    The measurement is compared with the reference of its own tick. While there is none that may
    be believed the law is asked for what it holds. When the plant is found to answer with the
    opposite sign, or the loop to swing between the limits, the law fades out and stays off until
    `reset`; `counters` say so.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        Range of the voltage passed on [V]; the law learns what it was cut to (anti-windup).
    """

    def __init__(self, dt: float, limits: Limits | None = None) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.dt = dt
        self._low = -math.inf if limits is None else limits.low
        self._high = math.inf if limits is None else limits.high
        self._sensor = SensorWatch(dt)
        self._polarity = PolarityWatch(dt)
        self._fade = Transition(dt, _FADE, math.inf if limits is None else limits.slew)
        self._window = max(1, round(_WINDOW / dt))
        self._start()

    def _start(self) -> None:
        self._off = ''
        self._saturated = 0
        self._ticks = self._cut_low = self._cut_high = 0

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Answer `received` plus the share of the law [V]."""
        pair = self._sensor.pair(point, measured)
        if self._off:
            share = 0.0
        elif pair is None or measured is None:
            share = self._hold()
        else:
            partner, displacement = pair
            self._polarity.see(measured.voltage, displacement)
            share = self._law(partner.displacement - displacement)
        wanted = received + share
        safe = min(max(wanted, self._low), self._high)
        if not self._off and pair is not None:
            self._cut(safe - wanted)
            self._judge(safe - wanted, self._low <= received <= self._high)
        return received + self._fade.apply(safe - received)

    def _judge(self, excess: float, received_in_range: bool) -> None:
        """Switch the law off where it does harm."""
        self._ticks += 1
        if excess != 0.0 and received_in_range:
            self._saturated += 1
            self._cut_low += excess > 0.0
            self._cut_high += excess < 0.0
        if self._ticks < self._window:
            return
        if self._cut_low + self._cut_high > _CUT_SHARE * self._ticks:
            if min(self._cut_low, self._cut_high) > _BOTH_ENDS * self._ticks:
                self._off = 'diverged'
            if self._polarity.inverted:
                self._off = 'inverted_plant'
        self._ticks = self._cut_low = self._cut_high = 0
        if self._off:
            self._fade.start()

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far, by name."""
        return {
            'saturated': self._saturated,
            'inverted_plant': int(self._off == 'inverted_plant'),
            'diverged': int(self._off == 'diverged'),
            **self._sensor.counters(),
        }

    def reset(self) -> None:
        """Forget everything but the parameters."""
        self._sensor.reset()
        self._polarity.reset()
        self._fade.reset()
        self._start()

    def _law(self, error: float) -> float:
        """Answer the share of the voltage [V] for the error d - y [m]."""
        raise NotImplementedError

    def _hold(self) -> float:
        """Answer the share while no measurement can be believed [V]."""
        raise NotImplementedError

    def _cut(self, excess: float) -> None:
        """Take note that the voltage was changed by `excess` behind the law [V]."""
