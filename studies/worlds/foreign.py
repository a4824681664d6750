"""Discovery test: effects in actuators from the literature (Maxwell, Duhem, LuGre, leakage).

    python studies/study.py foreign --seed 21 --exams docs/exams.json

As the world `hidden`, but the records come from `studies/worlds/foreign_world.py`. A baseline
that cannot be exact there is identified on six untouched records; effects hide in six others.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from piezo_hysteresis.records import write_bag
from studies.exams import Exam
from studies.worlds.foreign_world import WORLDS, recorded
from studies.worlds.hidden import HIDDEN, Case, Row, Search, exam, examined

FITTED = tuple((a, f) for f in (1.0, 7.0, 23.0) for a in (0.5, 1.0))
JUDGED = tuple((a, f) for f in (2.0, 5.0, 17.0) for a in (0.6, 0.9))
SECONDS = 5.0
#: The model that a lab would take for each world.
BASELINES = {
    'elastoslides': 'bouc_wen_mode',
    'Duhem': 'bouc_wen_mode',
    'two modes, friction': 'linear_mode',
    'leaking charge': 'bouc_wen_mode',
}


def records_into(folder: Path, seed: int, worlds: int, seconds: float) -> list[Case]:
    """Write the records of the first worlds as bags and return the cases that name them."""
    cases = []
    for place, (name, world) in enumerate(list(WORLDS.items())[:worlds]):
        random = np.random.default_rng([seed, place, 99])
        files = (f'{place}_fitted', f'{place}_judged')
        for file, drives in zip(files, (FITTED, JUDGED), strict=True):
            write_bag(folder / file, recorded(world, drives, seconds, random))
        cases.append(Case(name, files[0], np.inf, files[1:], (BASELINES[name],), seconds, 4e-3))
    return cases


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    add = parser.add_argument
    add('--worlds', type=int, default=len(WORLDS), help='so many of them')
    add('--effects', type=int, default=len(HIDDEN), help='so many, and none')
    add('--bends', action='store_true', help='hide curves of the sensor and gains')
    add('--seconds', type=float, default=SECONDS, help='of every record')


QUICK = {'worlds': 1, 'effects': 2, 'seconds': 1.0, 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> list[Exam]:
    """Examine every actuator."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as made:
        how = Search(asked.workers, asked.time_limit, asked.effects, bends=asked.bends)
        cases = records_into(Path(made), asked.seed, asked.worlds, asked.seconds)
        for place, case in enumerate(cases):
            rows += examined(case, case.baselines[0], Path(made), (asked.seed, place), how)
    return [exam('foreign', rows, asked.seed, 'bends' if asked.bends else '')]
