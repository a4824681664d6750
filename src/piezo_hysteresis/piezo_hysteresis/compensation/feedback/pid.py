"""PID with filtered derivative and anti-windup, Zhou 2021 figure 10, Fang 2019 figure 5."""

from __future__ import annotations

from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.feedback.base import FeedbackLink
from piezo_hysteresis.compensation.feedback.settings import PidGains

__all__ = ['Pid', 'PidGains']


class Pid(FeedbackLink):
    """PID feedback as a link of the chain.

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

    def __init__(
        self,
        gains: PidGains,
        dt: float,
        *,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(dt, limits)
        self._gains = gains
        self._clear()

    @property
    def gains(self) -> PidGains:
        """Gains in force."""
        return self._gains

    def set_gains(self, gains: PidGains) -> None:
        """Change the gains; the integral takes up the difference, so that nothing jumps."""
        if self._last is not None:
            change = (self._gains.proportional - gains.proportional) * self._last
            self._integral += change
        self._gains = gains

    def reset(self) -> None:
        """Forget everything but the gains."""
        super().reset()
        self._clear()

    def _clear(self) -> None:
        self._integral = 0.0
        self._slope = 0.0
        self._last: float | None = None

    def _law(self, error: float) -> float:
        return self._pid(error, self._gains.proportional, self._gains.integral)

    def _pid(self, error: float, proportional: float, integral: float) -> float:
        gains, dt = self._gains, self.dt
        last = error if self._last is None else self._last
        self._integral += 0.5 * dt * integral * (error + last)
        filter_time = gains.derivative_filter
        self._slope = ((2.0 * filter_time - dt) * self._slope + 2.0 * (error - last)) / (
            2.0 * filter_time + dt
        )
        self._last = error
        return proportional * error + self._integral + gains.derivative * self._slope

    def _hold(self) -> float:
        return self._integral

    def _cut(self, excess: float) -> None:
        self._integral += excess * min(1.0, self.dt / self._gains.tracking_time)
