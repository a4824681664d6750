"""Recorded voltages: what `discover` names when the input is measured and not commanded.

Actuators of five kinds are simulated (`simulated_world`), and an error is added to the voltage
that the actuator felt: white noise, mains pick-up, steps of a converter, or a monitor of 100 Hz
with noise whose readings are held. In a null the baseline describes the actuator, and every name
is false; the size is drawn between 0.01 and 1 % of the range. In a single one effect is hidden,
the size is 0.1 %, and the same records with the exact voltage are examined for comparison.

    python studies/study.py recorded_voltage --seed 1 --nulls 8 --singles 4
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.records import Record
from studies.worlds.scores import interval
from studies.worlds.simulated_world import draw, records_of

KINDS = ('white', 'mains', 'quantised', 'held')
SMALLEST, LARGEST, OF_SINGLES = 1e-4, 1e-2, 1e-3  # share of the range
FASTEST = 60.0  # drive [Hz]
MONITOR = 100.0  # rate of the held readings [Hz]
POOR = 2  # of three nulls have three sines only, the other has the records of a careful lab


@dataclass(frozen=True)
class Row:
    """One set: what was done to it and what was named, with the exact voltage and without."""

    key: str
    world: str
    hidden: tuple[str, ...]
    names: tuple[str, ...]
    kind: str
    share: float
    named: tuple[str, ...]
    exact: tuple[str, ...]
    measured: int  # records whose voltage was called measured
    of: int
    seconds: float


def recorded(
    u: FloatArray, dt: float, kind: str, share: float, mains: float, rng: np.random.Generator
) -> FloatArray:
    """Return a voltage with an error of a kind; `share` is its rms over the range."""
    size = share * float(np.ptp(u)) or share
    noise = size * rng.standard_normal(u.size)
    if kind == 'mains':
        turn = 2.0 * np.pi * mains * dt * np.arange(u.size)
        hum = 2.0**0.5 * size * np.sin(turn + rng.uniform(-np.pi, np.pi))
        return np.asarray(u + hum + 0.1 * noise)
    if kind == 'quantised':
        step = np.sqrt(12.0) * size
        return np.asarray(np.round(u / step) * step)
    if kind == 'held':
        hold = round(1.0 / (MONITOR * dt))
        return np.asarray((u + noise)[np.arange(u.size) // hold * hold])
    return u + noise


def names_in(
    records: Sequence[Record], baseline: str, limit: float
) -> tuple[tuple[str, ...], int]:
    """Return the names that were given, and for how many records the voltage was measured."""
    try:
        found = discover(records, baseline, time_limit=limit, recommend=False)
    except PiezoError as error:
        return (f'refused: {error}',), 0
    measured = sum('measured, not commanded' in each for each in found.check.findings)
    if found.verdict.verdict != 'named':
        return (() if found.verdict.verdict == 'none' else (found.verdict.verdict,)), measured
    return tuple(effect.name for effect in found.verdict.effects), measured


def examined(what: str, index: int, seed: int, limit: float) -> Row:
    """Draw a set, record its voltage and have it examined."""
    poor = what == 'null' and index // len(KINDS) % (POOR + 1) < POOR
    hidden = draw(what, index, seed, 'poor' if poor else 'careful')
    slow = tuple(each for each in hidden.specs if each.get('frequency', 0.0) <= FASTEST)
    hidden = replace(hidden, specs=slow)
    rng = np.random.default_rng([seed, index, 77])
    share = OF_SINGLES
    if what == 'null':
        share = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
    kind = KINDS[index % len(KINDS)]
    exact = records_of(hidden)
    mains = float(rng.choice([50.0, 60.0]))  # one instrument is at one mains
    records = [
        replace(each, voltage=recorded(each.voltage, each.dt, kind, share, mains, rng))
        for each in exact
    ]
    began = time.perf_counter()
    named, measured = names_in(records, hidden.world.baseline, limit)
    seconds = time.perf_counter() - began
    without = names_in(exact, hidden.world.baseline, limit)[0] if hidden.effects else ()
    names = tuple(name for names in hidden.names for name in names)
    world = hidden.world.name
    return Row(
        hidden.key, world, hidden.effects, names, kind, share, named, without, measured,
        len(records), seconds,
    )  # fmt: skip


def table(rows: Sequence[Row]) -> str:
    """Return the table of the page."""
    lines = [
        '| voltage | false names in nulls | `unknown` | singles: exact | of these, recorded |',
        '|---|---|---|---|---|',
    ]
    for kind in (*KINDS, 'all'):
        own = [row for row in rows if kind in (row.kind, 'all')]
        nulls = [row for row in own if not row.hidden]
        false = sum(bool(set(row.named) - {'unknown'}) for row in nulls)
        unknown = sum('unknown' in row.named for row in nulls)
        singles = [row for row in own if row.hidden]
        seen = [row for row in singles if set(row.names) & set(row.exact)]
        still = sum(bool(set(row.names) & set(row.named)) for row in seen)
        lines.append(
            f'| {kind} | {interval(false, len(nulls))} | {unknown} '
            f'| {len(seen)} of {len(singles)} | {interval(still, len(seen))} |'
        )
    return '\n'.join(lines)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=1, time_limit=60.0)
    parser.add_argument('--nulls', type=int, default=8)
    parser.add_argument('--singles', type=int, default=4)
    parser.add_argument('--out', type=Path, default=Path('out/recorded_voltage'))


QUICK = {'nulls': 1, 'singles': 0, 'time_limit': 3.0}


def run(asked: argparse.Namespace) -> str:
    """Examine nulls and singles; return the table."""
    asked.out.mkdir(parents=True, exist_ok=True)
    rows = []
    counts = {'null': asked.nulls, 'single': asked.singles}
    tasks = [(k / count, what, k) for what, count in counts.items() for k in range(count)]
    with (asked.out / f'seed_{asked.seed}.jsonl').open('w', encoding='utf-8') as file:
        for _, what, index in sorted(tasks):  # any part of a run has both kinds
            row = examined(what, index, asked.seed, asked.time_limit)
            rows.append(row)
            print(json.dumps(asdict(row)), file=file, flush=True)
            print(
                f'{row.key:20} {row.world:10} {row.kind:9} {100 * row.share:.3g} % '
                f'{row.hidden} -> {row.named}; exact {row.exact}; measured {row.measured} of '
                f'{row.of}, {row.seconds:.0f} s',
                flush=True,
            )
    return table(rows)
