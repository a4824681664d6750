"""Blind test of the discovery: hidden effects of random size, found from the records alone.

    python studies/study.py simulated --kind all --sets 100 --workers 2

Every set is simulated by `piezo_sim`, written as a bag and given to `python -m piezo_hysteresis
discover` in a separate process, which gets only the bag and the baseline. The truth stays in the
memory of this process and is written (out/discovery/results.jsonl) only after the verdict. An
interrupted run continues where it stopped; --table prints the results so far.

What an effect of the simulator may be called is stated in `simulated_world.KNOBS`: backlash is
friction, a second mode a resonance, floor vibration a tone (mains_hum), both creep laws creep, a
play bank or Preisach plane that a Bouc-Wen baseline meets is nonlocal_memory and one that a linear
baseline meets is hysteresis, the bandwidth of the sensor a lag.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from piezo_hysteresis.records import write_bag
from studies.exams import Exam, commit
from studies.worlds.scores import KINDS, exam, named
from studies.worlds.simulated_world import Hidden, draw, records_of

# So long may one set take before it counts as a failure [s].
TIMEOUT = 1800


def discover(bag: Path, baseline: str, seed: int, how: Sequence[str]) -> dict[str, Any]:
    """Run the command on a bag in a process of its own and return its verdict."""
    out = bag.parent / 'verdict'
    command = [sys.executable, '-m', 'piezo_hysteresis', 'discover', str(bag)]
    command += ['--baseline', baseline, '--out', str(out), '--seed', str(seed)]
    command += ['--time-limit', '0']
    command += how
    try:
        done = subprocess.run(
            command, cwd=bag.parent, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return {'verdict': 'refused', 'effects': [], 'said': f'no verdict within {TIMEOUT} s'}
    if done.returncode != 0:
        return {'verdict': 'refused', 'effects': [], 'said': (done.stderr or done.stdout)[-2000:]}
    found: dict[str, Any] = json.loads((out / 'verdict.json').read_text(encoding='utf-8'))
    return found


def examine(hidden: Hidden, seed: int, how: Sequence[str]) -> dict[str, Any]:
    """Make a set, have it examined, and put verdict and answer side by side."""
    records = records_of(hidden)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / 'records'
        write_bag(bag, records)
        verdict = discover(bag, hidden.world.baseline, seed, how)
    row: dict[str, Any] = {
        'key': hidden.key,
        'kind': hidden.kind,
        'design': hidden.design,
        'world': hidden.world.name,
        'baseline': hidden.world.baseline,
        'hidden': hidden.effects,
        'names': hidden.names,
        'size_in_floors': hidden.floors,
        'noise_db': hidden.noise_db,
        'samples': sum(len(record) for record in records),
        'overrides': dict(hidden.world.overrides),
        'commit': commit(),
    }
    empty = {'held_out': {'after_in_floors': float('inf')}, 'seconds': float('nan')}
    kept = ('verdict', 'effects', 'held_out', 'seconds', 'summary', 'suspects', 'unexplained')
    return row | empty | {key: verdict[key] for key in (*kept, 'said') if key in verdict}


def wanted(kinds: Iterable[str], sets: int, seed: int, design: str) -> list[tuple[Any, ...]]:
    """Return (kind, index, seed, design) of every set, kinds in turn."""
    return [(kind, index, seed, design) for index in range(sets) for kind in kinds]


def told(row: dict[str, Any]) -> str:
    """Return one line about a set."""
    hidden = ' + '.join(row['hidden']) or 'nothing'
    sizes = ' '.join(f'{size:.3g}' for size in row['size_in_floors'])
    gap = row['held_out'].get('before_in_floors', float('nan'))
    return (
        f'{row["key"]:26} {row["world"]:10} {hidden} ({sizes}) -> {" + ".join(named(row))}; '
        f'{gap:.3g} -> {row["held_out"]["after_in_floors"]:.3g} floors, {row["seconds"]:.0f} s'
    )


def examine_all(
    todo: Sequence[tuple[Any, ...]], results: Path, workers: int, how: Sequence[str]
) -> None:
    """Examine sets side by side and append what comes out; `how` are words for `discover`."""

    def one(task: tuple[Any, ...]) -> dict[str, Any]:
        return examine(draw(*task), 0, how)

    with ThreadPoolExecutor(workers) as pool, results.open('a', encoding='utf-8') as file:
        for row in pool.map(one, todo):
            file.write(json.dumps(row) + '\n')
            file.flush()
            print(told(row), flush=True)


def load(results: Path) -> list[dict[str, Any]]:
    """Return the rows that are there already."""
    if not results.is_file():
        return []
    return [json.loads(line) for line in results.read_text(encoding='utf-8').splitlines()]


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=1, workers=os.cpu_count() or 1)
    add = parser.add_argument
    add('--sets', type=int, default=10, help='of each kind')
    add('--kind', choices=[*KINDS, 'all'], default='all')
    add('--design', choices=['careful', 'poor'], default='careful')
    add('--only', help='sets that hide this effect')
    add('--threads', type=int, default=1, help='of each of the sets that run at a time')
    add('--out', type=Path, default=Path('out/discovery'))
    add('--table', action='store_true', help='only print what is there')


QUICK = {'sets': 1, 'kind': 'single', 'time_limit': 3.0}


def run(asked: argparse.Namespace) -> list[Exam]:
    """Examine what is missing; the exam is of all sets of the seed that are there."""
    asked.out.mkdir(parents=True, exist_ok=True)
    results = asked.out / 'results.jsonl'
    kinds = KINDS if asked.kind == 'all' else (asked.kind,)
    if not asked.table:
        known = {row['key'] for row in load(results)}
        todo = [
            task
            for task in wanted(kinds, asked.sets, asked.seed, asked.design)
            if f'{task[0]}-{task[3]}-{task[2]}-{task[1]}' not in known
        ]
        if asked.only:
            todo = [task for task in todo if asked.only in draw(*task).effects]
        how = ['--workers', str(asked.threads)]
        if math.isfinite(asked.time_limit):
            how += ['--time-limit', str(asked.time_limit)]
        examine_all(todo, results, asked.workers, how)
    rows = [row for row in load(results) if row['key'].split('-')[2] == str(asked.seed)]
    return [exam(rows, asked.seed)]
