"""Feedforward with one inverse per drive, selected by the reference."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable

from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY, InverseLink
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.transition import Transition
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule

# Another entry is used once its distance is below this share of that of the present one, so that
# a drive midway between two does not change over and over.
_NEARER = 0.8


class ScheduledInverse:
    """The inverse of the entry of a schedule that is nearest to the drive.

    The frequency is that of the reference; among entries of one frequency, the travel is compared
    with the amplitude of the last period. Without a frequency the last inverse remains, and before
    the first one that of all drives. The voltage moves over without a step, within the slew limit.

    Parameters
    ----------
    model : ModelFile
        A model with a schedule.
    invert : callable
        Returns the inverse of a model without a schedule.
    dt : float
        Sampling interval [s].
    limits : Limits
        Of the voltage.
    transition : float
        Duration of the transition to another inverse [s].
    """

    def __init__(
        self,
        model: ModelFile,
        invert: Callable[[ModelFile], InverseLink],
        dt: float,
        limits: Limits,
        transition: float,
    ) -> None:
        assert model.schedule is not None
        self.dt, self._invert = dt, invert
        self._schedule: Schedule = model.schedule
        self._of_all = invert(model)
        self._inverses = {p.name: invert(p.model) for p in model.schedule.points}
        self._inverse = self._of_all
        self._fade = Transition(dt, transition, limits.slew)
        self._past: deque[ReferencePoint] = deque(maxlen=HISTORY)
        self._point: OperatingPoint | None = None
        self.reset()

    @property
    def point(self) -> OperatingPoint | None:
        """The entry in use, None before the first frequency."""
        return self._point

    def step(
        self, point: ReferencePoint, received: float = 0.0, measured: Measured | None = None
    ) -> float:
        """Return the voltage for this tick: `received` plus that of the inverse [V]."""
        chosen = self._chosen(point)
        if chosen is not self._point:
            self._change_to(chosen)
        self._past.append(point)
        return received + self._fade.apply(self._inverse.step(point, 0.0, measured))

    def update(self, model: ModelFile) -> None:
        """Take changed entries, and new ones; the voltage changes smoothly.

        Raises
        ------
        CompensationError
            If one cannot be inverted; all previous ones are kept.
        """
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
        self._schedule, self._inverses, self._of_all = model.schedule, fresh, of_all
        if self._point is None:
            self._inverse = of_all
        else:
            same = [p for p in model.schedule.points if p.name == self._point.name]
            self._point = same[0] if same else self._schedule.at(self._point.frequency)
            self._inverse = fresh[self._point.name]
        if self._inverse is not in_use and self._past:
            self._inverse.follow(self._past)
            self._fade.start()

    def follow(self, past: Iterable[ReferencePoint]) -> None:
        """Take the memory that the last points of a running reference leave."""
        self.reset()
        for point in past:
            self._point = self._chosen(point)
            self._past.append(point)
        if self._point is not None:
            self._inverse = self._inverses[self._point.name]
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
        self._point = None
        self._turn, self._largest, self._amplitude = -1.0, 0.0, 0.0

    def _chosen(self, point: ReferencePoint) -> OperatingPoint | None:
        """Return the entry for the reference of this tick."""
        f = point.frequency
        if not (f > 0.0 and math.isfinite(f)):
            return self._point
        self._note_amplitude(point)
        row = self._schedule.row(f)
        now = self._point
        if now is not None and row[0].frequency != now.frequency:
            nearer = abs(row[0].frequency - f) < _NEARER * abs(now.frequency - f)
            row = row if nearer else self._schedule.row(now.frequency)
        if len(row) == 1 or self._amplitude == 0.0:
            return row[-1] if now is None or now not in row else now
        best = min(row, key=lambda p: abs(p.travel - self._amplitude))
        if now is None or now not in row:
            return best
        away = abs(now.travel - self._amplitude)
        return best if abs(best.travel - self._amplitude) < _NEARER * away else now

    def _note_amplitude(self, point: ReferencePoint) -> None:
        """Keep the amplitude of the last period, from velocity and acceleration [m]."""
        omega = 2.0 * math.pi * point.frequency
        size = math.hypot(point.velocity / omega, point.acceleration / (omega * omega))
        turn = math.floor(point.phase / (2.0 * math.pi))
        if turn == self._turn:
            self._largest = max(self._largest, size)
            return
        self._amplitude = self._largest if self._turn >= 0.0 else 0.0
        self._turn, self._largest = turn, size

    def _change_to(self, chosen: OperatingPoint | None) -> None:
        """Take the inverse of an entry over, with the history of the reference."""
        assert chosen is not None
        self._point = chosen
        self._inverse = self._inverses[chosen.name]
        if not self._past:
            return
        self._changes += 1
        self._inverse.follow(self._past)
        self._fade.start()
