"""An investigation from its first experiment to its verdict, with its journal."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import Guided, reason_of
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.experiments.planned_experiment import (
    ExperimentLimits,
    InvestigationError,
    PlannedExperiment,
)
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.investigation import AFTERWARDS, BAGS, BASELINE, FOUND, JOURNAL, SUMMARY
from piezo_hysteresis.investigation.experiment_choice import Belief, ExperimentChoice
from piezo_hysteresis.investigation.session import ExperimentAnswer, Investigation, Rules, Stop
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, load
from piezo_hysteresis.reporting.discovery_report import write_discovery


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


class Actuator(Protocol):
    """Interface to an actuator that runs experiments and uses a model."""

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        """Run an experiment and record it in a new bag; the actuator rests afterwards.

        Returns whether the actuator rested between the previous experiment and this one.
        """

    def apply(self, model: ModelFile) -> str:
        """Use a model from now on; return a description of the nodes that use it."""


@dataclass(frozen=True)
class InvestigationProgress:
    """Progress of an investigation."""

    stage: str  # ``prepare``, ``run``, ``judge`` or ``apply``
    number: int = 0  # number of the experiment, from 1
    experiment: str = ''  # name of the experiment
    why: str = ''  # reason of its selection
    answer: str = ''  # result of the last one
    chances: dict[str, float] = field(default_factory=dict)  # present probability by effect
    spent: float = 0.0  # actuator time so far [s]
    fraction: float = 0.0  # as a share of the budget


OnProgress = Callable[[InvestigationProgress], None]


@dataclass(frozen=True)
class Result(Guided):
    """Result of an investigation.

    Attributes
    ----------
    stop : Stop
        Reason of the end.
    verdict : str
        ``none``, ``named`` or ``unknown``.
    effects : dict of str to float
        Named effects with their probabilities.
    experiments : int
        Number of experiments.
    seconds : float
        Actuator time of the experiments [s].
    before_in_floors, after_in_floors : float
        Gap without and with the named effects on a record taken at the end, in multiples of the
        noise; NaN without such a record.
    applied : str
        Nodes that use the new model; empty for none.
    words : str
        Summary in a sentence.
    """

    _INSTEAD: ClassVar = {
        'words': 'summary text',
        'effects': 'probabilities names',
        'seconds': 'time',
    }

    stop: Stop
    verdict: str
    effects: dict[str, float]
    experiments: int
    seconds: float
    before_in_floors: float
    after_in_floors: float
    applied: str
    words: str


def run_investigation(
    folder: Path,
    setup: Setup,
    actuator: Actuator,
    on_progress: OnProgress = lambda progress: None,
    *,
    workers: int = 1,
    apply: bool = True,
) -> Result:
    """Run an investigation, or continue the one of a folder."""
    journal = Journal.create_or_resume(folder, setup)
    on_progress(InvestigationProgress('prepare'))
    course = RunState(journal, journal.setup.investigation(workers), actuator, on_progress)
    course.resume()
    stop = course.to_the_end()
    return course.concluded(stop, apply)


class RunState:
    """A running investigation."""

    def __init__(
        self,
        journal: Journal,
        investigation: Investigation,
        actuator: Actuator,
        on_progress: OnProgress,
    ) -> None:
        self._journal, self._now = journal, investigation
        self._actuator, self._on_progress = actuator, on_progress

    def resume(self) -> None:
        """Load the finished experiments; the intermediate beliefs are in the journal."""
        lines = self._journal.lines
        for line in lines:
            restore_experiment(self._now, self._journal, line)
        if lines:
            self._report('judge', len(lines), lines[-1]['experiment'], lines[-1]['why'])
            self._now.judge()
            self._now.history.discard()

    def to_the_end(self) -> Stop:
        """Run experiments until a stopping rule applies."""
        while True:
            choice = self._now.next()
            if isinstance(choice, Stop):
                return choice
            number = len(self._now.answers) + 1
            name = choice.experiment.name
            self._report('run', number, name, choice.why)
            record, follows = self._run(choice.experiment, self._journal.cleared(number))
            self._report('judge', number, name, choice.why)
            answer = self._now.take(choice.experiment, record)
            self._journal.add(choice, answer, follows)
            self._report('judge', number, name, choice.why)  # now with the result

    def _run(self, experiment: PlannedExperiment, bag: Path) -> tuple[Record, bool]:
        """Return the record of an experiment, and whether it follows the previous one at rest."""
        follows = self._actuator.run(experiment, bag) and self._now.history.known
        if not follows:
            self._now.history.discard()
        record = record_of(bag)
        if abs(record.rate / self._now.rate - 1.0) > 1e-6:
            raise RecordError(
                f'{bag}: it was recorded at {record.rate:g} Hz, not at {self._now.rate:g} Hz: '
                'give the excitation the rate of the actuator'
            )
        return record, follows

    def concluded(self, stop: Stop, apply: bool) -> Result:
        """Write the verdict, apply the model and measure the remaining gap."""
        now, folder = self._now, self._journal.folder
        found = now.found
        if found is None:
            raise RecordError('the budget is too small for any experiment: allow more seconds')
        data = [str(self._journal.bag(k + 1)) for k in range(len(now.answers))]
        write_discovery(folder / FOUND, found, data)
        applied, gaps = '', (float('nan'), float('nan'))
        # an unconfirmed model is not applied, and the actuator time stays within the budget
        if now.belief.names and stop.reason != 'budget':
            better = found.model_file(data)
            last = len(now.answers)
            experiment = self._widest()
            self._report('apply', last, experiment.name, 'shows the gap shrink')
            applied = self._actuator.apply(better) if apply else ''
            bag = self._journal.cleared(last + 1)
            measured, _ = self._run(experiment, bag)
            record = now.history.following(experiment.record(AFTERWARDS, measured))
            gaps = (
                gap_in_floors(now.model, record, found.floor),
                gap_in_floors(better, record, found.floor),
            )
        result = self._result(stop, gaps, applied)
        self._write(result)
        return result

    def _widest(self) -> PlannedExperiment:
        """Return the experiment with the largest gap of the model in use."""
        records = zip(self._now.answers, self._now.records, strict=True)
        gaps = [(gap_in_floors(self._now.model, r, 1.0), a.experiment) for a, r in records]
        return max(gaps, key=lambda pair: pair[0])[1]

    def _result(self, stop: Stop, gaps: tuple[float, float], applied: str) -> Result:
        now = self._now
        assert now.found is not None
        effects = {e.name: e.probability for e in now.found.verdict.effects}
        count = len(now.answers)
        text = f'{now.found.verdict.summary.rstrip(".")}. {stop.words[:1].upper()}{stop.words[1:]}'
        text += f', after {count} experiment{"" if count == 1 else "s"} of {now.spent:.3g} s'
        text += '.' if count == 1 else ' together.'
        if stop.reason == 'budget':
            text += ' No node uses it yet; a larger budget continues from here.'
        if gaps[0] == gaps[0]:
            text += f' On a record taken afterwards the gap is {gaps[1]:.3g} noise floors in place'
            text += f' of {gaps[0]:.3g}.'
        return Result(
            stop, now.belief.verdict, effects, len(now.answers), now.spent, *gaps, applied, text
        )

    def _write(self, result: Result) -> None:
        content = {k: v if v == v else None for k, v in asdict(result).items()}
        with write_atomically(self._journal.folder / SUMMARY) as path:
            path.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')

    def _report(self, stage: str, number: int, experiment: str, why: str) -> None:
        now = self._now
        answer = now.answers[-1].words if now.answers else ''
        share = min(1.0, now.spent / now.rules.budget)
        chances = dict(now.belief.chances)
        self._on_progress(
            InvestigationProgress(
                stage, number, experiment, why, answer, chances, now.spent, share
            )
        )


def restore_experiment(now: Investigation, journal: Journal, line: dict[str, Any]) -> None:
    """Add a record of the journal and the belief after it."""
    if not line.get('follows', False):
        now.history.discard()
    experiment = now.experiment(line['experiment'])
    now.keep(experiment, record_of(journal.bag(line['number'])), belief_from_dict(line['after']))


def gap_in_floors(model: ModelFile, record: Record, floor: float) -> float:
    """Return the rms residual of a model on a record, in multiples of a noise floor [1]."""
    late = model.sampling_offset
    (view,) = views_of(
        model.model, model.values, [record], late, RecordAssumptions(start='step', zero='record')
    )
    (found,) = predictions(model.model, model.values, (view,), late)
    return float(np.sqrt(np.mean(found.valid_error**2))) / max(floor, 1e-300)


@dataclass(frozen=True)
class Repeated:
    """An investigation evaluated again from its bags."""

    lines: tuple[dict[str, Any], ...]  # result of each experiment, as in the journal
    stop: Stop | None  # reason of the end; None if the investigation was interrupted
    differences: tuple[str, ...]  # deviations from the journal


def repeated(
    folder: Path, workers: int = 1, on_progress: OnProgress = lambda progress: None
) -> Repeated:
    """Evaluate an investigation again from its bags; no experiment runs and no file is written."""
    journal = Journal.read(folder)
    on_progress(InvestigationProgress('prepare'))
    now = journal.setup.investigation(workers)
    lines: list[dict[str, Any]] = []
    differences: list[str] = []
    for line in journal.lines:
        budget = float(line.get('budget', journal.setup.rules.budget))
        now.rules = replace(now.rules, budget=budget)
        choice = now.next()
        if isinstance(choice, Stop) or choice.experiment.name != line['experiment']:
            differences.append(f'experiment {line["number"]} would not be chosen now')
            break
        on_progress(
            InvestigationProgress('judge', line['number'], line['experiment'], line['why'])
        )
        follows = line.get('follows', False)
        if not follows:
            now.history.discard()
        answer = now.take(choice.experiment, record_of(journal.bag(line['number'])))
        lines.append(line_of(line['number'], choice, answer, follows, budget))
        if lines[-1]['after']['names'] != line['after']['names']:
            differences.append(f'experiment {line["number"]} leads to other names')
    now.rules = journal.setup.rules
    end = now.next()
    return Repeated(tuple(lines), end if isinstance(end, Stop) else None, tuple(differences))
