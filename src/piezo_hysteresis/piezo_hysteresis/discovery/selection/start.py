"""Where a search starts: a baseline that is fitted besides, or one that its file holds."""

from __future__ import annotations

from dataclasses import dataclass, replace

from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection.anchored_evaluator import (
    HeldEvaluator,
    known_to_miss,
    without_repeated,
)
from piezo_hysteresis.discovery.selection.baseline import (
    Baselines,
    fitted_baselines,
    with_revised_starts,
)
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    fitted_to,
    judged_on,
)
from piezo_hysteresis.discovery.selection.deadline import Deadline
from piezo_hysteresis.discovery.selection.final_evaluation import (
    Outcome,
    outcome_of,
    with_headlines_only,
)
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.policy import HELD, POLICY, SelectionPolicy
from piezo_hysteresis.discovery.selection.rounds import Progress
from piezo_hysteresis.discovery.selection.search import Found, search
from piezo_hysteresis.identification.clock import clock_about
from piezo_hysteresis.identification.initial_conditions.record_start import STEP
from piezo_hysteresis.identification.initial_conditions.revision import Choices
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
        When nothing more is started.
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
    data: Dataset,
    given: Model | ModelFile,
    how: Searching,
    progress: Progress,
    *,
    nothing_new: bool = False,
) -> tuple[Baselines, Outcome]:
    """Find what a baseline lacks, in the view that suits what is known of it, and judge that.

    What the user knows is a prior: a free refit would hide the effect in wrong values. So the
    values of a file that says what it misses are held. Where its own records are given again
    (`nothing_new`), it is only judged on them: what it misses there it misses by definition.

    Raises
    ------
    IdentificationError
        If the baseline cannot be fitted to the records at all, or the policy is impossible.
    """
    if isinstance(given, ModelFile) and given.discrepancy is not None:
        if nothing_new:
            held = _unsearched(data, given, how)
        else:
            held = _find_held(data, given, how, progress)
        outcome = _judged(held, progress)
        nominal = outcome.found.start
        if nothing_new:
            left = replace(outcome.remainder, significant=False, note='')
            outcome = replace(outcome, remainder=left)
        return Baselines(nominal, None, nominal), outcome
    choices = zeros_apart(how.choices, data)
    base, seen = fitted_baselines(data, given, choices, how.workers, how.deadline)
    progress(0.12, 'baselines fitted')
    evaluator = FreeEvaluator(
        seen, how.seed, how.workers, how.policy(POLICY), how.deadline, choices
    )
    return base, _judged(search(evaluator, base.joint, progress), progress)


def _judged(found: Found, progress: Progress) -> Outcome:
    progress(0.95, 'proving on held-out records')
    return outcome_of(found)


def zeros_apart(choices: Choices, data: Dataset) -> Choices:
    """Return the choices by which a zero is a nuisance of every record, as its start is.

    Zeros that lie apart pass for a loop or a memory with a baseline that lacks something, and a
    fit does not come back from there; that they are one tells nothing of an effect.
    """
    several = len({view.name for view in data.training}) > 1
    return replace(choices, zero='record') if choices.zero == 'auto' and several else choices


def _unsearched(data: Dataset, given: ModelFile, how: Searching) -> Found:
    base, seen = held_data(data, given, how)
    policy = how.policy(HELD)
    evaluator = HeldEvaluator(seen, how.seed, how.workers, base, given, policy, how.deadline)
    return Found(evaluator, base, base)


def _find_held(data: Dataset, given: ModelFile, how: Searching, progress: Progress) -> Found:
    """Find what the model of a file lacks.

    What happened before a record can explain much: three levels of a strongly creeping model pass
    for a drift. So where a record that begins at rest at 0 V is said to start otherwise, both
    are followed to their end, and the levels cost what parameters cost.
    """
    policy, found = how.policy(HELD), list[tuple[float, Found]]()
    for searched in (True, False):
        if not searched and (
            how.choices.start != 'auto'
            or not _invented(data, found[0][1].evaluator.data, given)
            or how.deadline.skips('records that begin as they say')
        ):
            break
        base, seen = held_data(data, given, how, searched=searched)
        evaluator = HeldEvaluator(seen, how.seed, how.workers, base, given, policy, how.deadline)
        still = evaluator.judged(replace(base, sampling_offset=evaluator.late))
        base = min(base, still, key=evaluator.score)
        each = with_headlines_only(search(evaluator, base, progress))
        levels = _invented(data, each.evaluator.data, given)
        found.append((each.evaluator.score(each.final) + policy.price * levels, each))
    return min(found, key=lambda pair: pair[0])[1]


def held_data(
    data: Dataset, given: ModelFile, how: Searching, *, searched: bool = True
) -> tuple[CandidateFit, Dataset]:
    """Return the baseline as its file says, and the data as it sees how they begin.

    Where starts are not `searched`, records begin as they say themselves. What the file says that
    the baseline misses in phase with the drive is taken off.
    """
    late, policy, choices = given.sampling_offset, how.policy(HELD), how.choices
    nominal = ModelSpec(given.model, dict(given.values), sampling_offset=late)
    known = (
        with_revised_starts(nominal, data, choices, how.workers, alone=True) if searched else data
    )
    own = choices.zero != 'common'
    zeroed = known.with_each(
        lambda view: replace(view, own_zero=own, precision=1.0, influence=None)
    )
    seen = without_repeated(zeroed, known_to_miss(given), policy)
    clocked = fitted_to(
        nominal,
        seen.training,
        evaluations=policy.final_evaluations,
        tolerance=policy.final_tolerance,
        free=(),
        clock=clock_about(given, data.training[0].dt, policy.jitter),
        workers=how.workers,
    )
    return judged_on(clocked or nominal, seen.training), seen


def _invented(data: Dataset, seen: Dataset, given: ModelFile) -> int:
    """Return how many numbers tell the starts of records that seem to begin at rest at 0 V.

    Where a record of the reference with the same drive began so, nothing was invented.
    """
    traces = () if given.discrepancy is None else given.discrepancy.traces
    count = 0
    for before, after in zip(data.training, seen.training, strict=True):
        voltage, kind = after.voltage[after.first :], after.begins.kind
        if before.begins.kind != STEP.kind or after.begins == before.begins:
            continue
        if not any(trace.began_so(voltage, after.dt, kind) for trace in traces):
            count += 1 + len(after.begins.levels)
    return count
