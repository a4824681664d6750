"""Feedforward with one inverse per drive, selected by the reference."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from piezo_hysteresis.compensation.drive_selection import DriveSelector
from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY, InverseLink
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint, Transition
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint


class ScheduledInverse:
    """The inverse of the entry of a schedule that is nearest to the drive, see `DriveSelector`.

    Before the first frequency it is that of all drives. The voltage moves over without a step,
    within the slew limit.
    """

    def __init__(
        self,
        model: ModelFile,
        invert: Callable[[ModelFile], InverseLink],
        dt: float,  # [s]
        limits: Limits,
        transition: float,  # [s]
    ) -> None:
        assert model.schedule is not None
        self.dt, self._invert = dt, invert
        self._of_all = invert(model)
        self._inverses = {p.name: invert(p.model) for p in model.schedule.points}
        self._inverse = self._of_all
        self._fade = Transition(dt, transition, limits.slew)
        self._past: deque[ReferencePoint] = deque(maxlen=HISTORY)
        self._selector = DriveSelector(model.schedule, dt)
        self.reset()

    @property
    def point(self) -> OperatingPoint | None:
        """The entry in use, None before the first frequency."""
        return self._selector.point

    def step(
        self, point: ReferencePoint, received: float = 0.0, measured: Measured | None = None
    ) -> float:
        """Return the voltage for this tick: `received` plus that of the inverse [V]."""
        before = self.point
        chosen = self._selector.select(point)
        if chosen is not None and chosen is not before:
            self._change_to(chosen)
        self._past.append(point)
        return received + self._fade.apply(self._inverse.step(point, 0.0, measured))

    def update(self, model: ModelFile) -> None:
        """Take changed entries, and new ones; the voltage changes smoothly."""
        assert model.schedule is not None
        fresh = {p.name: self._invert(p.model) for p in model.schedule.points}
        of_all = self._invert(model)
        for name, link in fresh.items():
            known = self._inverses.get(name)
            if type(known) is type(link) and known.parameters.keys() == link.parameters.keys():
                if known.parameters != link.parameters:
                    known.set_parameters(link.parameters)
                fresh[name] = known
        in_use = self._inverse
        self._inverses, self._of_all = fresh, of_all
        self._selector.replace(model.schedule)
        self._inverse = of_all if self.point is None else fresh[self.point.name]
        if self._inverse is not in_use and self._past:
            self._inverse.follow(self._past)
            self._fade.start()

    def follow(self, past: Iterable[ReferencePoint]) -> None:
        """Take the memory that the last points of a running reference leave."""
        self.reset()
        for point in past:
            self._selector.select(point)
            self._past.append(point)
        if self.point is not None:
            self._inverse = self._inverses[self.point.name]
        self._inverse.follow(self._past)

    def counters(self) -> dict[str, int]:
        """Return the error counters by name, and the changes of the inverse."""
        total: dict[str, int] = {}
        for each in (self._of_all, *self._inverses.values()):
            for name, count in each.counters().items():
                total[name] = total.get(name, 0) + count
        return {**total, 'schedule_changes': self._changes}

    def reset(self) -> None:
        """Reset the memory; the schedule stays."""
        for each in (self._of_all, *self._inverses.values()):
            each.reset()
        self._fade.reset()
        self._past.clear()
        self._inverse, self._changes = self._of_all, 0
        self._selector.reset()

    def _change_to(self, chosen: OperatingPoint) -> None:
        """Take the inverse of an entry over, with the history of the reference."""
        self._inverse = self._inverses[chosen.name]
        if not self._past:
            return
        self._changes += 1
        self._inverse.follow(self._past)
        self._fade.start()
