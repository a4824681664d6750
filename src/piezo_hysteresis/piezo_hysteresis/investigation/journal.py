"""Folder of an investigation: conditions, choices with reasons, results and bags.

``baseline.yaml`` is the initial model. ``journal.jsonl`` holds the conditions in its first line
and one line per experiment; ``bags/NN`` are the records. From these files an investigation
continues after an interruption and can be evaluated again.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, InvestigationError
from piezo_hysteresis.investigation.experiment_choice import Belief, ExperimentChoice
from piezo_hysteresis.investigation.session import ExperimentAnswer, Investigation, Rules
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, load

BASELINE, JOURNAL, BAGS = 'baseline.yaml', 'journal.jsonl', 'bags'


@dataclass(frozen=True)
class Setup:
    """Conditions of an investigation."""

    model: ModelFile  # the model in use
    limits: ExperimentLimits  # limits of every experiment
    rules: Rules  # stopping rules
    rate: float  # ticks per second [Hz]

    def investigation(self, workers: int = 1) -> Investigation:
        """Return the investigation in its initial state."""
        return Investigation(self.model, self.limits, self.rate, self.rules, workers)

    def to_dict(self) -> dict[str, Any]:
        """Return the conditions without the model."""
        return {
            'investigation': 1,
            'limits': self.limits.to_dict(),
            'rules': asdict(self.rules),
            'rate': self.rate,
        }


class Journal:
    """Log of the experiments of a folder, one line each."""

    def __init__(self, folder: Path, setup: Setup, lines: Sequence[dict[str, Any]] = ()) -> None:
        self.folder, self.setup, self.lines = folder, setup, list(lines)

    @classmethod
    def create_or_resume(cls, folder: Path, setup: Setup) -> Journal:
        """Create a journal, or continue one with the same conditions; the budget may differ.

        No file is written before the first experiment, so that a rejected call leaves no files.
        """
        # rounded as in the file, so that a repetition starts with the same numbers
        setup = replace(setup, model=ModelFile.parse(setup.model.text()))
        if (folder / JOURNAL).is_file():
            found = cls.read(folder)
            same = found.setup.model.text() == setup.model.text()
            rules = replace(found.setup.rules, budget=setup.rules.budget)
            if not same or replace(found.setup, rules=rules).to_dict() != setup.to_dict():
                raise InvestigationError(
                    f'{folder} has an investigation of another model or with other limits: give '
                    'another folder, or the same options as before to continue'
                )
            return cls(folder, setup, found.lines)
        if folder.exists() and any(folder.iterdir()):
            raise InvestigationError(f'{folder} is not empty: give another folder')
        return cls(folder, setup)

    @classmethod
    def read(cls, folder: Path) -> Journal:
        """Read the journal of a folder."""
        try:
            text = (folder / JOURNAL).read_text(encoding='utf-8')
            head, *lines = [json.loads(line) for line in text.splitlines()]
            setup = Setup(
                ModelFile.load(folder / BASELINE),
                ExperimentLimits.parse(head['limits']),
                Rules(**head['rules']),
                float(head['rate']),
            )
        except OSError:
            raise InvestigationError(
                f'{folder} holds no {JOURNAL}: give the folder that investigate wrote'
            ) from None
        except (ValueError, KeyError, TypeError) as error:
            raise InvestigationError(f'{folder / JOURNAL} is damaged ({error})') from None
        return cls(folder, setup, lines)

    def bag(self, number: int) -> Path:
        """Return the bag path of an experiment; numbers start at 1."""
        return self.folder / BAGS / f'{number:02}'

    def cleared(self, number: int) -> Path:
        """Return the bag path of the next experiment, after removal of an incomplete bag."""
        path = self.bag(number)
        if not self.lines:
            self._begin()
        shutil.rmtree(path, ignore_errors=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def add(self, choice: ExperimentChoice, answer: ExperimentAnswer, follows: bool) -> None:
        """Append an experiment and its result; `follows` states a rest since the previous one."""
        budget = self.setup.rules.budget
        self.lines.append(line_of(len(self.lines) + 1, choice, answer, follows, budget))
        self._write()

    def _begin(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with write_atomically(self.folder / BASELINE) as path:
                path.write_text(self.setup.model.text(), encoding='utf-8')
            self._write()
        except OSError as error:
            raise InvestigationError(
                f'{self.folder} cannot be written ({reason_of(error)})'
            ) from error

    def _write(self) -> None:
        every = [self.setup.to_dict(), *self.lines]
        text = ''.join(json.dumps(line, allow_nan=False) + '\n' for line in every)
        with write_atomically(self.folder / JOURNAL) as path, path.open('w') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())


def line_of(
    number: int, choice: ExperimentChoice, answer: ExperimentAnswer, follows: bool, budget: float
) -> dict[str, Any]:
    """Return the journal line of an experiment and its result.

    `follows` states that the actuator rested since the previous experiment. The experiment was
    chosen within the `budget` [s].
    """
    return {
        'number': number,
        'experiment': choice.experiment.name,
        'seconds': choice.experiment.seconds,
        'why': choice.why,
        'discrimination_nats': choice.discrimination,
        'first_detection': choice.first_detection,
        'bag': f'{BAGS}/{number:02}',
        'follows': follows,
        'budget': budget,
        'answer': answer.words,
        'before': belief_to_dict(answer.before),
        'after': belief_to_dict(answer.after),
        'spent': answer.spent,
    }


def belief_to_dict(belief: Belief) -> dict[str, Any]:
    """Return a belief as a dictionary for the journal."""
    return {
        'verdict': belief.verdict,
        'names': list(belief.names),
        'chances': belief.chances,
        'left': belief.left,
    }


def belief_from_dict(content: dict[str, Any]) -> Belief:
    """Return a belief from the output of `belief_to_dict`; it has no candidates."""
    chances = dict(content['chances'])
    return Belief(
        content['verdict'],
        tuple(content['names']),
        chances,
        next(iter(chances.items())),
        (),
        content['left'],
        float('nan'),
    )


def record_of(bag: Path) -> Record:
    """Return the record of a bag, with times on the clock of the actuator."""
    return load([bag])[-1]
