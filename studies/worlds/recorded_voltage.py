"""Recorded voltages: what `discover` names when the input is measured and not commanded.

Actuators of five kinds are simulated (`simulated_world`), and an error is added to the voltage
that the actuator felt: white noise, mains pick-up, steps of a converter, or a monitor of 100 Hz
with noise whose readings are held. In a null the baseline describes the actuator, and every name
is false; the size is drawn between 0.01 and 1 % of the range. In a single one effect is hidden,
the size is 0.1 %, and the same records with the exact voltage are examined for comparison.

With `--draws` parameters are identified from voltages with such errors of 0.5 %, and are compared
with those that the exact voltage gives: how far their mean is off, in stated deviations, and how
far it would be if the voltage were taken as exact.

    python studies/study.py recorded_voltage --seed 1 --nulls 8 --singles 4
    python studies/study.py recorded_voltage --seed 1 --nulls 0 --singles 0 --draws 6
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.errors import IdentificationError, PiezoError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.record import InputUncertainty
from studies.worlds.scores import interval
from studies.worlds.simulated_world import Hidden, draw, records_of

KINDS = ('white', 'mains', 'quantised', 'held')
SMALLEST, LARGEST, OF_SINGLES = 1e-4, 1e-2, 1e-3  # share of the range
OF_BIAS, AS_EXACT = (
    5e-3,
    2,
)  # share of the range, and draws for which the voltage is taken as exact
WORLDS = ('static', 'off_centre', 'mode', 'linear', 'play')
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
    u: FloatArray, dt: float, kind: str, size: float, mains: float, rng: np.random.Generator
) -> FloatArray:
    """Return a voltage with an error of a kind and `size` [V rms]."""
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


def all_recorded(
    records: Sequence[Record], kind: str, share: float, mains: float, rng: np.random.Generator
) -> list[Record]:
    """Return records with an error of `share` of their range; a converter has one step for all."""
    ranges = [float(np.ptp(each.voltage)) for each in records]
    if kind == 'quantised':
        ranges = [max(ranges)] * len(records)
    return [
        replace(r, voltage=recorded(r.voltage, r.dt, kind, share * (reach or 1.0), mains, rng))
        for r, reach in zip(records, ranges, strict=True)
    ]


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
    hidden = _slow(draw(what, index, seed, 'poor' if poor else 'careful'))
    rng = np.random.default_rng([seed, index, 77])
    share = OF_SINGLES
    if what == 'null':
        share = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
    kind = KINDS[index % len(KINDS)]
    exact = records_of(hidden)
    mains = float(rng.choice([50.0, 60.0]))  # one instrument is at one mains
    records = all_recorded(exact, kind, share, mains, rng)
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


def _slow(hidden: Hidden) -> Hidden:
    """Return a set without drives that a monitor cannot follow."""
    return replace(
        hidden, specs=tuple(s for s in hidden.specs if s.get('frequency', 0.0) <= FASTEST)
    )


@dataclass(frozen=True)
class Bias:
    """Mean error of each parameter by the error of a voltage, in stated deviations."""

    world: str
    kind: str
    names: tuple[str, ...]
    bias: tuple[float, ...]
    as_exact: tuple[float, ...]  # if the voltage is taken as exact
    seconds: float


def biases(name: str, seed: int, draws: int) -> Iterator[Bias]:
    """Yield the bias of the parameters of the first careful null of a world, by kind of error."""
    nulls = (draw('null', index, seed) for index in itertools.count())
    hidden = _slow(next(null for null in nulls if null.world.name == name))
    exact = records_of(hidden)
    truth = identify(exact, hidden.world.baseline)
    known = tuple(name for name in truth.names if name in truth.std)  # no clock

    def off(records: Sequence[Record]) -> list[float]:
        found = identify(records, hidden.world.baseline)
        own = [n if n in found.std else None for n in known]  # None: not determined
        return [(found.values[n] - truth.values[n]) / found.std[n] if n else np.nan for n in own]

    for kind in KINDS:
        began, errors, naive = time.perf_counter(), [], []
        for k in range(1 if kind == 'quantised' else draws):  # rounding draws nothing
            rng = np.random.default_rng([seed, k, KINDS.index(kind), 78])
            mains = float(rng.choice([50.0, 60.0]))
            made = all_recorded(exact, kind, OF_BIAS, mains, rng)
            errors.append(off(made))
            if k < AS_EXACT:
                given = [replace(r, input_uncertainty=InputUncertainty(0)) for r in made]
                with contextlib.suppress(IdentificationError):  # refused is nan
                    naive.append(off(given))
        mean, without = (_mean(each, len(known)) for each in (errors, naive))
        yield Bias(name, kind, known, mean, without, time.perf_counter() - began)


def _mean(errors: Sequence[Sequence[float]], count: int) -> tuple[float, ...]:
    return tuple(map(float, np.mean(errors, axis=0))) if errors else (np.nan,) * count


def table_of_bias(found: Sequence[Bias]) -> str:
    """Return the table of the page on bias."""
    lines = [
        '| actuator | voltage | parameters within one deviation | largest bias | taken as exact |',
        '|---|---|---|---|---|',
    ]
    for each in found:
        sizes, naive = np.abs(each.bias), np.abs(each.as_exact)
        worst = int(np.nanargmax(sizes))
        without = f'{np.nanmax(naive):.2g}' if np.any(np.isfinite(naive)) else 'refused'
        lines.append(
            f'| {each.world} | {each.kind} | {int(np.sum(sizes <= 1.0))} of {sizes.size} '
            f'| {each.names[worst]} {each.bias[worst]:+.2f} | {without} |'
        )
    return '\n'.join(lines)


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
    parser.add_argument('--draws', type=int, default=0, help='voltages for each bias')
    parser.add_argument('--worlds', nargs='+', default=WORLDS, choices=WORLDS)
    parser.add_argument('--out', type=Path, default=Path('out/recorded_voltage'))


QUICK = {'nulls': 1, 'singles': 0, 'time_limit': 3.0, 'draws': 1, 'worlds': ('linear',)}


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
    found = []
    for name in asked.worlds if asked.draws else ():
        for each in biases(name, asked.seed, asked.draws):
            found.append(each)
            print(json.dumps(asdict(each)), flush=True)
    parts = ([table(rows)] if rows else []) + ([table_of_bias(found)] if found else [])
    return '\n\n'.join(parts)
