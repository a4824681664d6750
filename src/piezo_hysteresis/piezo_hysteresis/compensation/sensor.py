"""Which measurements a controller may believe, and which tick of the reference they belong to."""

from __future__ import annotations

import math

from piezo_hysteresis.compensation.base import Measured, ReferencePoint

_HISTORY = 256


class SensorWatch:
    """Pairs each measurement with the reference of its own tick and refuses bad ones.

    A measurement that is missing, repeated, not a number, older than the history or frozen is
    counted and not used; the controller then holds what it has learned.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    frozen_after : float
        Seconds of bit-identical readings, while the voltage moves, after which the sensor
        counts as frozen [s].
    """

    def __init__(self, dt: float, frozen_after: float = 0.05) -> None:
        self._frozen_ticks = max(3, round(frozen_after / dt))
        self.reset()

    def reset(self) -> None:
        """Forget every point and count."""
        self._points: list[ReferencePoint | None] = [None] * _HISTORY
        self._last_sample: int = -1
        self._reading: float = math.nan
        self._voltage: float = math.nan
        self._still: int = 0
        self._counts: dict[str, int] = dict.fromkeys(
            ('missing', 'repeated', 'not_finite', 'unpaired', 'frozen'), 0
        )

    def pair(
        self, point: ReferencePoint, measured: Measured | None
    ) -> tuple[ReferencePoint, float] | None:
        """Return the reference of the measured tick and the displacement [m], or None.

        Parameters
        ----------
        point : ReferencePoint
            The reference of this tick; it is remembered.
        measured : Measured or None
            The newest measurement that is known.
        """
        self._points[point.sample % _HISTORY] = point
        if measured is None:
            if self._last_sample >= 0:
                self._counts['missing'] += 1
            return None
        if measured.sample <= self._last_sample:
            self._counts['repeated'] += 1
            return None
        if not math.isfinite(measured.displacement):
            self._counts['not_finite'] += 1
            return None
        self._last_sample = measured.sample
        partner = self._points[measured.sample % _HISTORY]
        if partner is None or partner.sample != measured.sample:
            self._counts['unpaired'] += 1
            return None
        if self._is_frozen(measured.displacement, measured.voltage):
            self._counts['frozen'] += 1
            return None
        return partner, measured.displacement

    @property
    def frozen(self) -> bool:
        """Whether the sensor repeats itself while the voltage moves."""
        return self._still >= self._frozen_ticks

    def _is_frozen(self, reading: float, voltage: float) -> bool:
        if reading != self._reading:
            self._reading = reading
            self._still = 0
        elif voltage != self._voltage:
            self._still += 1
        self._voltage = voltage
        return self.frozen

    def counters(self) -> dict[str, int]:
        """Return how many measurements were not used, by reason."""
        return dict(self._counts)
