"""Discovery test: effects in an independent simulation with random recording conditions.

    python studies/study.py lottery --seed 31 --page docs/discovery_lottery.md

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

import numpy as np
from numpy.random import Generator

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.verdict.verdict import Verdict
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import named
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
HEAD = (
    '# Discovery test: random recording conditions',
    '',
    'The actuator is a Bouc-Wen hysteresis with one mode. It has one additional effect, two,',
    'none, or one that is not in the library. The initial condition (rest, step, mid-period,',
    'remanent), noise (white or coloured, constant or growing with the amplitude), zeros, 8 to',
    '16 bits, 0.2 to 20 kHz and the kinds of records are drawn by seed. The simulation shares',
    'no code with the models (`studies/worlds/lottery_world.py`). `discover` gets the records and',
    'the name `bouc_wen_mode`. The search is frozen before the draw.',
    '',
    '    python studies/study.py lottery --seed {seed} --page docs/discovery_lottery.md',
)


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
        if self.kind == 'outsider':
            return word == 'unknown' or bool(self.verdict and self.verdict.unexplained.significant)
        return set(self.names[: len(self.truth)]) == self.truth

    @property
    def told(self) -> str:
        """The verdict in a cell."""
        return in_a_cell(self.verdict) if self.verdict else f'refused: {self.refused}'


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
        *(('outsider', (UNKNOWN_EFFECTS[i % len(UNKNOWN_EFFECTS)],)) for i in range(others)),
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


def calibration(rows: Sequence[Row]) -> list[str]:
    """Return the frequency of right names by class of reported probability."""
    said = [
        (effect.probability, effect.name in row.truth)
        for row in rows
        if row.verdict
        for effect in row.verdict.effects
    ]
    lines = ['| probability | names | right |', '|---|---:|---:|']
    for low, high in ((0.0, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)):
        hits = [right for probability, right in said if low <= probability < high]
        if hits:
            lines.append(f'| {low:g} to {min(high, 1.0):g} | {len(hits)} | {sum(hits)} |')
    return lines


def page(rows: Sequence[Row], seed: int) -> str:
    """Return the page of docs."""

    def of(kind: str) -> list[Row]:
        return [row for row in rows if row.kind == kind]

    def counted(kind: str) -> str:
        return f'{sum(row.right for row in of(kind))} of {len(of(kind))}'

    named_sets = [*of('single'), *of('pair')]
    among = sum(row.truth <= set().union(*row.classes) for row in of('single'))
    besides = sum(bool(set(row.names) - row.truth) for row in named_sets)
    false = sum(any(row.truth.isdisjoint(c) for c in row.classes) for row in named_sets)
    worse = sum(
        row.verdict.held_out.gap_after_rms_m > 1.02 * row.verdict.held_out.gap_before_rms_m
        for row in rows
        if row.verdict
    )
    lines = [
        *(line.format(seed=seed) for line in HEAD),
        '',
        f'- single effects ranked first: {counted("single")}; first or in a stated class: {among}',
        f'- pairs, both ranked first: {counted("pair")}',
        f'- sets with a false positive: {besides} of {len(named_sets)}',
        f'- sets with an effect whose class lacks every hidden one: {false} of {len(named_sets)}',
        f'- no effect, reported as `none`: {counted("null")}',
        (
            f'- effects outside the library, `unknown` or with a stated residual: '
            f'{counted("outsider")}'
        ),
        f'- held-out error increased by more than 2 %: {worse} of {len(rows)}',
        f'- longest run: {max(row.seconds for row in rows):.0f} s on a busy machine',
        '',
        'Probabilities:',
        '',
        *calibration(rows),
        '',
        '| hidden | initial condition | noise | bits | rate Hz | reported | held out, floors |',
        '|---|---|---|---:|---:|---|---:|',
    ]
    for row in rows:
        c = row.conditions
        noise = f'{"coloured" if c.coloured else "white"}{", grows" if c.grows else ""}'
        gap = row.verdict.held_out if row.verdict else None
        held = f'{gap.before_in_floors:.2f} to {gap.after_in_floors:.2f}' if gap else ''
        lines.append(
            f'| {" and ".join(row.hidden) or "nothing"} | {c.start} | {noise} | {c.bits} | '
            f'{c.rate:.0f} | {"" if row.right else "**wrong** "}{row.told} | {held} |'
        )
    return '\n'.join(lines) + '\n'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.add_argument('--count', type=json.loads, default=[SINGLES, PAIRS, NULLS, OTHERS])


QUICK = {'count': [1, 0, 0, 0], 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> str:
    """Examine every set; return the page."""
    rows: list[Row] = []
    for place, (kind, hidden) in enumerate(sets(asked.count)):
        rows.append(examined(kind, hidden, (asked.seed, place), asked.workers, asked.time_limit))
        row = rows[-1]
        sign = '' if row.right else ' WRONG'
        print(f'{kind} {hidden}{sign}: {row.told} ({row.seconds:.0f} s)', flush=True)
    return page(rows, asked.seed)
