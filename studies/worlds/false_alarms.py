"""False alarms on unchanged measured records: rate of reported new deviations.

    python studies/study.py false_alarms --data ../shared/data

A model is identified on the first part of a record, and the rest, with a second record where there
is one, is cut into blocks. Nothing was changed, so a verdict other than `none` is a false alarm.
The exam has its rate by the test that opens a search, and by a conformal bar: half of the blocks,
drawn, calibrate it, and a block of the other half is an alarm if

    p = (1 + number of calibration blocks with at least its score) / (n + 1)

is 5 % at most. The score is the power beyond the expected one. Below 19 calibration blocks no p is
that small, and the exam says so.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.start import SearchOptions, unsearched
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, load
from studies.exams import Exam
from studies.worlds.hidden import CASES, Case, chain, cut
from studies.worlds.stand_ins import records_in

#: Calibration blocks from which a p of 5 % is possible.
ENOUGH = 19
LEVEL = 0.05


@dataclass(frozen=True)
class Blocks:
    """Unchanged blocks of one record, evaluated by one model."""

    case: str
    baseline: str
    record: str
    scores: FloatArray  # power beyond the expected one, in units of that, shape (n,)
    alarms: int  # blocks with a new deviation

    def conformal(self, generator: np.random.Generator) -> str:
        """Return the alarms by a bar from half of the blocks, in a cell."""
        order = generator.permutation(self.scores)
        known, judged = np.array_split(order, 2)
        if known.size < ENOUGH:
            return f'too few ({known.size} of {ENOUGH})'
        chances = (1 + np.sum(known[None] >= judged[:, None], axis=1)) / (known.size + 1)
        return f'{np.sum(chances <= LEVEL)} of {judged.size}'


def judged(
    records: Sequence[Record], model: ModelFile, seconds: float
) -> tuple[list[float], list[bool]]:
    """Return score and new deviation of every block of so many seconds."""
    how = SearchOptions(RecordAssumptions('auto', 'auto'), 0, 1, {}, Deadline(inf))
    scores, alarms = [], []
    for record in records:
        length = round(seconds / record.dt)
        for first in range(0, len(record) - length + 1, length):
            try:
                data = split(annotated([record.section(first, first + length)]), 'auto')
                found = unsearched(data, model, how)
            except PiezoError:  # a block at rest contains no information
                continue
            scores.append(found.evaluator.excess(found.final))
            alarms.append(found.evaluator.has_significant_residual(found.final, found.start))
    return scores, alarms


def examined(case: Case, word: str, data: Path, seconds: float, part: float) -> list[Blocks]:
    """Return the blocks of every record of a case."""
    whole = load([data / case.fitted])[0]
    until = part * len(whole) * whole.dt
    fitted = cut(whole, until)
    model = ModelFile.parse(identify([fitted], chain(word)).model.text())
    rest = {case.fitted: whole.section(len(fitted), len(whole))}
    rest |= {file: load([data / file])[0] for file in case.evaluated if file != case.fitted}
    rows = []
    for file, record in rest.items():
        scores, alarms = judged([record], model, seconds)
        name = Path(file).stem
        rows.append(Blocks(case.name, word, name, np.array(scores), sum(alarms)))
    return rows


def exam(rows: Sequence[Blocks], seed: int, seconds: float) -> Exam:
    """Return the exam: alarms by record, and those by a conformal bar."""
    cells = [
        {
            'actuator': row.case, 'baseline': row.baseline, 'record': row.record,
            'alarms': int(row.alarms), 'blocks': row.scores.size,
            'by_a_conformal_bar': row.conformal(np.random.default_rng(seed)),
        }
        for row in rows
    ]  # fmt: skip
    total = int(sum(row.alarms for row in rows)), sum(row.scores.size for row in rows)
    return Exam('false_alarms', seed, {'alarms': total}, cells, f'blocks of {seconds:g} s')


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world; the seed says which blocks calibrate."""
    parser.set_defaults(seed=1)
    parser.add_argument('--data', type=Path, default=Path('../shared/data'))
    parser.add_argument('--seconds', type=float, default=1.0, help='of a block')
    parser.add_argument('--part', type=float, default=0.4, help='of the record that is fitted')
    parser.add_argument('--cases', type=int, help='so many actuators')
    parser.add_argument('--baselines', type=int, help='so many of each actuator')


QUICK = {'data': None, 'cases': 1, 'baselines': 1, 'seconds': 0.4}


def run(asked: argparse.Namespace) -> list[Exam]:
    """Examine every actuator."""
    cases = CASES[: asked.cases]
    files = sorted({file for case in cases for file in (case.fitted, *case.evaluated)})
    rows: list[Blocks] = []
    with records_in(asked.data, files) as data:
        for case in cases:
            for word in case.baselines[: asked.baselines]:
                rows += examined(case, word, data, asked.seconds, asked.part)
    return [exam(rows, asked.seed, asked.seconds)]
