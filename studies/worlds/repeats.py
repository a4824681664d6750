"""Discovery test: the same experiment again, with nothing changed and with a hidden effect.

    python studies/study.py repeats --data ../shared/data

Each record of an experiment that was run several times is left out in turn. A baseline is
identified on the others jointly, so that its ``model.yaml`` knows how much they differ (or on
``--fitted`` of them, with the others as `repeats`), and
`discover` gets the one that was left out: as measured, where each name is false, and with an
effect in its displacement whose rms is so many times the scatter of the records. The scatter is
that of the displacement over the phase of the drive, without its mean, from record to record.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.transport_delay import LONGEST
from piezo_hysteresis.discovery import Verdict, discover
from piezo_hysteresis.identification import identify
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, load
from piezo_sim.sweep import simulate
from studies.exams import Exam, hits
from studies.worlds.hidden import HIDDEN as ALL
from studies.worlds.hidden import Case, Hide, chain
from studies.worlds.scores import in_a_cell
from studies.worlds.stand_ins import FREQUENCY, PRESET


def humming(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement with a tone at a frequency that no size changes."""
    return np.asarray(y + 0.015 * size * stroke * np.sin(2 * np.pi * 13.3 * t))


HIDDEN: dict[str, tuple[Hide, str]] = {**ALL, 'tone': (humming, 'mains_hum')}
#: Phases at which displacements are compared, and sizes of an effect among which one is found.
PHASES, STEPS = 64, 40
CHANGED = 'parameter_shift'


@dataclass(frozen=True)
class Experiment:
    """Records of one experiment that was run several times, and the models of it."""

    name: str
    records: tuple[Record, ...]
    baselines: tuple[str, ...]
    delay: float  # largest delay or lag [s]


@dataclass(frozen=True)
class Row:
    """One record that was left out."""

    experiment: str
    baseline: str
    record: str
    hidden: str
    size: float
    verdict: Verdict

    @property
    def names(self) -> list[str]:
        """What was named, in order."""
        return [effect.name for effect in self.verdict.effects]

    @property
    def right(self) -> bool:
        """Whether the hidden effect is named first; without one, whether nothing new is."""
        if self.hidden == 'nothing':
            return self.verdict.verdict == 'none' or self.names == [CHANGED]
        return self.names[:1] == [HIDDEN[self.hidden][1]]

    @property
    def among(self) -> bool:
        """Whether the hidden effect is named first or in the class of a name."""
        truth = HIDDEN[self.hidden][1]
        return self.right or any(truth in e.effect_class for e in self.verdict.effects)

    @property
    def false(self) -> bool:
        """Whether a name is given that is not hidden."""
        return bool(set(self.names) - {HIDDEN[self.hidden][1], CHANGED})


def resampled(file: Path, dt: float = 0.01) -> Record:
    """Return a run of the pneumatic cylinder: its position as input [mm], its force [N] as output.

    The samples have gaps, so both are interpolated.
    """
    with file.open() as stream:
        rows = list(csv.reader(stream))[1:]
    time, force, place = np.array([[float(each) for each in row[:3]] for row in rows]).T
    even = np.arange(time[0], time[-1], dt)
    voltage, displacement = np.interp(even, time, place * 1e-3), np.interp(even, time, force)
    return Record(file.stem, dt, voltage, displacement * 1e-6)


def stand_ins() -> list[Experiment]:
    """Return a simulated sine that was run three times, for `--quick`."""
    plan = {'kind': 'sine', 'frequency': FREQUENCY, 'amplitude': 1.0, 'duration': 2.0}
    runs = tuple(replace(simulate(PRESET, [plan], seed=k)[0], name=f'run_{k}') for k in range(3))
    return [Experiment('simulated', runs, ('prandtl_ishlinskii',), 0.04)]


def experiments(data: Path | None, parts: int = 4) -> list[Experiment]:
    """Return the experiments whose records are there.

    A long sine is one experiment that was run `parts` times.
    """
    if data is None:
        return stand_ins()
    found = []
    folder = data / 'pneumatic_repeat'
    pressures = sorted({f.stem.rsplit('_', 1)[1] for f in folder.glob('*.csv')})
    for each in pressures:
        runs = tuple(map(resampled, sorted(folder.glob(f'*_{each}.csv'))))
        found.append(Experiment(f'cylinder, {each}', runs, ('prandtl_ishlinskii',), 0.5))
    file = data / 'p885_stack/train_1Hz_sine.csv'
    if file.exists():
        whole = load([file])[0]
        cuts = np.linspace(round(4.0 / whole.dt), len(whole), parts + 1).astype(int)
        pieces = [whole.section(int(a), int(b)) for a, b in pairwise(cuts)]
        runs = tuple(replace(r, name=f'part_{k + 1}') for k, r in enumerate(pieces))
        found.append(Experiment('P-885', runs, ('prandtl_ishlinskii',), 0.04))
    return found


def over_the_phase(record: Record) -> FloatArray:
    """Return the displacement over the phase of the drive, without its mean, shape (PHASES,) [m].

    The phase is counted between the rises of the input through its middle.
    """
    u = record.voltage - 0.5 * (record.voltage.max() + record.voltage.min())
    moves = np.abs(u) > 0.2 * u.max()  # a noisy input crosses more than once
    known = np.flatnonzero(moves)
    rises = known[1:][(u[known[1:]] > 0.0) & (u[known[:-1]] < 0.0)]
    turn = np.interp(np.arange(len(record)), rises, np.arange(rises.size, dtype=np.float64))
    inside = (np.arange(len(record)) >= rises[0]) & (np.arange(len(record)) < rises[-1])
    place = (turn[inside] % 1.0 * PHASES).astype(int)
    total = np.bincount(place, record.displacement[inside], PHASES)
    mean = total / np.maximum(np.bincount(place, minlength=PHASES), 1)
    return np.asarray(mean - mean.mean())


def scatter_of(records: Sequence[Record]) -> float:
    """Return the rms by which the displacement differs between records [m]."""
    return float(np.sqrt(np.mean(np.var([over_the_phase(r) for r in records], axis=0, ddof=1))))


def with_size(record: Record, kind: str, rms: float, case: Case) -> tuple[Record, float]:
    """Return a record with an effect that changes it by so much [m], and the size of that."""
    y, time = record.displacement, record.dt * np.arange(float(len(record)))
    middle, stroke = float(y.mean()), float(np.ptp(y))
    sizes = np.geomspace(1e-3, 30.0, STEPS)
    every = [HIDDEN[kind][0](y, time, middle, stroke, float(size), case) for size in sizes]
    best = int(np.argmin(np.abs(np.log([np.std(each - y) / rms for each in every]))))
    changed = np.ascontiguousarray(every[best])
    return replace(record, displacement=changed), float(sizes[best])


def examined(
    experiment: Experiment,
    word: str,
    effects: Sequence[str],
    times: float,
    limit: float,
    fitted: int,
) -> list[Row]:
    """Return the rows of every record that is left out; `fitted` others are, 0 for all."""
    rows = []
    scatter = scatter_of(experiment.records)
    for left in experiment.records:
        others = [record for record in experiment.records if record is not left]
        own, again = others[: fitted or None], others[fitted:] if fitted else []
        model = ModelFile.parse(identify(own, chain(word)).model.text())
        case = Case('', '', np.inf, (), (), len(left) * left.dt, experiment.delay)
        for kind in effects:
            judged, size = left, 0.0
            if kind != 'nothing':
                judged, size = with_size(left, kind, times * scatter, case)
            if kind == 'delay' and size * case.delay > LONGEST:
                continue  # no delay that the library holds is so large
            verdict = discover(
                [judged], model, repeats=again, time_limit=limit, recommend=False
            ).verdict
            rows.append(Row(experiment.name, word, left.name, kind, size, verdict))
            case_name = f'{experiment.name} {left.name} {kind} {size:.2g}'
            print(f'{case_name}: {in_a_cell(verdict)}')
            sys.stdout.flush()
    return rows


def exams(rows: Sequence[Row]) -> list[Exam]:
    """Return the exam of each experiment."""
    found = []
    for name in dict.fromkeys(row.experiment for row in rows):
        own = [row for row in rows if row.experiment == name]
        same = [row for row in own if row.hidden == 'nothing']
        new = [row for row in own if row.hidden != 'nothing']
        counts = {
            'first': hits([row.right for row in new]),
            'class': hits([row.among for row in new]),
            'wrong': hits([row.false for row in new]),
            'none': hits([row.right and not row.false for row in same]),
        }
        cells = [
            {
                'baseline': row.baseline, 'record': row.record, 'hidden': row.hidden,
                'size': round(row.size, 3), 'reported': in_a_cell(row.verdict),
            }
            for row in own
        ]  # fmt: skip
        found.append(Exam('repeats', None, counts, cells, name))
    return found


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=1)
    add = parser.add_argument
    add('--data', type=Path, default=Path('../shared/data'))
    add('--times', type=float, default=3.0, help='rms of an effect, in scatters')
    add('--fitted', type=int, default=0, help='records of the model; the others are `repeats`')
    add('--experiments', default='', help='only those whose name contains this')
    add('--effects', type=int, default=len(HIDDEN), help='so many, and none')


QUICK = {'data': None, 'effects': 1, 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> list[Exam]:
    """Leave out every record."""
    found = [e for e in experiments(asked.data) if asked.experiments in e.name]
    if not found:
        sys.exit(f'no repeated record in {asked.data}')
    rows: list[Row] = []
    for each in found:
        for word in each.baselines:
            kinds = list(HIDDEN)[: asked.effects]
            rows += examined(each, word, kinds, asked.times, asked.time_limit, asked.fitted)
    return exams(rows)
