"""State of an investigation: next experiment, belief and stopping rules.

It runs no experiment itself. The caller requests the next experiment, runs it on the actuator and
passes the record back. Equal records in equal order lead to equal choices and verdicts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import Discovery, discover
from piezo_hysteresis.experiments.planned_experiment import (
    ExperimentLimits,
    InvestigationError,
    PlannedExperiment,
    catalogue,
)
from piezo_hysteresis.investigation.experiment_choice import (
    Belief,
    ExperimentChoice,
    belief_of,
    choices,
    hidden_effects,
    prior_belief,
    unseen,
)
from piezo_hysteresis.investigation.predict import in_use, outlook, within
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record

# Length of the history before a record [s]: every record is simulated with its history, and a
# slower state is indistinguishable from a zero offset.
LONGEST = 60.0


class History:
    """The records so far as one continuous voltage signal."""

    def __init__(self, rest: float = 0.0) -> None:  # rest [V]
        self._rest = rest
        self._last: Record | None = None
        self._zero = 0.0

    @property
    def known(self) -> bool:
        """Whether the state of the actuator follows from the last record."""
        return self._last is not None

    def discard(self) -> None:
        """Discard the history, because the actuator received other commands."""
        self._last = None

    def following(self, record: Record) -> Record:
        """Return a record with its voltage history, and append it to the history.

        The initial state of a record is estimated unless its history is known for `LONGEST`.
        """
        start, before = record.start - self._zero, None
        if self._last is not None:
            rest = round((start - self._last.start) / record.dt) - len(self._last)
            before = self._voltage_before(rest, round(LONGEST / record.dt)) if rest >= 0 else None
        if before is None:
            self._zero, start = record.start, 0.0
        begins = 'step' if before is not None and start >= LONGEST else 'estimate'
        info = replace(record.info, start=begins)
        self._last = replace(record, start=start, before=before, info=info)
        return self._last

    def _voltage_before(self, rest: int, most: int) -> FloatArray:
        """Return the voltage before a record that starts after `rest` ticks at rest.

        The voltage is limited to the last `most` ticks.
        """
        assert self._last is not None
        known = (self._last.before, self._last.voltage, np.full(min(rest, most), self._rest))
        found = np.concatenate([part for part in known if part is not None])[-most:]
        earlier = most - found.size if self._rest else 0
        return np.concatenate([np.full(earlier, self._rest), found])


# Shortest time of an evaluation, also beyond the time limit of all [s].
_SHORTEST = 5.0


@dataclass(frozen=True)
class Rules:
    """Stopping rules of an investigation."""

    budget: float = 200.0  # actuator time budget [s]
    sure: float = 0.9  # probability from which a name is certain [1]
    confirmed: int = 1  # number of further experiments that must confirm a certain name [1]
    quiet: float = 0.03  # [1]
    least: float = 0.02  # [nats]
    nameless: int = 6  # [1]
    time_limit: float = 120.0  # time of all evaluations together [s]
    seed: int = 0  # seed of all random choices

    def __post_init__(self) -> None:
        if not (isfinite(self.budget) and self.budget > 0.0):
            raise InvestigationError('the budget must be above 0 s')
        if not 0.5 <= self.sure < 1.0:
            raise InvestigationError('a name is sure from a probability within 0.5 .. 1')


@dataclass(frozen=True)
class Stop:
    """Reason of the end of an investigation."""

    reason: str  # ``sure``, ``nothing``, ``budget``, ``exhausted`` or ``time``
    words: str  # reason in one sentence


@dataclass(frozen=True)
class ExperimentAnswer:
    """Result of one experiment."""

    experiment: PlannedExperiment
    before: Belief  # belief before
    after: Belief  # after it
    spent: float  # actuator time so far, including this experiment [s]

    @property
    def words(self) -> str:
        """Result in one sentence."""
        after = self.after
        if after.verdict == 'none':
            return f'no new residual above the noise; no missing effect with {_chance(after)}'
        gap = f'remaining gap {after.floors:.3g} noise floors'
        if after.incomplete:
            gap += '; the time limit ended the evaluation'
        if after.names:
            return f'{" and ".join(after.names)} with {_chance(after)}; {gap}'
        name, chance = after.most_probable
        return f'an unidentified effect, perhaps {name} ({chance:.2g}); {gap}'


def _chance(belief: Belief) -> str:
    return f'probability {belief.most_probable[1]:.3g}'


@dataclass
class Investigation:
    """Search of the effects that a model lacks, with experiments on the actuator."""

    model: ModelFile  # the model in use, with its known discrepancy
    limits: ExperimentLimits  # limits of every experiment
    rate: float  # ticks per second [Hz]
    rules: Rules = field(default_factory=Rules)  # stopping rules
    workers: int = 1  # number of threads of a discovery
    evaluated: float = field(default=0.0, init=False)  # time of the evaluations so far [s]

    def __post_init__(self) -> None:
        if self.model.schedule is not None:
            raise InvestigationError(
                f'{self.model.model.name} has a set of parameters per drive, and experiments need '
                'one for all of them: identify it without --per-frequency'
            )
        known = self.model.discrepancy
        if known is None:
            raise InvestigationError(
                'the model has no discrepancy: identify it again, on records of the '
                'actuator as it should be'
            )
        every = [
            outlook(each, self.model, known, self.rate)
            for each in catalogue(self.limits, self.rate)
        ]
        self.outlooks = within(every, self.limits.stroke)
        if not any(each.stroke > 0.0 for each in self.outlooks):
            raise InvestigationError(
                'every experiment exceeds the stroke that is allowed: allow more stroke or a '
                'smaller range of voltages'
            )
        self.hidden = hidden_effects(in_use(self.model), self.outlooks, self.limits.amplitude)
        self.belief = prior_belief(self.hidden)
        self.records: list[Record] = []
        self.answers: list[ExperimentAnswer] = []
        self.found: Discovery | None = None
        self.history = History(self.limits.rest)

    @property
    def done(self) -> list[str]:
        """Names of the experiments so far."""
        return [answer.experiment.name for answer in self.answers]

    @property
    def spent(self) -> float:
        """Actuator time so far [s]."""
        return self.answers[-1].spent if self.answers else 0.0

    def experiment(self, name: str) -> PlannedExperiment:
        """Return the experiment with the given name."""
        for each in self.outlooks:
            if each.experiment.name == name:
                return each.experiment
        raise InvestigationError(f'these limits allow no experiment {name!r}')

    def ranked(self) -> list[ExperimentChoice]:
        """Return the possible next experiments, highest expected information per second first."""
        left = self.rules.budget - self.spent
        return choices(self.outlooks, self.belief, self.hidden, self.done, left)

    def next(self) -> ExperimentChoice | Stop:
        """Return the next experiment, or the reason of the end."""
        settled = self._settled()
        ranked = self.ranked()
        if settled and not self.belief.left and not self._separates(ranked):
            return self._sure()
        informative = any(self._is_informative(each) for each in ranked)
        if settled and not informative:
            return self._sure()
        if not ranked:
            return Stop('budget', 'the budget ended without a result')
        if self.evaluated >= self.rules.time_limit:
            reason = f'the evaluations took {self.evaluated:.0f} s without a result'
            return self._sure() if settled else Stop('time', reason)
        if informative or not self.answers or self._confirming():
            return ranked[0]
        if self._nameless() and (others := self._unseen()):
            return others[0]
        if self.belief.verdict == 'none':
            return Stop('nothing', 'no effect is missing that an allowed experiment could show')
        return Stop('exhausted', 'no allowed experiment is expected to add information')

    def _separates(self, ranked: Sequence[ExperimentChoice]) -> bool:
        """Return whether an experiment distinguishes effects that the records do not."""
        return self.belief.alike and any(
            each.discrimination >= self.rules.least for each in ranked
        )

    def _unseen(self) -> list[ExperimentChoice]:
        left = self.rules.budget - self.spent
        return unseen(self.outlooks, self.belief, self.hidden, self.done, left)

    def _nameless(self) -> bool:
        """Return whether the residual has no name and further experiments may follow it."""
        last = [answer.after.verdict for answer in self.answers[-self.rules.nameless :]]
        unknown = [verdict == 'unknown' for verdict in last]
        return (
            bool(unknown)
            and unknown[-1]
            and not (len(last) == self.rules.nameless and all(unknown))
        )

    def _is_informative(self, choice: ExperimentChoice) -> bool:
        """Return whether the expected information of an experiment justifies its run."""
        return (
            choice.first_detection >= self.rules.quiet or choice.discrimination >= self.rules.least
        )

    def _sure(self) -> Stop:
        names = ' and '.join(self.belief.names)
        rest = '; the remaining residual is unexplained' if self.belief.left else ''
        return Stop('sure', f'{names}: sure, and confirmed by another experiment{rest}')

    def _is_significant(self) -> bool:
        return bool(self.belief.names) and self.belief.most_probable[1] >= self.rules.sure

    def _confirming(self) -> bool:
        """Return whether a certain name still needs confirmation by another experiment."""
        return self._is_significant() and not self._settled()

    def _settled(self) -> bool:
        """Return whether the names are certain and confirmed."""
        before = [answer.after.names for answer in self.answers[-1 - self.rules.confirmed :]]
        same = all(names == self.belief.names for names in before)
        return self._is_significant() and len(before) > self.rules.confirmed and same

    def take(
        self,
        experiment: PlannedExperiment,
        measured: Record,
        progress: Callable[[float, str], None] = lambda fraction, words: None,
    ) -> ExperimentAnswer:
        """Add the record of an experiment and update the belief."""
        self.keep(experiment, measured)
        return self.judge(progress)

    def keep(
        self, experiment: PlannedExperiment, measured: Record, after: Belief | None = None
    ) -> None:
        """Add a record; probabilities change when `judge` runs, unless `after` is given."""
        name = f'{len(self.records) + 1:02} {experiment.name}'
        self.records.append(self.history.following(experiment.record(name, measured)))
        spent, before = self.spent + experiment.seconds, self.belief
        self.belief = after or before
        self.answers.append(ExperimentAnswer(experiment, before, self.belief, spent))

    def judge(
        self, progress: Callable[[float, str], None] = lambda fraction, words: None
    ) -> ExperimentAnswer:
        """Update the belief by a discovery on all records, within the time that is left."""
        began = time.monotonic()
        left = max(self.rules.time_limit - self.evaluated, _SHORTEST)
        self.found = discover(
            self.records,
            self.model,
            name=self.model.model.name,
            seed=self.rules.seed,
            workers=self.workers,
            time_limit=left,
            recommend=False,
            progress=progress,
        )
        last = self.answers[-1]
        self.belief = belief_of(self.found, self.hidden, self.done)
        self.evaluated += time.monotonic() - began
        self.answers[-1] = ExperimentAnswer(last.experiment, last.before, self.belief, last.spent)
        return self.answers[-1]


Chooser = Callable[[Investigation], ExperimentChoice | Stop]


def investigate(
    investigation: Investigation,
    run: Callable[[PlannedExperiment], Record],
    on_answer: Callable[[ExperimentChoice, ExperimentAnswer], None] = lambda choice, answer: None,
    chooser: Chooser = Investigation.next,
) -> Stop:
    """Run an investigation to its end."""
    while True:
        choice = chooser(investigation)
        if isinstance(choice, Stop):
            return choice
        answer = investigation.take(choice.experiment, run(choice.experiment))
        on_answer(choice, answer)
