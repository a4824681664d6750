"""What an ideal observer would name of hidden curves and gains, and what opens a search.

    python studies/study.py observer --seed 81 --data ../shared/data

The curves and gains of ``--bends`` in the worlds `foreign` and `hidden`, with the sizes of their
seed. The observer knows the exact change, the noise, and the power that the model file expects in
each harmonic and octave; clock and zeros are free. Its distance d from no change, and from the
nearest multiple of another member of the class, is in standard deviations; it is right with a
probability of Phi(d/2). *opens* is the size from which on the change, added to the residual of the
unchanged records, opens a search.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import ndtr

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.detection.bends import BENDS
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, errors_of
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import FixedBaselineEvaluator
from piezo_hysteresis.discovery.selection.start import SearchOptions, held_data
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import PARAMETER_SHIFT, ModelFile
from piezo_hysteresis.numerics.qr import orthonormal, projected_out
from piezo_hysteresis.records import Record, load
from studies.worlds.foreign import SECONDS, records_into
from studies.worlds.foreign_world import WORLDS
from studies.worlds.hidden import BENT, CASES, Case, baseline_of, hide

# Sizes at which a search is tried; those that are hidden are 0.25 to 1.
_SIZES = np.geomspace(0.05, 20.0, 80)
# Share of the start values of a rival at which its response is taken, and of a tick.
_SMALL, _TICK = 0.1, 0.05
_DEPENDENT = 1e-5


class Observer:
    """Unchanged records, and what a model file expects of its own error on them."""

    def __init__(self, known: ModelFile, records: Sequence[Record], case: Case) -> None:
        self.records, self.case = {record.name: record for record in records}, case
        data, how = (
            split(annotated(records)),
            SearchOptions(RecordAssumptions(), 0, 1, {}, Deadline()),
        )
        self.base, seen = held_data(data, known, how)
        held = FixedBaselineEvaluator(seen, 0, 1, self.base, known)
        self.evaluator = held
        self.views: tuple[FitData, ...] = (*seen.training, *seen.held_out)
        self.expected = (*held.expected, *held.expected_held_out)
        self.errors = errors_of(self.base, self.views)
        late = self.base.sampling_offset + _TICK * self.views[0].dt
        self.clock = self.whitened(self._response(replace(self.base, sampling_offset=late)))

    def hidden(self, kind: str, size: float) -> list[FloatArray]:
        """Return what an effect changes in each view [m]."""
        old = list(self.records.values())
        pairs = zip(old, hide(old, kind, size, self.case), strict=True)
        moved = {a.name: b.displacement - a.displacement for a, b in pairs}
        return [
            moved[v.name][v.first - v.origin :: v.stride][: v.measured.size] for v in self.views
        ]

    def opens(self, kind: str) -> float:
        """Return the smallest size that opens a search."""

        def deviates(size: float) -> bool:
            changes = zip(self.expected, self.errors, self.hidden(kind, size), strict=True)
            return any(x.new_deviation(x.powers(e + change)) for x, e, change in changes)

        return next((float(size) for size in _SIZES if deviates(float(size))), np.inf)

    def distances(self, kind: str, size: float) -> tuple[float, float, str]:
        """Return the distance from no change, from the nearest rival, and its name."""
        own = self.whitened(self.hidden(kind, size))
        alone = self._left(own, [])
        apart = {
            name: self._left(own, [self.whitened(each) for each in rows])
            for name, rows in self.rivals().items()
            if name != BENT[kind][1]
        }
        nearest = min(apart, key=apart.__getitem__)
        return alone, apart[nearest], nearest

    def rivals(self) -> dict[str, list[list[FloatArray]]]:
        """Return the responses [m] to each member of the class, the gain as such."""
        found: dict[str, list[list[FloatArray]]] = {
            PARAMETER_SHIFT.name: [
                [v.measured - e for v, e in zip(self.views, self.errors, strict=True)]
            ]
        }
        for each in self.evaluator.candidates(self.base):
            name = each.effect.name
            if name not in BENDS or name == PARAMETER_SHIFT.name or each.effect.refines:
                continue
            for start in each.starts:
                values = each.values(self.base.values, start)
                values |= {k: n + _SMALL * (values[k] - n) for k, n in each.neutral.items()}
                row = self._response(self.base.with_candidate(each, values))
                if all(np.all(np.isfinite(change)) for change in row):
                    found.setdefault(name, []).append(row)
        return found

    def whitened(self, changes: Sequence[FloatArray]) -> FloatArray:
        """Return changes of the views in standard deviations of noise and discrepancy."""
        return np.concatenate(
            [x.whitened(change) for x, change in zip(self.expected, changes, strict=True)]
        )

    def _response(self, spec: ModelSpec) -> list[FloatArray]:
        found = errors_of(spec, self.views)
        return [old - new for old, new in zip(self.errors, found, strict=True)]

    def _left(self, own: FloatArray, rows: Sequence[FloatArray]) -> float:
        units = [row / max(float(np.linalg.norm(row)), 1e-300) for row in (self.clock, *rows)]
        basis = orthonormal(np.array(units), _DEPENDENT)
        return float(np.linalg.norm(projected_out(own, basis[np.any(basis != 0.0, axis=1)])[1]))


def observed(
    case: Case, word: str, data: Path, seed: Sequence[int], effects: int
) -> Iterator[str]:
    """Yield a row of the table for each hidden curve or gain."""
    records = load([data / file for file in case.evaluated])
    observer = Observer(baseline_of(case, word, data), records, case)
    generator = np.random.default_rng(seed)
    for kind in list(BENT)[:effects]:
        size = float(np.exp(generator.uniform(np.log(0.25), 0.0)))
        if not BENT[kind][1]:
            continue
        alone, apart, nearest = observer.distances(kind, size)
        chances = f'{ndtr(alone / 2):.2f} | {ndtr(min(alone, apart) / 2):.2f}'
        yield (
            f'| {case.name} | {word} | {kind} | {size:.2f} | {observer.opens(kind):.2f} '
            f'| {alone:.2g} | {apart:.2g}, {nearest} | {chances} |'
        )


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    add = parser.add_argument
    add('--data', type=Path, help='measured records, too')
    add('--worlds', type=int, default=len(WORLDS), help='so many actuators from the literature')
    add('--effects', type=int, default=len(BENT), help='so many, and none')
    add('--seconds', type=float, default=SECONDS, help='of every record')


QUICK = {'worlds': 1, 'effects': 2, 'seconds': 1.0}


def run(asked: argparse.Namespace) -> str:
    """Return the table."""
    rows = [
        '| actuator | baseline | hidden | size | opens | d | nearest | P(change) | P(name) |',
        '|---|---|---|---|---|---|---|---|---|',
    ]
    with tempfile.TemporaryDirectory() as made:
        cases = records_into(Path(made), asked.seed, asked.worlds, asked.seconds)
        for place, case in enumerate(cases):
            seed = asked.seed, place
            rows += observed(case, case.baselines[0], Path(made), seed, asked.effects)
    for place, case in enumerate(CASES if asked.data else ()):
        for k, word in enumerate(case.baselines):
            rows += observed(case, word, asked.data, (asked.seed, place, k), asked.effects)
    return '\n'.join(rows)
