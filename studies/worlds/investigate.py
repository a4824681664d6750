"""Actuator time to the right name: chosen experiments, random ones, and a fixed battery.

    python studies/study.py investigate --sets 8 --nulls 4 --seed 3
    python studies/study.py investigate --table --page docs/investigate_study.md

Actuators of `piezo_sim` with random numbers are identified, then one effect of random size is
switched on (in a null actuator none). Three ways to find out what changed see the same actuator,
each from its own beginning: `designed` runs what the investigation chooses, `random` runs the same
experiments in random order under the same rule to stop, `battery` runs the records of "Records
that make a verdict sharp" and looks once. For all three a record knows what went before it. Rows
that are there already are not run again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits
from piezo_hysteresis.investigation.experiment_choice import ExperimentChoice
from piezo_hysteresis.investigation.session import History, Investigation, Rules, Stop, investigate
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import from_spec
from studies.worlds.investigate_world import Bench, Changed, changed
from studies.worlds.simulated import load

Rows = Sequence[dict[str, Any]]
WAYS = ('designed', 'random', 'battery')
HEAD = (
    '| method | actuators | right | false names | median time at the end | median time to the '
    'right name |\n|---|---:|---:|---:|---:|---:|'
)
BUDGET = 200.0  # [s]
# What every experiment keeps: range [V], slew [V/s], frequency [Hz].
LIMITS = ExperimentLimits(-1.0, 1.0, slew=700.0, frequency=100.0)

BATTERY: tuple[dict[str, Any], ...] = (
    *(
        {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 4.0, 'ramp': 0.2}
        for a in (0.99, 0.5)
        for f in (1.0, 5.0, 14.0, 33.0, 100.0)
    ),
    {'kind': 'chirp', 'amplitude': 0.5, 'frequency': 1.0, 'highest': 100.0, 'duration': 5.0},
    {'kind': 'rest', 'duration': 30.0},
    {'kind': 'step', 'amplitude': 0.99, 'duration': 30.5},
    {'kind': 'reversal_curves', 'amplitude': 0.99, 'rate': 4.0},
)


def stroke_limit(world: Changed) -> ExperimentLimits:
    """Return the limits with a stroke of twice what the model does slowly."""
    slow = np.sin(2.0 * np.pi * np.arange(world.rate) / world.rate)
    answer = world.model.model.respond(slow, world.model.packed, 1.0 / world.rate)
    return ExperimentLimits(
        LIMITS.low, LIMITS.high, LIMITS.slew, LIMITS.frequency, 2.0 * np.ptp(answer)
    )


def by_choice(world: Changed, way: str, seed: int, budget: float) -> dict[str, Any]:
    """Investigate an actuator; `way` is designed or random."""
    limits = stroke_limit(world)
    investigation = Investigation(world.model, limits, world.rate, Rules(budget=budget))
    bench, rng = Bench(world), np.random.default_rng([seed, 7])

    def at_random(now: Investigation) -> ExperimentChoice | Stop:
        choice = now.next()
        ranked = now.ranked()
        return choice if isinstance(choice, Stop) else ranked[int(rng.integers(len(ranked)))]

    chooser = Investigation.next if way == 'designed' else at_random
    stop = investigate(investigation, bench.run, chooser=chooser)
    names = [answer.after.names for answer in investigation.answers]
    right_from = len(names)
    while right_from > 0 and world.right(names[right_from - 1]):
        right_from -= 1
    spent = [answer.spent for answer in investigation.answers]
    return {
        'found': names[-1],
        'stop': stop.reason,
        'seconds': spent[-1],
        'right_after': spent[right_from] if right_from < len(spent) else None,
        'asked': [answer.experiment.name for answer in investigation.answers],
        'extremes': bench.extremes,
    }


def by_battery(world: Changed) -> dict[str, Any]:
    """Run the fixed battery and look once."""
    bench, history, records = Bench(world), History(), list[Record]()
    for number, spec in enumerate(BATTERY):
        record = bench.measured(f'{number:02} {spec["kind"]}', from_spec(spec))
        info = RecordInfo(
            excitation=spec['kind'],
            frequency=spec['frequency'] if spec['kind'] == 'sine' else 0.0,
            amplitude=spec.get('amplitude', 0.0),
            warm_up=0.2,
        )
        records.append(history.following(replace(record, info=info)))
    found = tuple(effect.name for effect in discover(records, world.model).verdict.effects)
    return {
        'found': found,
        'stop': 'battery',
        'seconds': bench.seconds,
        'right_after': bench.seconds if world.right(found) else None,
    }


def examine(task: tuple[str, int, int, str, float]) -> dict[str, Any]:
    """Examine one actuator in one way."""
    kind, index, seed, way, budget = task
    began = time.process_time()
    world = changed(kind, index, seed)
    row = by_battery(world) if way == 'battery' else by_choice(world, way, seed + index, budget)
    return {
        'key': world.key,
        'kind': kind,
        'way': way,
        'hidden': world.effects,
        'baseline': world.model.model.name,
        'right': world.right(row['found']),
        'cpu': time.process_time() - began,
        **row,
    }


def told(row: dict[str, Any]) -> str:
    """Return one line about a row."""
    hidden = ' + '.join(row['hidden']) or 'nothing'
    found = ' + '.join(row['found']) or 'nothing'
    word = 'right' if row['right'] else 'WRONG'
    return (
        f'{row["key"]:14} {row["way"]:9} {hidden} -> {found}: {word}, {row["seconds"]:.1f} s '
        f'({row["stop"]}, {row["cpu"]:.0f} s of processor)'
    )


def wanted(words: argparse.Namespace) -> Iterator[tuple[str, int, int, str, float]]:
    """Yield what is asked for."""
    for kind, count in (('single', words.sets), ('null', words.nulls)):
        for index in range(count):
            for way in words.ways:
                yield kind, index, words.seed, way, words.budget


def table(rows: Rows) -> str:
    """Return the results, a line per kind and method."""
    lines = [HEAD]
    for kind in ('single', 'null'):
        for way in ('designed', 'random', 'battery'):
            some = [row for row in rows if row['kind'] == kind and row['way'] == way]
            if some:
                lines.append(_line(kind, way, some))
    return '\n'.join(lines)


def _line(kind: str, way: str, rows: Rows) -> str:
    right = sum(row['right'] for row in rows)
    wrong = sum(bool(row['found']) and not row['right'] for row in rows)
    to_right = [row['right_after'] for row in rows if row['right_after'] is not None]
    first = f'{median(to_right):.1f} s' if to_right and kind != 'null' else ''
    name = f'{way}, no effect' if kind == 'null' else way
    spent = median(row['seconds'] for row in rows)
    return f'| {name} | {len(rows)} | {right} | {wrong} | {spent:.1f} s | {first} |'


def goals(rows: Rows, budget: float, limits: tuple[float, float, float]) -> str:
    """Return the goals with the results."""
    # budget [s]; limits [V] [V/s]
    chosen, fixed = (
        {row['key']: row for row in rows if row['way'] == way and row['kind'] == 'single'}
        for way in ('designed', 'battery')
    )
    both = sorted(chosen.keys() & fixed.keys())
    nulls = [r['seconds'] for r in rows if r['kind'] == 'null' and r['way'] == 'designed']
    if not (both and nulls):
        return 'Rows of designed, battery and null actuators are needed to judge the goals.'
    right = [sum(way[key]['right'] for key in both) for way in (chosen, fixed)]
    spent = [median(way[key]['seconds'] for key in both) for way in (chosen, fixed)]
    early = sum(seconds <= 0.1 * budget for seconds in nulls)
    driven = [row['extremes'] for row in rows if 'extremes' in row]
    worst = min(e[0] for e in driven), max(e[1] for e in driven), max(e[2] for e in driven)
    return '\n'.join(
        (
            '| goal | result |',
            '|---|---|',
            (
                f'| at most a third of the time of the battery | {spent[0]:.1f} s of '
                f'{spent[1]:.1f} s: {spent[0] / spent[1]:.0%}, median over {len(both)} actuators |'
            ),
            (
                f'| right at least as often as the battery | {right[0]} of {len(both)}; the '
                f'battery {right[1]} |'
            ),
            (
                f'| no effect: ends within a tenth of {budget:g} s | {early} of '
                f'{len(nulls)}; longest {max(nulls):.1f} s |'
            ),
            (
                f'| commands within {limits[0]:g} .. {limits[1]:g} V and {limits[2]:g} V/s | '
                f'{worst[0]:.3g} .. {worst[1]:.3g} V, at most {worst[2]:.3g} V/s |'
            ),
        )
    )


def page(rows: Rows, seed: int, aims: str, remarks: str = '') -> str:
    """Return the page of documentation: what was aimed at, every row, and remarks."""
    each = [
        '| hidden | method | reported | time | end |\n|---|---|---|---:|---|',
        *(
            f'| {" + ".join(row["hidden"]) or "nothing"} | {row["way"]} | '
            f'{" + ".join(row["found"]) or "nothing"} | {row["seconds"]:.1f} s | {row["stop"]} |'
            for row in rows
        ),
    ]
    return (
        '# Investigation study: actuator time to the right effect\n\n'
        f'Written by `python studies/study.py investigate --table --seed {seed} --page '
        'docs/investigate_study.md`; the script describes the protocol. The actuators are '
        'simulated with random parameters. Times are actuator time, conditioning '
        'included.\n\n'
        f'{aims}\n\n{table(rows)}\n\n'
        'A result is right if it names the change and nothing else. '
        f'{remarks}All actuators:\n\n' + '\n'.join(each) + '\n'
    )


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=3)
    add = parser.add_argument
    add('--sets', type=int, default=8, help='actuators with one hidden effect')
    add('--nulls', type=int, default=4, help='actuators with none')
    add('--ways', nargs='+', choices=WAYS, default=list(WAYS))
    add('--out', type=Path, default=Path('out/investigate'))
    add('--table', action='store_true', help='only print what is there')
    add('--remarks', default='', help='sentences for the page')
    add('--budget', type=float, default=BUDGET, help='time of an actuator [s]')


QUICK = {'sets': 1, 'nulls': 0, 'ways': ['designed'], 'budget': 5.0}


def run(asked: argparse.Namespace) -> str:
    """Examine what is missing; return the page."""
    asked.out.mkdir(parents=True, exist_ok=True)
    results = asked.out / f'results_{asked.seed}.jsonl'
    if not asked.table:
        had = {(row['key'], row['way']) for row in load(results)}
        todo = [t for t in wanted(asked) if (f'{t[0]}-{t[2]}-{t[1]}', t[3]) not in had]
        with ProcessPoolExecutor(asked.workers) as pool, results.open('a') as file:
            for row in pool.map(examine, todo):
                file.write(json.dumps(row) + '\n')
                file.flush()
                print(told(row), flush=True)
    rows = load(results)
    aims = goals(rows, asked.budget, (LIMITS.low, LIMITS.high, LIMITS.slew))
    return page(rows, asked.seed, aims, asked.remarks)
