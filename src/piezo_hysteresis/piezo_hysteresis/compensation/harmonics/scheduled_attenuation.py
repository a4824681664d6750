"""Attenuation with the plant gain of one entry per drive, selected by the reference."""

from __future__ import annotations

from collections.abc import Callable

from piezo_hysteresis.compensation.drive_selection import DriveSelector
from piezo_hysteresis.compensation.harmonics.attenuation_settings import AttenuationSettings
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import HarmonicAttenuation
from piezo_hysteresis.compensation.linear_gain import LinearGain, ScaledGain
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.transition import Transition
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint


class ScheduledAttenuation(HarmonicAttenuation):
    """The attenuation with the gain of the entry that is nearest to the drive.

    An entry is known at its own frequency, its harmonics are not: the gain over frequency is that
    of all drives, with the size of the entry at its frequency. Before the first frequency it is
    that of all drives. The learned correction is kept where
    the entry changes. `rls` turns its correction by the phase of the gain; the difference fades
    within the slew limit. By order -1, `rls` takes the harmonic of each entry, and begins anew
    where it changes.
    """

    def __init__(
        self,
        settings: AttenuationSettings,
        model: ModelFile,
        gain_of: Callable[[ModelFile], LinearGain],
        dt: float,  # [s]
        limits: Limits,
        decay: float,  # [s]
        transition: float,  # [s]
    ) -> None:
        assert model.schedule is not None
        self._gain_of = gain_of
        self._selector = DriveSelector(model.schedule, dt)
        self._fade = Transition(dt, transition, limits.slew)
        self._gain_of_all = gain_of(model)
        self._gains = self._gains_of(model)
        self._changes = 0
        self._by_order = settings.method == 'rls' and settings.automatic
        if self._by_order:
            settings = settings.only(0)
        super().__init__(settings, self._gain_of_all, dt, limits, decay)

    @property
    def point(self) -> OperatingPoint | None:
        """The entry in use, None before the first frequency."""
        return self._selector.point

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return `received` minus the correction [V]."""
        before = self.point
        chosen = self._selector.select(point)
        if chosen is not None and chosen is not before:
            self._changes += before is not None
            self._take(chosen)
        return received + self._fade.apply(super().step(point, received, measured) - received)

    def update(self, model: ModelFile) -> None:
        """Take changed entries, and new ones, while running."""
        assert model.schedule is not None
        self._gain_of_all = self._gain_of(model)
        self._gains = self._gains_of(model)
        self._selector.replace(model.schedule)
        if self.point is None:
            self.set_gain(self._gain_of_all)
        else:
            self._take(self.point)

    def counters(self) -> dict[str, int]:
        """Return what the law counted, and the changes of the entry."""
        return {**super().counters(), 'schedule_changes': self._changes}

    def reset(self) -> None:
        """Reset everything but settings and schedule."""
        super().reset()
        self._selector.reset()
        self._fade.reset()
        self._changes = 0

    def _gains_of(self, model: ModelFile) -> dict[str, ScaledGain]:
        assert model.schedule is not None
        gains = {}
        for point in model.schedule.points:
            usual = abs(self._gain_of_all(point.frequency))
            size = abs(self._gain_of(point.model)(point.frequency))
            gains[point.name] = ScaledGain(self._gain_of_all, size / usual if usual > 0.0 else 1.0)
        return gains

    def _take(self, chosen: OperatingPoint) -> None:
        if self._by_order and self.settings.orders != self.settings.only(chosen.order).orders:
            self._use(self.settings.only(chosen.order))
        self.set_gain(self._gains[chosen.name])
        if self.settings.method == 'rls':
            self._fade.start()
