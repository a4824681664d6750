"""How much records of one kind differ although nothing was changed.

Records are of one kind if their drive has the same frequency, amplitude and waveform. What they
have in common of the error of a model is its known discrepancy; what differs is their scatter. A
new record is compared with it by one statistic, the surprise, in nats:

    S = sum over lines and octaves of ln max(P / E, 1)

P is the mean square of the deviation from the others, E that which they show among themselves.
The new record and the untouched ones are exchangeable if nothing was changed. With n untouched
records the chance that the new one has at least its rank is

    p = (1 + number of untouched records with at least its surprise) / (n + 1)

whatever the distribution (Vovk, Gammerman, Shafer: Algorithmic Learning in a Random World,
Springer 2005, chapter 2). It cannot be below 1 / (n + 1): few repeats support few names.
"""

from __future__ import annotations

from cmath import phase
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, log, log2, sqrt
from typing import TYPE_CHECKING

import numpy as np

from piezo_hysteresis.common.wording import counted

if TYPE_CHECKING:
    from piezo_hysteresis.models.discrepancy import Condition

#: Ratio of frequencies and of amplitudes up to which two drives repeat each other: a rig that
#: reverses at a position differs by some percent from run to run.
SAME_FREQUENCY, SAME_AMPLITUDE = 1.1, 1.05
#: Difference of the content of two drives up to which their waveform is the same.
SAME_FORM = 0.05
#: Share of the stroke that a model misses from which one record says nothing on the next one: all
#: of what it misses may then come with other phases. Below, so much of it as the square of the
#: share. Measured: pneumatic cylinders with 5 to 10 % differ by 0.5 to 2.7 times that.
UNREPEATED = 0.05
#: Share of the total below which no line and no octave is expected.
_LEAST = 0.01
#: Level at which a deviation from many repeats counts.
LEVEL = 0.05


@dataclass(frozen=True)
class Support:
    """What untouched records say on new ones."""

    count: int  # untouched records of each kind
    chance: float  # chance of such a deviation where nothing was changed [1]
    complete: bool = True  # whether each new record is of a kind with untouched records

    @property
    def attainable(self) -> float:
        """Smallest chance that so many records can show [1]."""
        return 1.0 / (self.count + 1.0)

    @property
    def deviates(self) -> bool:
        """Whether the new records deviate as far as the untouched ones can show, or at `LEVEL`."""
        return self.chance <= max(self.attainable, LEVEL) + 1e-9

    def to_dict(self) -> dict[str, float]:
        """Return the row of ``verdict.json``."""
        return {'records': self.count, 'p_value': self.chance, 'attainable': self.attainable}

    def sentence(self, named: bool) -> str:
        """Return what was compared, in words, and what follows for effects that are named."""
        shown = f'p = {self.chance:.2g}; {self.attainable:.2g} is the least that so many can show'
        if not self.deviates:
            return f'Untouched repeats deviate as far: {self.count} of them, {shown}.'
        which = 'none deviates' if self.chance <= self.attainable + 1e-9 else 'few deviate'
        bound = f', so no name has a probability above {1.0 - self.chance:.2g}' if named else ''
        return f'Of {counted(self.count, "untouched repeat")} {which} as far ({shown}){bound}.'


def are_alike(one: Condition, other: Condition) -> bool:
    """Return whether two records are of one kind."""
    if (one.frequency > 0.0) is not (other.frequency > 0.0):
        return False
    return (
        _ratio(one.frequency, other.frequency) <= SAME_FREQUENCY
        and _ratio(one.amplitude, other.amplitude) <= SAME_AMPLITUDE
        and same_form(one.drive, other.drive)
    )


def same_form(one: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Return whether two drives have the same waveform; an unknown one is like any."""
    if not one or not other:
        return True
    keys = {*one, *other}
    return all(abs(one.get(k, 0.0) - other.get(k, 0.0)) <= SAME_FORM for k in keys)


def form_name(drive: Mapping[int, float]) -> str:
    """Return the name of the waveform of a periodic drive."""
    known = {
        'a sine': {1: 1.0},
        'a triangle': {1: 1.0, 3: 1.0 / 9.0},
        'a square': {1: 1.0, 3: 1.0 / 3.0},
        'a sawtooth': {1: 1.0, 2: 0.5, 3: 1.0 / 3.0},
    }
    return next((name for name, form in known.items() if same_form(drive, form)), 'a waveform')


def kinds_of(rows: Iterable[Condition]) -> list[list[Condition]]:
    """Return the records by kind, in the order of frequency and amplitude.

    A chain of frequencies, each near the next, is a sweep and no repetition: only equal
    conditions are then of one kind.
    """
    groups: list[list[Condition]] = []
    for row in sorted(rows, key=lambda each: (each.frequency, each.amplitude)):
        near = [g for g in groups if any(are_alike(row, each) for each in g)]
        joined = [each for g in near for each in g] + [row]
        groups = [g for g in groups if g not in near] + [joined]
    found: list[list[Condition]] = []
    for group in groups:
        if all(are_alike(one, other) for one, other in pairwise([*group, group[0]])):
            found.append(group)
            continue
        equal: dict[tuple[str, str], list[Condition]] = {}
        for row in group:
            equal.setdefault((f'{row.frequency:.3g}', f'{row.amplitude:.3g}'), []).append(row)
        found += equal.values()
    return sorted(found, key=lambda g: (g[0].frequency, g[0].amplitude))


def together(rows: Sequence[Condition]) -> Condition:
    """Return records of one kind as one condition: what they share, and their scatter.

    The mean of n records is itself uncertain, so the scatter of a new record about it has
    (1 + 1 / n) times their variance.
    """
    count = len(rows)
    if count == 1:
        return rows[0]
    noises = [c.noise for c in rows if c.noise is not None]
    frequency = _geometric(c.frequency for c in rows)
    harmonics = _joined([c.harmonics for c in rows])
    scatter = _joined([c.scatter for c in rows])
    phases: dict[int, float] = {}
    turning = [_turning(c) for c in rows]
    for n in sorted(order for order in harmonics if order > 0):
        seen = [None if row is None else row.get(n, 0.0) for row in turning]
        if any(each is None for each in seen):
            between = float(np.std([c.harmonics.get(n, 0.0) for c in rows], ddof=1))
        else:
            every = np.array(seen, np.complex128)
            mean = complex(every.mean())
            between = float(np.std(every, ddof=1))
            harmonics[n], phases[n] = abs(mean), phase(mean)
        scatter[n] = sqrt(scatter.get(n, 0.0) ** 2 + (1.0 + 1.0 / count) * between**2)
    return replace(
        rows[0],
        frequency=frequency,
        amplitude=_geometric(c.amplitude for c in rows),
        stroke=root_mean_square(c.stroke for c in rows),
        rms=root_mean_square(c.rms for c in rows),
        noise=root_mean_square(noises) if noises else None,
        harmonics=harmonics,
        bands=_octaves(rows, frequency),
        phases=phases,
        scatter=scatter,
        records=count,
    )


def anew(row: Condition) -> float:
    """Return the share of the known discrepancy that may come anew on another record [1].

    That of several records is in their scatter.
    """
    return 0.0 if row.records > 1 else min(1.0, (row.share / UNREPEATED) ** 2)


def surprise(row: Condition, others: Sequence[Condition]) -> float:
    """Return how far a record is from others of its kind [nats]."""
    known = together(others)
    base = known.frequency
    mine, own = _by_octave(row, base), _by_octave(known, base)
    here, there = _turning(row), _turning(known)
    parts: list[tuple[float, float]] = []
    for n in sorted({*row.harmonics, *known.harmonics} - {0}):
        if here is None or there is None:
            parts.append((row.harmonics.get(n, 0.0) ** 2, known.harmonics.get(n, 0.0) ** 2))
            continue
        usual = known.scatter.get(n, 0.0) ** 2
        if known.records == 1:
            usual += abs(there.get(n, 0.0)) ** 2
        parts.append((abs(here.get(n, 0.0) - there.get(n, 0.0)) ** 2, usual))
    parts += [(mine.get(k, 0.0), own.get(k, 0.0)) for k in sorted({*mine, *own})]
    least = _LEAST * sum(usual for _, usual in parts) + 1e-300
    return sum(log(max(power / (usual + least), 1.0)) for power, usual in parts)


def support_of(new: Sequence[Condition], known: Iterable[Condition]) -> Support | None:
    """Return what untouched records say on new records.

    Several kinds count together, one record of each kind at a time.
    """
    kinds = [group for group in kinds_of(known) if len(group) > 1]
    own, usual = 0.0, np.zeros(0)
    counts: list[int] = []
    judged = 0
    for group in kinds:
        found = [row for row in new if any(are_alike(row, each) for each in group)]
        judged += len(found)
        for row in found:
            most = min([len(group), *counts])
            rows = [*group, row]
            ranks = [surprise(r, [o for o in rows if o is not r]) for r in rows]
            own += ranks[-1]
            usual = np.array(ranks[:most]) + (usual[:most] if counts else 0.0)
            counts.append(most)
    if not counts:
        return None
    chance = (1.0 + np.count_nonzero(usual >= own)) / (usual.size + 1.0)
    return Support(usual.size, float(chance), judged == len(new))


def _turning(row: Condition) -> dict[int, complex] | None:
    """Return the phasors of the harmonics [m]; None if one has no phase."""
    found = row.phasors
    return None if found is None else {n: row.stroke * each for n, each in found.items()}


def _octaves(rows: Sequence[Condition], frequency: float) -> dict[float, float]:
    """Return the rms by octave over records whose drives differ slightly in frequency."""
    tables = [_by_octave(row, row.frequency) for row in rows]
    base = sqrt(2.0) * frequency if frequency > 0.0 else 1.0
    keys = sorted({key for table in tables for key in table})
    means = {k: sum(table.get(k, 0.0) for table in tables) / len(tables) for k in keys}
    return {0.0 if k == -inf else base * 2.0**k: sqrt(each) for k, each in means.items()}


def _by_octave(row: Condition, frequency: float) -> dict[float, float]:
    """Return the mean squares by octave of the drive, or of 1 Hz; -inf is the mean."""
    base = sqrt(2.0) * frequency if frequency > 0.0 else 1.0
    found: dict[float, float] = {}
    for low, size in row.bands.items():
        key = float(round(log2(low / base))) if low > 0.0 else -inf
        found[key] = found.get(key, 0.0) + size**2
    return found


def _joined(tables: Sequence[Mapping[int, float]]) -> dict[int, float]:
    keys = sorted({key for table in tables for key in table})
    return {key: root_mean_square(table.get(key, 0.0) for table in tables) for key in keys}


def root_mean_square(sizes: Iterable[float]) -> float:
    """Return the root of the mean square, 0 of nothing."""
    squares = [float(size) ** 2 for size in sizes]
    return sqrt(sum(squares) / len(squares)) if squares else 0.0


def _geometric(sizes: Iterable[float]) -> float:
    found = np.array(list(sizes))
    if np.all(found == found[0]):
        return float(found[0])
    return float(np.exp(np.mean(np.log(found)))) if np.all(found > 0.0) else float(found.mean())


def _ratio(one: float, other: float) -> float:
    if one == other:
        return 1.0
    small, large = sorted((one, other))
    return large / small if small > 0.0 else inf
