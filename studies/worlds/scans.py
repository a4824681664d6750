"""Why does a scan lag? Triangles at two speeds, one cause in each drive.

Each drive is a gain with one of six causes of random size: a delay, a lag, a play, a hysteresis
that has settled, creep, or a hysteresis at rest before, so that the first cycle differs. Range,
rate, speeds, number of cycles and noise are random. ``discover --baseline gain`` names the cause.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record

#: Cause, the effect that is its name, and the parameter that is its size.
CAUSES = {
    'delay': ('transport_delay', 'delay'),
    'lag': ('amplifier_lag', 'lag_time'),
    'play': ('friction', 'backlash'),
    'hysteresis': ('hysteresis', ''),
    'creep': ('creep', 'creep_per_decade'),
    'first_cycle': ('hysteresis', ''),
}
QUICK = {'drives': 6, 'time_limit': 20.0}


@dataclass(frozen=True)
class Drive:
    """One drive: its cause, the true size of it in SI units (nan without one), and its scans."""

    cause: str
    size: float
    scans: tuple[Record, ...]


@dataclass(frozen=True)
class Row:
    """What the discovery says of a drive."""

    cause: str
    size: float
    found: float
    names: tuple[str, ...]
    first_cycle: bool
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the first name is the cause, and the first cycle is distinguished."""
        named = self.names[:1] == (CAUSES[self.cause][0],)
        return named and (self.cause != 'first_cycle' or self.first_cycle)


def drawn(cause: str, seed: int, number: int) -> Drive:
    """Return a random drive with one cause."""
    rng = np.random.default_rng((seed, number))
    rate, span = float(rng.choice([2000, 5000, 10000])), float(rng.choice([10, 60, 100, 150]))
    gain, noise = float(rng.uniform(0.03, 0.3)) * 1e-6, float(rng.uniform(3e-4, 1e-3))
    slow = float(rng.uniform(0.5, 3.0))
    speeds = slow, slow * float(rng.uniform(5.0, 12.0))
    cycles = int(rng.choice([3, 8] if cause == 'first_cycle' else [1, 3, 8]))
    share = float(rng.uniform(0.05, 0.2) if cause in ('hysteresis', 'first_cycle') else 0.0)
    seconds = float(rng.uniform(0.5e-3, 4e-3))
    play = float(rng.uniform(0.01, 0.05)) * span
    creep = float(rng.uniform(0.01, 0.05))
    scans = []
    for speed in speeds:
        t = np.arange(round(cycles * rate / speed)) / rate
        u = 0.9 * span * (1.0 - np.abs(2.0 * ((speed * t) % 1.0) - 1.0))
        moved = u
        if cause == 'delay':
            moved = np.interp(t - seconds, t, u)
        elif cause == 'lag':
            moved = _filtered(u, math.exp(-1.0 / (rate * seconds)))
        elif cause == 'play':
            moved = _played(u, play)
        elif cause == 'creep':
            slow_parts = [_filtered(u, math.exp(-1.0 / (rate * tau))) for tau in _TIMES]
            moved = u + creep / 2.0 * np.sum(slow_parts, axis=0)
        elif share:
            before = u if cause == 'hysteresis' else u[:0]
            whole = np.concatenate([before, u])
            loops = [_played(whole, reach * span) for reach in np.linspace(0.0, 0.5, 8)[1:]]
            moved = (1.0 - share) * u + share / 3.0 * np.sum(loops, axis=0)[before.size :]
        y = gain * (moved + noise * span * rng.normal(size=u.size))
        scans.append(Record(f'scan_{speed:.3g}Hz', 1.0 / rate, u, y))
    # a displacement answers the voltage of the tick before: that tick is no delay
    size = {'delay': seconds - 1.0 / rate, 'lag': seconds, 'play': gain * play, 'creep': creep}
    return Drive(cause, size.get(cause, math.nan), tuple(scans))


_TIMES = np.logspace(-2.0, 2.0, 9)  # of creep, two per decade [s]


def _filtered(u: FloatArray, pole: float) -> FloatArray:
    y, state = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        y[k] = state
        state = pole * state + (1.0 - pole) * value
    return y


def _played(u: FloatArray, reach: float) -> FloatArray:
    y, state = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        state = y[k] = min(max(state, value - reach), value + reach)
    return y


def examined(number: int, seed: int, time_limit: float) -> Row:
    """Draw a drive and return what the discovery says of it."""
    drive = drawn(list(CAUSES)[number % len(CAUSES)], seed, number)
    started = time.perf_counter()
    limit = time_limit if math.isfinite(time_limit) else 0.0
    verdict = ph.discover(drive.scans, 'gain', seed=seed, time_limit=limit).verdict
    wanted = CAUSES[drive.cause][1]
    sizes = (
        each.value
        for effect in verdict.effects[:1]
        for name, each in effect.parameters.items()
        if wanted and name.endswith(wanted)
    )
    first = any(lag.first_cycle_m is not None for lag in verdict.two_way)
    names = tuple(each.name for each in verdict.effects)
    seconds = time.perf_counter() - started
    return Row(drive.cause, drive.size, next(sizes, math.nan), names, first, seconds)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.add_argument('--drives', type=int, default=20, help='number of drives')


def run(asked: argparse.Namespace) -> str:
    """Return the table of the drives."""
    one = partial(examined, seed=asked.seed, time_limit=asked.time_limit)
    with ProcessPoolExecutor(asked.workers) as pool:
        return table(list(pool.map(one, range(asked.drives))))


def table(rows: Sequence[Row]) -> str:
    """Return the rows as text, with the number of right ones."""
    lines = [f'{sum(row.right for row in rows)} of {len(rows)} right', '']
    lines += ['| cause | size | found | names | |', '|---|---:|---:|---|---|']
    for row in rows:
        size, found = (f'{x:.3g}' if math.isfinite(x) else '' for x in (row.size, row.found))
        names = ', '.join(row.names) + (', first cycle' if row.first_cycle else '')
        verdict = 'right' if row.right else 'wrong'
        lines.append(f'| {row.cause} | {size} | {found} | {names} | {verdict} |')
    return '\n'.join(lines)
