"""Where a search starts: a baseline that is fitted besides, or one that its file holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection.baseline import Baselines, fitted_baselines, told_by
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    fitted_to,
    judged_on,
)
from piezo_hysteresis.discovery.selection.deadline import Deadline
from piezo_hysteresis.discovery.selection.free import FreeEvaluator
from piezo_hysteresis.discovery.selection.held import HeldEvaluator, clock_about, with_repeated
from piezo_hysteresis.discovery.selection.outcome import Outcome, outcome_of
from piezo_hysteresis.discovery.selection.policy import HELD, POLICY, SelectionPolicy
from piezo_hysteresis.discovery.selection.rounds import Progress
from piezo_hysteresis.discovery.selection.search import Found, search
from piezo_hysteresis.identification.circumstances import Choices, zeros_lie_apart
from piezo_hysteresis.identification.record_start import STEP
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model, ModelFile


@dataclass(frozen=True)
class Searching:
    """How a search goes.

    Attributes
    ----------
    choices : Choices
        What is known of how the records begin and where their zeros lie.
    seed : int
        Of every random choice.
    workers : int
        Threads.
    changed : dict of str to float
        Numbers of the policy that are not the usual ones.
    deadline : Deadline
        When nothing more is begun.
    """

    choices: Choices
    seed: int
    workers: int
    changed: dict[str, float]
    deadline: Deadline

    def policy(self, usual: SelectionPolicy) -> SelectionPolicy:
        """Return the usual policy with what was changed."""
        return usual.but(**self.changed)


def find(
    data: Dataset, given: Model | ModelFile, how: Searching, progress: Progress
) -> tuple[Baselines, Outcome]:
    """Find what a baseline lacks, in the view that suits what is known of it, and judge that.

    What the user knows is a prior: a free refit would hide the effect in wrong values. So the
    values of a file that says what it misses are held.

    Raises
    ------
    IdentificationError
        If the baseline cannot be fitted to the records at all, or the policy is impossible.
    """
    if isinstance(given, ModelFile) and given.discrepancy is not None:
        held = _find_held(data, given, how, progress)
        outcome = _judged(held, progress)
        nominal = outcome.found.start
        return Baselines(nominal, None, nominal), outcome
    base, seen = fitted_baselines(data, given, how.choices, how.workers)
    if how.choices.zero == 'auto' and _may_share_zeros(base, seen):
        apart = replace(how.choices, zero='record')
        other, others = fitted_baselines(data, given, apart, how.workers)
        if zeros_lie_apart(other.joint.floors**2, base.joint.floors**2):
            base, seen = other, others
    progress(0.12, 'baselines fitted')
    hints = [base.slow.values] if base.slow is not None else []
    evaluator = FreeEvaluator(
        seen, how.seed, how.workers, how.policy(POLICY), hints, how.deadline, how.choices
    )
    return base, _judged(search(evaluator, base.joint, progress), progress)


def _may_share_zeros(base: Baselines, data: Dataset) -> bool:
    """Return whether records that a baseline leaves much of have one zero, wrongly perhaps.

    Zeros that lie apart may look like a loop to a baseline that lacks something.
    """
    views = data.training
    shared = len(views) > 1 and not all(view.own_zero for view in views)
    return shared and base.joint.floors > POLICY.explained_gap


def _judged(found: Found, progress: Progress) -> Outcome:
    progress(0.95, 'proving on held-out records')
    return outcome_of(found)


def _find_held(data: Dataset, given: ModelFile, how: Searching, progress: Progress) -> Found:
    """Find what the model of a file lacks.

    What happened before a record can explain much: three levels of a strongly creeping model pass
    for a drift. So where a record that begins at rest at 0 V is said to have begun otherwise, both
    are followed to their end, and the levels cost what parameters cost.
    """
    assert given.discrepancy is not None
    policy, found = how.policy(HELD), list[tuple[float, Found]]()
    for searched in (True, False):
        base, seen = held_data(data, given, how.choices, searched=searched)
        if not searched and (
            how.deadline.skips('records that begin as they say')
            or how.choices.start != 'auto'
            or not _invented(data, found[0][1].evaluator.data)
        ):
            break
        evaluator = HeldEvaluator(
            seen,
            how.seed,
            how.workers,
            base,
            given.discrepancy,
            policy,
            how.deadline,
            given.deviations,
            given.sampling_offset,
            given.covariance(),
        )
        still = evaluator.judged(replace(base, sampling_offset=evaluator.late))
        base = min(base, still, key=evaluator.score)
        each = search(evaluator, base, progress)
        levels = _invented(data, each.evaluator.data)
        found.append((each.evaluator.score(each.final) + policy.price * levels, each))
    return min(found, key=lambda pair: pair[0])[1]


def held_data(
    data: Dataset, given: ModelFile, choices: Choices, *, searched: bool = True
) -> tuple[CandidateFit, Dataset]:
    """Return the baseline as its file says, and the data as it sees how they begin.

    Where starts are not `searched`, records begin as they say themselves. What the file says that
    the baseline misses in phase with the drive is taken off.
    """
    late = given.sampling_offset
    nominal = ModelSpec(given.model, dict(given.values), sampling_offset=late)
    known = told_by(nominal, data, choices, alone=True) if searched else data
    own = choices.zero != 'common'

    def zeroed(views: Sequence[Target]) -> tuple[Target, ...]:
        return tuple(replace(v, own_zero=own, precision=1.0, influence=None) for v in views)

    seen = replace(known, training=zeroed(known.training), held_out=zeroed(known.held_out))
    assert given.discrepancy is not None
    seen = with_repeated(seen, given.discrepancy, HELD, -1.0)
    clocked = fitted_to(
        nominal,
        seen.training,
        evaluations=HELD.final_evaluations,
        tolerance=HELD.final_tolerance,
        free=(),
        clock=clock_about(late, data.training[0].dt),
    )
    return judged_on(clocked or nominal, seen.training), seen


def _invented(data: Dataset, seen: Dataset) -> int:
    """Return how many numbers tell the starts of records that seem to begin at rest at 0 V."""
    count = 0
    for before, after in zip(data.training, seen.training, strict=True):
        if before.begins.kind == STEP.kind and after.begins != before.begins:
            count += 1 + len(after.begins.levels)
    return count
