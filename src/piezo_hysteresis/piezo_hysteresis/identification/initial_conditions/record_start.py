"""Initial condition of a record: history of the actuator before the first sample.

A model runs from the virgin state at 0 V. A record begins in whatever state the actuator was in,
so the model is led in: through the voltages that the record is taken to start from. What was
before is a nuisance of the record, never an effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.periods import period_of, periodic_from
from piezo_hysteresis.records import Record

#: What a user may say of a record; ``auto`` looks at the data.
STARTS = ('auto', 'rest', 'step', 'settled', 'estimate')

#: Time a model gets to forget its own start before a settled record begins [s].
SETTLING = 3.0
# Cycles that it gets unless they last longer than a limit [s]: a Bouc-Wen loop around an offset
# voltage forgets some 60 % of its start per cycle.
_CYCLES, _LONGEST = 10, 10.0
NEAR_ZERO = 0.05  # first voltage over the largest up to which a record begins at 0 V
_RAMP = 0.5  # time from one level to the next [s], slow against any mode
_EDGE = 4  # ticks of a lead-in at the least, so that a record can be read between its ticks
_CLOSED = 3.0  # steps by which a record of one period may miss its own beginning
# Levels that are tried for the last extreme before a record, as shares of the largest voltage.
_LEVELS = (-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class RecordStart:
    """How a record begins.

    Attributes
    ----------
    kind : str
        ``step``: at rest at 0 V until the first sample, or until what is known of the voltage
        before it; ``rest``: at rest at its first voltage;
        ``settled``: in the steady cycle of its own period; ``estimate``: after the `levels`, on
        its way, with the states of its dynamics unknown.
    levels : tuple of float
        Extremes of the voltage before it, in order [V].
    """

    kind: str
    levels: tuple[float, ...] = ()

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

    That of its own period, or the whole record where its end leads back to its beginning.
    """
    period = period_of(record)
    if period and periodic_from(record.voltage, period) <= period:
        return period
    whole = _closes(record.voltage) and _closes(record.displacement)
    return len(record) if whole and not period else 0


def _closes(x: FloatArray) -> bool:
    """Return whether the end of a signal leads back to its beginning, as in a cycle."""
    step = float(np.sqrt(np.mean(np.diff(x) ** 2)))
    moves = abs(float(x[0])) > NEAR_ZERO * float(np.max(np.abs(x)))
    return moves and abs(float(x[0] - x[-1])) <= _CLOSED * step


def first_guess(record: Record, wanted: str = 'auto') -> RecordStart:
    """Return how a record begins as far as it says so without a model.

    Parameters
    ----------
    record : Record
        What was measured.
    wanted : str
        One of `STARTS`; what the record itself says comes first.

    Raises
    ------
    IdentificationError
        If the word is unknown, or a record without a cycle should begin in one.
    """
    start = record.info.start if record.info.start != 'auto' else wanted
    if start not in STARTS:
        raise IdentificationError(
            f'a record cannot begin by {start!r}; choose one of {", ".join(STARTS)}'
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
    return SETTLED if cycle_of(record) else RecordStart('estimate')


def rivals(record: Record, wanted: str = 'auto', *, levels: bool = True) -> Iterator[RecordStart]:
    """Yield other start hypotheses, the plainer ones first.

    Those after `levels` differ for a memory of extremes only.
    """
    start = record.info.start if record.info.start != 'auto' else wanted
    reach = float(np.max(np.abs(record.voltage)))
    if start == 'auto':
        yield STEP
        if abs(float(record.voltage[0])) > NEAR_ZERO * reach:
            yield REST
        yield RecordStart('estimate')
        if cycle_of(record):
            yield SETTLED
    if levels and start in ('auto', 'estimate'):
        for level in _LEVELS:
            yield RecordStart('estimate', (level * reach,))


def refined(start: RecordStart, record: Record, share: float) -> Iterator[RecordStart]:
    """Yield starts whose last level lies a `share` of the largest voltage to either side."""
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
    if start.kind == 'step' and record.before is not None:
        return np.concatenate([np.zeros(_EDGE), record.before])
    if start.kind == 'settled':
        cycle = record.voltage[: cycle_of(record)]
        period = cycle.size * record.dt
        few = min(_CYCLES, ceil(_LONGEST / period))
        return np.tile(cycle, max(2, few, ceil(SETTLING / period)))
    return path_to(record.voltage[:2], start, record.dt)


def path_to(drive: FloatArray, start: RecordStart, dt: float) -> FloatArray:
    """Return the voltage from 0 V through the levels of a start to where a `drive` begins [V].

    A record that begins on its way was a step before its first voltage a tick ago.
    """
    first = float(drive[0])
    if start.kind == 'estimate':
        first -= float(drive[-1] - drive[0])
    if start.kind == 'step':
        return np.zeros(_EDGE)
    count = max(round(_RAMP / dt), _EDGE)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)
    legs = [a + (b - a) * ramp for a, b in pairwise((0.0, *start.levels, first))]
    if start.kind == 'rest':
        legs.append(np.full(max(round(SETTLING / dt), _EDGE), first))
    return np.concatenate(legs)


def preceded(record: Record, levels: Sequence[float]) -> Record:
    """Return the record with the voltage before it: from rest through `levels` to its first one.

    A model starts from the virgin state, an actuator hardly ever does: what it rests at depends
    on the last extremes of its voltage.

    Parameters
    ----------
    record : Record
        A measured record.
    levels : sequence of float
        Extremes of the voltage before the record, in order [V].

    Raises
    ------
    IdentificationError
        If a level is not finite.
    """
    if not np.all(np.isfinite(levels)):
        raise IdentificationError('the levels before a record must be finite voltages')
    before = path_to(record.voltage[:2], RecordStart('rest', tuple(map(float, levels))), record.dt)
    return replace(record, before=before, info=replace(record.info, start='step'))
