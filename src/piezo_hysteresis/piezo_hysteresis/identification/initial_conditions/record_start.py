"""Initial condition of a record: history of the actuator before the first sample.

A model is simulated from the virgin state at 0 V. A record begins in an arbitrary state of the
actuator, so the simulation starts with a lead-in: the assumed voltage before the record. The
history is a nuisance of the record, never an effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.stated import STARTS
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.noise import measured_without_outliers
from piezo_hysteresis.identification.periods import period_of, periodic_from
from piezo_hysteresis.records import Record

#: Length of the lead-in of a settled record, for the transient of the model to decay [s].
SETTLING = 3.0
# Number of its cycles, up to a time limit [s]: in a Bouc-Wen loop around an offset voltage the
# effect of the initial state decays by some 60 % per cycle.
_CYCLES, _LONGEST = 10, 10.0
# The same in samples: at a high sampling rate the modes that a record shows are fast, and so is
# their decay. Earlier cycles only set the memory: steps of this share of the range suffice.
_SETTLING_SAMPLES, _RAMP_SAMPLES, _COARSE = 3_000, 1_000, 0.02
# Number of samples of a lead-in above which it has two cycles, or one.
_MOST_SAMPLES = 20_000
NEAR_ZERO = 0.05  # first voltage over the largest up to which a record begins at 0 V
_RAMP = 0.5  # time from one level to the next [s], slow against any mode
_EDGE = 4  # smallest number of ticks of a lead-in, for the interpolation between ticks
_CLOSED = 3.0  # largest distance of the end of a one-period record from its start, in steps
# A record begins with a transient if the first part of its first period differs from that of the
# next by this factor more than the other parts usually do, and by this share of the stroke.
_PARTS, _STANDS_OUT, _SMALLEST = 8, 3.0, 1e-5
_FEWEST = 4  # periods that show whether a record begins settled
# Tested levels of the last extreme before a record, as shares of the largest voltage.
_LEVELS = (-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class RecordStart:
    """Initial condition of a record."""

    kind: str
    levels: tuple[float, ...] = ()  # extremes of the voltage before the record, in order [V]
    held: bool = False  # whether a fit takes the levels as they are

    def __str__(self) -> str:
        if not self.levels:
            return self.kind
        return f'{self.kind} after {", ".join(f"{level:.3g}" for level in self.levels)} V'

    @property
    def parameters(self) -> int:
        """Number of nuisance parameters of the record."""
        return len(self.levels)


STEP, REST, SETTLED = RecordStart('step'), RecordStart('rest'), RecordStart('settled')


def cycle_of(record: Record) -> int:
    """Return the period in samples of a cycle that may precede the record, or 0.

    It is the period of the drive, or the whole record if its end matches its beginning.
    """
    period = period_of(record)
    if period and periodic_from(record.voltage, period) <= period:
        return period
    whole = _closes(record.voltage) and _closes(record.displacement)
    return len(record) if whole and not period else 0


def _closes(x: FloatArray) -> bool:
    """Return whether the end of a signal matches its beginning, as in a cycle."""
    step = float(np.sqrt(np.mean(np.diff(x) ** 2)))
    moves = abs(float(x[0])) > NEAR_ZERO * float(np.max(np.abs(x)))
    return moves and abs(float(x[0] - x[-1])) <= _CLOSED * step


def first_guess(record: Record, wanted: str = 'auto') -> RecordStart:
    """Return the initial condition of a record as estimated without a model."""
    start = record.info.start if record.info.start != 'auto' else wanted
    if start not in STARTS:
        raise IdentificationError(
            f'the initial condition {start!r} is unknown{choices(start, STARTS)}'
        )
    if start == 'settled' and not cycle_of(record):
        raise IdentificationError(
            f'record {record.name} does not repeat itself, so it cannot begin settled; use '
            'estimate or leave it at auto'
        )
    if start == 'estimate':
        return RecordStart('estimate')
    if start != 'auto':
        return RecordStart(start)
    reach = float(np.max(np.abs(record.voltage)))
    if abs(float(record.voltage[0])) <= NEAR_ZERO * reach:
        return STEP
    return SETTLED if _begins_settled(record) else RecordStart('estimate')


def _may_be_settled(record: Record) -> bool:
    """Return whether a record is one cycle, or so many that they show how it begins.

    The effect of the history decays within two periods: two or three fit with nearly any start.
    """
    period = period_of(record)
    return cycle_of(record) > 0 and (not period or len(record) >= _FEWEST * period)


def _begins_settled(record: Record) -> bool:
    """Return whether the first period of a record is like the next one: it begins settled."""
    period = period_of(record)
    if not _may_be_settled(record):
        return False
    if not period:
        return True
    y = measured_without_outliers(record)
    change = y[period : 2 * period] - y[:period]
    change -= np.median(change)
    parts = [part for part in np.array_split(change, _PARTS) if part.size]
    early, *late = (float(np.sqrt(np.mean(part**2))) for part in parts)
    usual = float(np.median(late)) if late else early
    return early <= _STANDS_OUT * max(usual, _SMALLEST * float(np.ptp(y)))


def rivals(record: Record, wanted: str = 'auto', *, levels: bool = True) -> Iterator[RecordStart]:
    """Yield alternative initial conditions, the simpler ones first.

    Those with `levels` differ only for models with a memory of extremes.
    """
    start = record.info.start if record.info.start != 'auto' else wanted
    reach = float(np.max(np.abs(record.voltage)))
    if start == 'auto':
        yield STEP
        if abs(float(record.voltage[0])) > NEAR_ZERO * reach:
            yield REST
        yield RecordStart('estimate')
        if _may_be_settled(record):
            yield SETTLED
    if levels and start in ('auto', 'estimate'):
        for level in _LEVELS:
            yield RecordStart('estimate', (level * reach,))


def refined(start: RecordStart, record: Record, share: float) -> Iterator[RecordStart]:
    """Yield starts with the last level shifted by a `share` of the largest voltage either way."""
    step = share * float(np.max(np.abs(record.voltage)))
    for way in (-step, step):
        yield RecordStart(start.kind, (*start.levels[:-1], start.levels[-1] + way))


def deepened(start: RecordStart, record: Record) -> Iterator[RecordStart]:
    """Yield starts with one more level, before or after the known ones."""
    reach = float(np.max(np.abs(record.voltage)))
    for level in _LEVELS:
        yield RecordStart(start.kind, (level * reach, *start.levels))
        yield RecordStart(start.kind, (*start.levels, level * reach))


def lead_in(record: Record, start: RecordStart) -> FloatArray:
    """Return the lead-in: voltage from the virgin state to the first sample of the record [V]."""
    if start.kind in ('step', 'estimate') and not start.levels and record.before is not None:
        return np.concatenate([np.zeros(_EDGE), record.before])
    if start.kind == 'settled':
        return _cycles(record.voltage[: cycle_of(record)], record.dt)
    return path_to(record.voltage[:2], start, record.dt)


def _cycles(cycle: FloatArray, dt: float) -> FloatArray:
    """Return repeated cycles: the early ones with few samples, the end at the sampling rate."""
    period = cycle.size * dt
    settling = min(SETTLING, _SETTLING_SAMPLES * dt)
    count = max(2, min(_CYCLES, ceil(_LONGEST / period)), ceil(settling / period))
    largest = float(np.max(np.abs(np.diff(cycle, append=cycle[:1])), initial=0.0))
    step = max(1, int(_COARSE * float(np.ptp(cycle)) / largest)) if largest > 0.0 else cycle.size
    if count * cycle.size > step * _MOST_SAMPLES:
        count = 2 if 2 * cycle.size <= step * _MOST_SAMPLES else 1
    voltage = np.tile(cycle, count)
    late = max(voltage.size - ceil(settling / dt), 0)
    return np.concatenate([voltage[late % step : late : step], voltage[late:]])


def path_to(drive: FloatArray, start: RecordStart, dt: float) -> FloatArray:
    """Return the voltage from 0 V through the levels of a start to the first value of `drive` [V].

    For a record that begins in motion, the voltage a tick earlier is extrapolated by one step.
    """
    first = float(drive[0])
    if start.kind == 'estimate':
        first -= float(drive[-1] - drive[0])
    if start.kind == 'step':
        return np.zeros(_EDGE)
    count = max(min(round(_RAMP / dt), _RAMP_SAMPLES), _EDGE)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)
    legs = [a + (b - a) * ramp for a, b in pairwise((0.0, *start.levels, first))]
    if start.kind == 'rest':
        legs.append(np.full(max(min(round(SETTLING / dt), _SETTLING_SAMPLES), _EDGE), first))
    return np.concatenate(legs)


def preceded(record: Record, levels: Sequence[float]) -> Record:  # levels [V]
    """Return the record with a preceding voltage: from rest through `levels` to its first value.

    A model starts from the virgin state. An actuator rarely does: its displacement at rest depends
    on the last extremes of its voltage.
    """
    if not np.all(np.isfinite(levels)):
        raise IdentificationError('the levels before a record must be finite voltages')
    before = path_to(record.voltage[:2], RecordStart('rest', tuple(map(float, levels))), record.dt)
    return replace(record, before=before, info=replace(record.info, start='step'))
