"""The link that attenuates harmonics of the tracking error."""

from __future__ import annotations

import math
from typing import Protocol

from piezo_hysteresis.compensation.base import Measured, ReferencePoint
from piezo_hysteresis.compensation.harmonics.afc import ComplexGainCancellation
from piezo_hysteresis.compensation.harmonics.filtered_rls import FilteredReferenceRls
from piezo_hysteresis.compensation.harmonics.lines import Harmonic
from piezo_hysteresis.compensation.harmonics.rls import HarmonicRls
from piezo_hysteresis.compensation.harmonics.settings import AttenuationSettings
from piezo_hysteresis.compensation.linear_gain import LinearGain
from piezo_hysteresis.compensation.sensor import SensorWatch

__all__ = ['AttenuationSettings', 'Harmonic', 'HarmonicAttenuation']


class HarmonicLaw(Protocol):
    """What every way to attenuate harmonics answers."""

    def update(self, error: float, frequency: float, phase: float) -> None:
        """Take the error y - d [m] of one tick, with the reference's frequency and phase."""

    def voltage(self, frequency: float, phase: float) -> float:
        """Answer what to subtract from the voltage [V]."""

    def harmonics(self) -> list[Harmonic]:
        """Return error and correction of every order."""

    def counters(self) -> dict[str, int]:
        """Return what happened so far, by name."""

    def set_gain(self, gain: LinearGain) -> None:
        """Take a new model of the plant gain."""

    def disturb(self) -> None:
        """Take what was seen of this window for a transient: nothing is to be learned from it."""

    def reset(self) -> None:
        """Forget every correction."""


# Change of the reference's amplitude from period to period that counts as a ramp.
RAMP = 0.02


class RampWatch:
    """Tells when the amplitude of the reference changes, as it does while it is eased in.

    The error then changes with the reference, and a law that learns from changes of the error
    would learn nonsense. The amplitude is that of velocity and acceleration, so that the mean of
    the reference has no part in it; its largest value per period is compared with the period
    before, so that a reference of several tones is no ramp.
    """

    def __init__(self) -> None:
        self._turn = -1
        self._largest = 0.0
        self._before = 0.0

    def changed(self, point: ReferencePoint) -> bool:
        """Take the reference of one tick; tell whether a period ended that differs."""
        if point.frequency <= 0.0:
            self.reset()
            return False
        omega = 2.0 * math.pi * point.frequency
        size = math.hypot(point.velocity / omega, point.acceleration / omega**2)
        turn = math.floor(point.phase / (2.0 * math.pi))
        if turn == self._turn:
            self._largest = max(self._largest, size)
            return False
        before, now = self._before, self._largest
        self._turn, self._before, self._largest = turn, now, size
        return before > 0.0 and abs(now - before) > RAMP * max(now, before)

    def reset(self) -> None:
        """Forget the periods before."""
        self._turn, self._largest, self._before = -1, 0.0, 0.0


class HarmonicAttenuation:
    """A link that subtracts from the voltage what cancels chosen harmonics of the error.

    The measurement is compared with the reference of its own tick, whatever the latency, and the
    phase is the reference's accumulated one, so that changes of frequency are followed. While the
    sensor is lost or frozen the correction goes on as it was learned, and nothing is learned.

    Parameters
    ----------
    settings : AttenuationSettings
        Method, orders and their tuning.
    gain : callable
        Modelled plant gain [m/V] by frequency [Hz], see `linear_gain`.
    dt : float
        Sampling interval [s].

    Raises
    ------
    CompensationError
        If a setting is impossible.
    """

    def __init__(self, settings: AttenuationSettings, gain: LinearGain, dt: float) -> None:
        self.settings = settings
        self._law = build_law(settings, gain, dt)
        self._sensor = SensorWatch(dt)
        self._ramp = RampWatch()

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Answer `received` minus the correction [V]."""
        if self._ramp.changed(point):
            self._law.disturb()
        pair = self._sensor.pair(point, measured)
        if pair is not None:
            partner, displacement = pair
            self._law.update(displacement - partner.displacement, partner.frequency, partner.phase)
        return received - self._law.voltage(point.frequency, point.phase)

    def harmonics(self) -> list[Harmonic]:
        """Return order, error [m, rad] and correction [V, rad] of every order."""
        return self._law.harmonics()

    def set_gain(self, gain: LinearGain) -> None:
        """Take a new model of the plant gain while running."""
        self._law.set_gain(gain)

    def counters(self) -> dict[str, int]:
        """Return what the law and the watch over the sensor counted."""
        return {**self._law.counters(), **self._sensor.counters()}

    def reset(self) -> None:
        """Forget everything but the settings."""
        self._law.reset()
        self._sensor.reset()
        self._ramp.reset()


def build_law(settings: AttenuationSettings, gain: LinearGain, dt: float) -> HarmonicLaw:
    """Return the law that `settings` name."""
    if settings.method == 'afc':
        return ComplexGainCancellation(settings, gain, dt)
    if settings.method == 'filtered_rls':
        return FilteredReferenceRls(settings, gain, dt)
    return HarmonicRls(settings, gain, dt)
