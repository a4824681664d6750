"""The link that attenuates harmonics of the tracking error."""

from __future__ import annotations

from typing import Protocol

from piezo_hysteresis.compensation.afc import ComplexGainCancellation
from piezo_hysteresis.compensation.attenuation_settings import AttenuationSettings
from piezo_hysteresis.compensation.base import Measured, ReferencePoint
from piezo_hysteresis.compensation.harmonic_filtered import FilteredReferenceRls
from piezo_hysteresis.compensation.harmonic_rls import HarmonicRls
from piezo_hysteresis.compensation.harmonics import Harmonic
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

    def reset(self) -> None:
        """Forget every correction."""


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

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Answer `received` minus the correction [V]."""
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


def build_law(settings: AttenuationSettings, gain: LinearGain, dt: float) -> HarmonicLaw:
    """Return the law that `settings` name."""
    if settings.method == 'afc':
        return ComplexGainCancellation(settings, gain, dt)
    if settings.method == 'filtered_rls':
        return FilteredReferenceRls(settings, gain, dt)
    return HarmonicRls(settings, gain, dt)
