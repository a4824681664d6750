"""Selection of the entry of a schedule for the reference of each tick."""

from __future__ import annotations

import math
from collections import deque

from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.compensation.offline_loop import reference_points
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.waveforms.waveform import Samples

# Another entry is used once its distance is below this share of that of the present one, so that
# a drive midway between two does not change over and over.
_NEARER = 0.8
# A reference that oscillates this much faster than it states is a sum of tones, which states their
# common divisor: seven tones in place of one.
_SUM = 1.5
# Relative change of the stated frequency from which the oscillation is another one.
_CHANGED = 2e-3
# Periods of the mean, and how many of them without a crossing end an oscillation.
_PERIODS, _SILENT = 4, 3.0
# Share of the range by which the reference passes its middle before the next crossing counts.
_BAND = 0.25


class DriveFrequency:
    """Frequency and amplitude of the main oscillation of a reference, from its crossings.

    A crossing is a rise through the middle of the range of the last period, after a fall a
    quarter of the range below it, so that small tones on a large one do not count.
    """

    def __init__(self, dt: float) -> None:  # dt [s]
        self._dt = dt
        self._periods: deque[float] = deque(maxlen=_PERIODS)
        self.reset()

    def reset(self) -> None:
        """Discard everything."""
        self.restart()
        self._half = 0.0

    def restart(self) -> None:
        """Measure the frequency anew; the amplitude remains."""
        self._periods.clear()
        self._range: tuple[float, float] | None = None
        self._started = self._armed = False
        self._since, self._before = 0.0, math.inf
        self._low, self._high = math.inf, -math.inf

    @property
    def frequency(self) -> float:
        """Mean over the last periods [Hz]; 0 before two of them."""
        if len(self._periods) < 2:
            return 0.0
        return float(len(self._periods) / (sum(self._periods) * self._dt))

    @property
    def amplitude(self) -> float:
        """Half the range of the last period [m]; 0 before the first."""
        return self._half

    def update(self, displacement: float) -> None:
        """Take the reference of one tick [m]."""
        d, before = displacement, self._before
        self._low, self._high = min(self._low, d), max(self._high, d)
        self._since += 1.0
        low, high = self._range or (self._low, self._high)
        middle = 0.5 * (low + high)
        if d < middle - _BAND * (high - low):
            self._armed = True
        elif self._armed and before < middle <= d:
            self._cross((d - middle) / (d - before))
        elif self._periods and self._since * self._dt * self.frequency > _SILENT:
            self.restart()
        self._before = d

    def _cross(self, ago: float) -> None:
        """Note a crossing `ago` ticks before the present one."""
        if self._started:
            self._periods.append(self._since - ago)
            self._range = self._low, self._high
            self._half = 0.5 * (self._high - self._low)
        self._started, self._armed, self._since = True, False, ago
        self._low, self._high = math.inf, -math.inf


class DriveSelector:
    """Selects the entry that is nearest to the drive.

    The frequency is that of the reference. Where it states none, or the common divisor of several
    tones, it is that of its main oscillation. Among entries of one frequency, the travel is
    compared with the amplitude of the last period. Without a frequency the last entry remains.
    """

    def __init__(self, schedule: Schedule, dt: float) -> None:  # dt [s]
        self._schedule = schedule
        self._drive = DriveFrequency(dt)
        self.reset()

    def reset(self) -> None:
        """Discard the drive."""
        self.point: OperatingPoint | None = None
        self._drive.reset()
        self._stated = 0.0

    def replace(self, schedule: Schedule) -> None:
        """Take other entries; that of the present drive remains in use if there is one."""
        self._schedule = schedule
        if self.point is not None:
            same = [p for p in schedule.points if p.name == self.point.name]
            self.point = same[0] if same else schedule.at(self.point.frequency)

    def select(self, reference: ReferencePoint) -> OperatingPoint | None:
        """Return the entry for the reference of this tick."""
        f = self._frequency(reference)
        if f > 0.0:
            self.point = self._nearest(f)
        return self.point

    def _frequency(self, reference: ReferencePoint) -> float:
        stated = reference.frequency if math.isfinite(reference.frequency) else 0.0
        if abs(stated - self._stated) > _CHANGED * stated:
            self._drive.restart()
        self._stated = stated
        self._drive.update(reference.displacement)
        seen = self._drive.frequency
        return seen if seen > _SUM * stated else stated

    def _nearest(self, f: float) -> OperatingPoint:
        row, now = self._schedule.row(f), self.point
        if now is not None and row[0].frequency != now.frequency:
            nearer = abs(row[0].frequency - f) < _NEARER * abs(now.frequency - f)
            row = row if nearer else self._schedule.row(now.frequency)
        travel = self._drive.amplitude
        if len(row) == 1 or travel == 0.0:
            return row[-1] if now is None or now not in row else now
        best = min(row, key=lambda p: abs(p.travel - travel))
        if now is None or now not in row:
            return best
        away = abs(now.travel - travel)
        return best if abs(best.travel - travel) < _NEARER * away else now


def entry_of(model: ModelFile, reference: Samples, dt: float) -> ModelFile:
    """Return the model of the drive at the end of a reference; one without a schedule as it is."""
    # reference [m]; dt [s]
    if model.schedule is None:
        return model
    selector = DriveSelector(model.schedule, dt)
    for point in reference_points(reference):
        selector.select(point)
    return model if selector.point is None else selector.point.model
