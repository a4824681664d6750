"""Discovery test: effects in an independent simulation with random recording conditions.

    python studies/study.py lottery --seed 31 --exams docs/exams.json

What hides and how it is recorded is in `studies/worlds/lottery_world.py`, which shares no physics
with the suite. `discover` gets the records and the name of a baseline, nothing else.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.verdict.verdict import Verdict
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import named
from studies.exams import Exam, counted
from studies.worlds.lottery_world import (
    EFFECTS,
    UNKNOWN_EFFECTS,
    Conditions,
    drawn_actuator,
    drawn_conditions,
    recorded,
    with_hidden,
)
from studies.worlds.scores import in_a_cell

BASELINE = 'bouc_wen_mode'
SINGLES, PAIRS, NULLS, OTHERS = 33, 10, 20, 6


@dataclass(frozen=True)
class Row:
    """One set and its verdict; no verdict if the records were refused."""

    kind: str
    hidden: tuple[str, ...]
    conditions: Conditions
    verdict: Verdict | None
    refused: str
    seconds: float

    @property
    def truth(self) -> set[str]:
        """Names of what is hidden."""
        return {EFFECTS[name] for name in self.hidden if name in EFFECTS}

    @property
    def names(self) -> list[str]:
        """What was named, in order."""
        return [effect.name for effect in self.verdict.effects] if self.verdict else []

    @property
    def classes(self) -> list[tuple[str, ...]]:
        """The class of each named effect, in order."""
        return [effect.effect_class for effect in self.verdict.effects] if self.verdict else []

    @property
    def right(self) -> bool:
        """Whether the verdict is right, with the hidden effects ranked first."""
        word = self.verdict.verdict if self.verdict else 'refused'
        if self.kind == 'null':
            return word == 'none'
        if self.kind == 'outside':
            return word == 'unknown' or bool(self.verdict and self.verdict.unexplained.significant)
        return set(self.names[: len(self.truth)]) == self.truth

    @property
    def told(self) -> str:
        """The verdict in a cell."""
        return in_a_cell(self.verdict) if self.verdict else f'refused: {self.refused}'

    @property
    def cells(self) -> dict[str, Any]:
        """The row of the exam."""
        c, gap = self.conditions, self.verdict.held_out if self.verdict else None
        return {
            'hidden': ' and '.join(self.hidden) or 'nothing',
            'start': c.start,
            'noise': f'{"coloured" if c.coloured else "white"}{", grows" if c.grows else ""}',
            'bits': c.bits,
            'rate_hz': round(c.rate),
            'reported': self.told,
            'right': self.right,
            'before_floors': round(gap.before_in_floors, 2) if gap else None,
            'after_floors': round(gap.after_in_floors, 2) if gap else None,
        }


def sets(count: Sequence[int]) -> list[tuple[str, tuple[str, ...]]]:
    """Return the hidden effects of each set: singles, pairs, nulls, unknown effects."""
    names, singles, pairs, nulls, others = list(EFFECTS), *count
    return [
        *(('single', (names[i % len(names)],)) for i in range(singles)),
        *(
            ('pair', (names[i % len(names)], names[(3 * i + 4) % len(names)]))
            for i in range(pairs)
        ),
        *(('null', ()) for _ in range(nulls)),
        *(('outside', (UNKNOWN_EFFECTS[i % len(UNKNOWN_EFFECTS)],)) for i in range(others)),
    ]


def examined(
    kind: str,
    hidden: tuple[str, ...],
    seed: Sequence[int],
    workers: int = 1,
    limit: float = math.inf,
) -> Row:
    """Draw one set, ask for its verdict and compare."""
    random: Generator = np.random.default_rng(seed)
    conditions, plain = drawn_conditions(random), drawn_actuator(random)
    actuator = with_hidden(plain, conditions, hidden, random)
    records = recorded(actuator, conditions, random)
    started = time.perf_counter()
    verdict, refused = None, ''
    try:
        found = discover(records, named(BASELINE), seed=1, workers=workers, time_limit=limit)
        verdict = found.verdict
    except PiezoError as error:
        refused = str(error)
    return Row(kind, hidden, conditions, verdict, refused, time.perf_counter() - started)


def exam(rows: Sequence[Row], seed: int) -> Exam:
    """Return the exam of all sets."""
    gaps = [row.verdict.held_out for row in rows if row.verdict]
    worse = sum(gap.gap_after_rms_m > 1.02 * gap.gap_before_rms_m for gap in gaps)
    counts = {**counted(rows), 'worse': (worse, len(rows))}
    longest = max(row.seconds for row in rows)
    return Exam('lottery', seed, counts, [row.cells for row in rows], seconds=round(longest))


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.add_argument('--count', type=json.loads, default=[SINGLES, PAIRS, NULLS, OTHERS])


QUICK = {'count': [1, 0, 0, 0], 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> list[Exam]:
    """Examine every set."""
    rows: list[Row] = []
    for place, (kind, hidden) in enumerate(sets(asked.count)):
        rows.append(examined(kind, hidden, (asked.seed, place), asked.workers, asked.time_limit))
        row = rows[-1]
        sign = '' if row.right else ' WRONG'
        print(f'{kind} {hidden}{sign}: {row.told} ({row.seconds:.0f} s)', flush=True)
    return [exam(rows, asked.seed)]
