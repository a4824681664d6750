"""Investigation of actuators from the literature that share no code with the models.

    python studies/study.py investigate_foreign --seed 3

Maxwell slip with a mode, Duhem and Dahl (`studies/worlds/foreign_world.py`) are identified on six
sines. Then one effect of random size begins, or none, the actuator moves in a way that no record
shows, and `investigate` runs its own experiments. The voltage is that of a converter: it moves to
the next level in a tenth of a tick and holds it, and the effect acts between the ticks, too. The
state of the actuator, the clock and the effect continue from one experiment to the next.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, PlannedExperiment
from piezo_hysteresis.identification import identify
from piezo_hysteresis.investigation.session import Investigation, Rules, investigate
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record
from piezo_hysteresis.waveforms import from_spec
from studies.worlds.foreign import FITTED
from studies.worlds.foreign_world import DAHL, NOISE, PARTS, RATE, STROKE, WORLDS, Array, World
from studies.worlds.hidden import HIDDEN, Case, chain
from studies.worlds.investigate_world import PAUSE, earlier_motion

#: World and the model that a lab would take for it.
ACTUATORS: dict[str, tuple[World, str]] = {
    'Maxwell slip': (WORLDS['elastoslides'], 'prandtl_ishlinskii+mode'),
    'Duhem': (WORLDS['Duhem'], 'bouc_wen_mode'),
    'Dahl': (DAHL, 'bouc_wen_mode'),
}
LIMITS = ExperimentLimits(-1.0, 1.0, slew=700.0, frequency=100.0, stroke=4.0 * STROKE)
#: Time in which a drift or a loss reaches its size, and the largest delay or lag [s].
SLOW, DELAY = 20.0, 4e-3
BUDGET = 200.0  # [s]


@dataclass
class Stage:
    """An actuator that keeps its state between experiments."""

    world: World
    effect: str  # key of `HIDDEN`
    size: float  # size of the effect, 0.25 to 1
    random: np.random.Generator  # source of the noise
    _state: Array = field(init=False)
    _level: float = 0.0
    _moved: list[Array] = field(default_factory=list)
    _shown: int | None = None

    def __post_init__(self) -> None:
        self._state = np.zeros(self.world.states)

    def run(self, experiment: PlannedExperiment) -> Record:
        """Return the record of an experiment."""
        return self.measured(experiment.name, experiment.voltage(RATE))

    def measured(self, name: str, voltage: Array) -> Record:
        """Return the record of a voltage [V] after a pause at 0 V."""
        if self._shown is not None:
            self.move(np.zeros(round(PAUSE * RATE)))
        first = sum(part.size for part in self._moved) // PARTS
        self._shown = first if self._shown is None else self._shown
        displacement = self.move(voltage)
        noise = NOISE * STROKE * self.random.standard_normal(voltage.size)
        start = (first - self._shown) / RATE
        return Record(name, 1.0 / RATE, voltage, displacement + noise, start=start)

    def move(self, voltage: Array) -> Array:
        """Return the displacement [m] with the effect, for a voltage at the ticks [V]."""
        displacement, states = self.world.held(voltage, self._level, self._state)
        self._state, self._level = states[:, -1], float(voltage[-1])
        self._moved.append(displacement)
        y = np.concatenate(self._moved)
        case = Case('', '', np.inf, (), (), SLOW, DELAY)
        times = np.arange(y.size) / (PARTS * RATE)
        changed = HIDDEN[self.effect][0](y, times, 0.0, 2.0 * STROKE, self.size, case)
        return np.asarray(changed[-PARTS * voltage.size :][PARTS - 1 :: PARTS])


def ramped(amplitude: float, frequency: float) -> Array:
    """Return a sine of three seconds that grows from 0 V and returns there."""
    spec = {'kind': 'sine', 'frequency': frequency, 'amplitude': amplitude, 'ramp': 0.2}
    return from_spec(spec | {'duration': 3.0}).sample(np.arange(3 * round(RATE)) / RATE).value


def examine(task: tuple[str, str, int, float]) -> dict[str, Any]:
    """Investigate one actuator with one effect."""
    actuator, effect, seed, budget = task
    began = time.process_time()
    world, baseline = ACTUATORS[actuator]
    place = seed, list(ACTUATORS).index(actuator), list(HIDDEN).index(effect)
    random = np.random.default_rng([*place, 5])
    healthy = Stage(world, 'nothing', 0.0, random)
    records = [healthy.measured(f'{f:g} Hz {a:g} V', ramped(a, f)) for a, f in FITTED]
    model = ModelFile.parse(identify(records, chain(baseline)).model_file().text())
    stage = Stage(world, effect, float(random.uniform(0.25, 1.0)), random)
    stage.move(earlier_motion(seed + place[2], RATE))
    investigation = Investigation(model, LIMITS, RATE, Rules(budget=budget))
    stop = investigate(investigation, stage.run)
    names = list(investigation.answers[-1].after.names)
    truth = HIDDEN[effect][1]
    return {
        'actuator': actuator,
        'effect': effect,
        'size': stage.size,
        'found': names,
        'right': names == ([truth] if truth else []),
        'stop': stop.reason,
        'seconds': investigation.answers[-1].spent,
        'cpu': time.process_time() - began,
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the counts and all rows as Markdown."""
    single = [row for row in rows if HIDDEN[row['effect']][1]]
    null = [row for row in rows if not HIDDEN[row['effect']][1]]
    false = sum(bool(set(row['found']) - {HIDDEN[row['effect']][1]}) for row in single)
    lines = [
        f'- the effect and nothing else: {sum(row["right"] for row in single)} of {len(single)}',
        f'- with a name of another effect: {false} of {len(single)}',
        f'- no effect, nothing reported: {sum(row["right"] for row in null)} of {len(null)}',
        '',
        '| actuator | effect | size | reported | time | end | processor |',
        '|---|---|---:|---|---:|---|---:|',
    ]
    lines += [
        f'| {row["actuator"]} | {row["effect"]} | {row["size"]:.2f} | '
        f'{" + ".join(row["found"]) or "nothing"}{"" if row["right"] else " (**wrong**)"} | '
        f'{row["seconds"]:.1f} s | {row["stop"]} | {row["cpu"]:.0f} s |'
        for row in rows
    ]
    return '\n'.join(lines)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=3)
    add = parser.add_argument
    add('--actuators', nargs='+', choices=list(ACTUATORS), default=list(ACTUATORS))
    add('--effects', nargs='+', choices=list(HIDDEN), default=list(HIDDEN))
    add('--budget', type=float, default=BUDGET, help='actuator time of each [s]')


QUICK = {'actuators': ['Dahl'], 'effects': ['tone'], 'budget': 4.0}


def run(asked: argparse.Namespace) -> str:
    """Investigate every actuator with every effect; return the table."""
    tasks = [(a, e, asked.seed, asked.budget) for a in asked.actuators for e in asked.effects]
    rows = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for row in pool.map(examine, tasks):
            print(json.dumps(row), file=sys.stderr, flush=True)
            rows.append(row)
    return table(rows) + '\n'
