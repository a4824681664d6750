"""The folder of an investigation: what was asked and why, what it answered, and every bag.

``baseline.yaml`` is the model at the beginning, ``journal.jsonl`` holds the conditions in its
first line and then a line for each experiment, ``bags/NN`` its record. From these it goes on after
an interruption, and can be repeated.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from piezo_hysteresis.common.files import write_atomically
from piezo_hysteresis.investigation.belief import Belief
from piezo_hysteresis.investigation.choose import ExperimentChoice
from piezo_hysteresis.investigation.limits import ExperimentLimits, InvestigationError
from piezo_hysteresis.investigation.session import ExperimentAnswer, Investigation, Rules
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, load

BASELINE, JOURNAL, BAGS = 'baseline.yaml', 'journal.jsonl', 'bags'


@dataclass(frozen=True)
class Setup:
    """Under which conditions an investigation goes.

    Attributes
    ----------
    model : ModelFile
        The model in use.
    limits : ExperimentLimits
        What no experiment may exceed.
    rules : Rules
        When it ends.
    rate : float
        Ticks per second [Hz].
    """

    model: ModelFile
    limits: ExperimentLimits
    rules: Rules
    rate: float

    def investigation(self, workers: int = 1) -> Investigation:
        """Return the investigation at its beginning."""
        return Investigation(self.model, self.limits, self.rate, self.rules, workers)

    def to_dict(self) -> dict[str, Any]:
        """Return the conditions, without the model."""
        return {
            'investigation': 1,
            'limits': self.limits.to_dict(),
            'rules': asdict(self.rules),
            'rate': self.rate,
        }


class Journal:
    """What has been done in a folder, line by line.

    Parameters
    ----------
    folder : Path
        Of the investigation.
    setup : Setup
        Its conditions.
    lines : sequence of dict
        What has been done.
    """

    def __init__(self, folder: Path, setup: Setup, lines: Sequence[dict[str, Any]] = ()) -> None:
        self.folder, self.setup, self.lines = folder, setup, list(lines)

    @classmethod
    def create_or_resume(cls, folder: Path, setup: Setup) -> Journal:
        """Begin a journal, or go on with one of the same conditions; the budget may be another.

        Nothing is written before something is run, so that what is refused leaves nothing.

        Raises
        ------
        InvestigationError
            If the folder holds something else.
        """
        # as the file holds it, which rounds: a repetition shall begin with the same numbers
        setup = replace(setup, model=ModelFile.parse(setup.model.text()))
        if (folder / JOURNAL).is_file():
            found = cls.read(folder)
            same = found.setup.model.text() == setup.model.text()
            rules = replace(found.setup.rules, budget=setup.rules.budget)
            if not same or replace(found.setup, rules=rules).to_dict() != setup.to_dict():
                raise InvestigationError(
                    f'{folder} has an investigation of another model or with other limits: give '
                    'another folder, or the same words as before to go on'
                )
            return cls(folder, setup, found.lines)
        if folder.exists() and any(folder.iterdir()):
            raise InvestigationError(f'{folder} is not empty: give another folder')
        return cls(folder, setup)

    @classmethod
    def read(cls, folder: Path) -> Journal:
        """Read the journal of a folder.

        Raises
        ------
        InvestigationError
            If there is none, or it is damaged.
        """
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
        """Return the bag of an experiment, counted from 1."""
        return self.folder / BAGS / f'{number:02}'

    def cleared(self, number: int) -> Path:
        """Return the bag of an experiment that is about to run; what was broken off is gone.

        Raises
        ------
        InvestigationError
            If the folder cannot be written.
        """
        path = self.bag(number)
        if not self.lines:
            self._begin()
        shutil.rmtree(path, ignore_errors=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def add(self, choice: ExperimentChoice, answer: ExperimentAnswer, follows: bool) -> None:
        """Write down an experiment and what it led to; it `follows` the one before at rest."""
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
                f'{self.folder} cannot be written ({error.strerror})'
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
    """Return an experiment and what it led to, as it stands in the journal.

    It `follows` the one before where the actuator rested in between, and was chosen as one that
    the `budget` [s] allowed.
    """
    return {
        'number': number,
        'experiment': choice.experiment.name,
        'seconds': choice.experiment.seconds,
        'why': choice.why,
        'discrimination_nats': choice.discrimination,
        'news': choice.news,
        'bag': f'{BAGS}/{number:02}',
        'follows': follows,
        'budget': budget,
        'answer': answer.words,
        'before': believed(answer.before),
        'after': believed(answer.after),
        'spent': answer.spent,
    }


def believed(belief: Belief) -> dict[str, Any]:
    """Return a belief as it stands in the journal."""
    return {
        'verdict': belief.verdict,
        'names': list(belief.names),
        'chances': belief.chances,
        'left': belief.left,
    }


def belief_from(content: dict[str, Any]) -> Belief:
    """Return a belief from what `believed` made of it: what rivals there were it does not say."""
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
    """Return the record of a bag, on the clock of the actuator.

    Raises
    ------
    PiezoError
        If it holds none that counts.
    """
    return load([bag])[-1]
