"""RLS of one drive with each harmonic order, of which the record decides."""

from __future__ import annotations

from dataclasses import replace

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.estimate import Estimate
from piezo_hysteresis.identification.recursion import OnlineMethod
from piezo_hysteresis.identification.rls import OnlineRls

_ORDERS = (3, 5)


class RlsByOrder(OnlineMethod):
    """Runs `OnlineRls` without a harmonic, with the third and with the fifth.

    Which order a drive has is known only from the spectrum of its record. The recursions run side
    by side, so that the estimate is the one of `identify` whenever the order becomes known.
    """

    def __init__(self, method: OnlineRls) -> None:
        self.order = 0
        self._rows = {0: method}

    @property
    def _chosen(self) -> OnlineRls:
        return self._rows.get(self.order, self._rows[0])

    @property
    def forgetting(self) -> float:
        """Forgetting factor; can be changed at run time."""
        return self._rows[0].forgetting

    @forgetting.setter
    def forgetting(self, value: float) -> None:
        for each in self._rows.values():
            each.forgetting = value

    def _take(self, voltage: FloatArray, displacement: FloatArray, errors: FloatArray) -> None:
        errors[:] = self.update_many(voltage, displacement)

    def update(self, voltage: float, displacement: float) -> float:
        """Update with one sample, see `OnlineMethod.update`."""
        errors = {k: each.update(voltage, displacement) for k, each in self._rows.items()}
        return errors.get(self.order, errors[0])

    def update_many(self, voltage: FloatArray, displacement: FloatArray) -> FloatArray:
        """Update with samples, see `OnlineMethod.update_many`."""
        errors = {k: each.update_many(voltage, displacement) for k, each in self._rows.items()}
        return errors.get(self.order, errors[0])

    def estimate(self) -> Estimate:
        """Return the estimate of the chosen order."""
        return self._chosen.estimate()

    def free_run(self, voltage: FloatArray) -> FloatArray:
        """Simulate the estimate of the chosen order, see `OnlineMethod.free_run`."""
        return self._chosen.free_run(voltage)

    def drive_at(self, frequency: float, start: float = 0.0) -> None:
        """Set the drive, whose harmonics below half the rate begin with the first call."""
        plain = self._rows[0].settings
        for order in _ORDERS:
            if order not in self._rows:
                try:
                    settings = replace(plain, harmonic=order, frequency=frequency)
                except IdentificationError:
                    continue
                self._rows[order] = OnlineRls(settings)
            self._rows[order].drive_at(frequency, start)

    def rest(self) -> None:
        """Start a new record from rest and keep the estimates."""
        for each in self._rows.values():
            each.rest()

    def reset(self) -> None:
        """Reset to the initial values of the settings."""
        for each in self._rows.values():
            each.reset()


def by_order(method: OnlineMethod) -> OnlineMethod:
    """Return the method of one drive: with all orders if it is RLS that has a model for each."""
    if isinstance(method, OnlineRls):
        settings = method.settings
        if settings.variant == 'V1' and settings.harmonic == 0 and not settings.start:
            return RlsByOrder(method)
    return method
