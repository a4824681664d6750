"""Entry of the search: a jointly fitted or a fixed baseline, and its reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.selection.baseline import (
    Baselines,
    fitted_baselines,
    with_revised_starts,
)
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
    fitted_to,
)
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import (
    FixedBaselineEvaluator,
    known_discrepancy,
    with_nuisances_of_records,
    without_repeated,
)
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.policy import HELD, POLICY, SelectionPolicy
from piezo_hysteresis.discovery.selection.rounds import Progress
from piezo_hysteresis.discovery.selection.search import (
    Outcome,
    SelectionResult,
    outcome_of,
    search,
    with_headlines_only,
)
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.identification.initial_conditions.record_start import STEP
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of
from piezo_hysteresis.identification.simulate import clock_about, free_runs
from piezo_hysteresis.models import Discrepancy, Model, ModelFile
from piezo_hysteresis.models.repeated_records import Support, kinds_of, support_of
from piezo_hysteresis.models.repeating import KnownResidual
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.fingerprint import fingerprints, recognised


@dataclass(frozen=True)
class SearchOptions:
    """Options of a search."""

    choices: RecordAssumptions  # known initial conditions and zero offsets of the records
    seed: int  # seed of all random choices
    workers: int  # number of threads
    changed: dict[str, float]  # thresholds of the policy that differ from the preset
    deadline: Deadline  # time limit after which no new step is started

    def __post_init__(self) -> None:
        POLICY.but(**self.changed)  # an unknown name is refused before the records are read

    def policy(self, usual: SelectionPolicy) -> SelectionPolicy:
        """Return a preset of the policy with the changed thresholds."""
        return usual.but(**self.changed)


def run_search(
    data: Dataset,
    given: Model | ModelFile,
    how: SearchOptions,
    progress: Progress,
    *,
    nothing_new: bool = False,
) -> tuple[Baselines, Outcome]:
    """Search the effects that a baseline lacks and evaluate the result on held-out records.

    A free refit would hide the effect in wrong values. If the baseline is a file with a known
    discrepancy, its values are therefore fixed. If the records are those of the file itself
    (`nothing_new`), the baseline is only evaluated on them, because their residual is the known
    discrepancy by definition.
    """
    if isinstance(given, ModelFile) and given.discrepancy is not None:
        if nothing_new:
            held = unsearched(data, given, how)
        else:
            held = _find_held(data, given, how, progress)
        outcome = _evaluated(held, progress)
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
    return base, _evaluated(search(evaluator, base.joint, progress), progress)


def _evaluated(found: SelectionResult, progress: Progress) -> Outcome:
    progress(0.95, 'proving on held-out records')
    return outcome_of(found)


def zeros_apart(choices: RecordAssumptions, data: Dataset) -> RecordAssumptions:
    """Return the choices with the zero offset of every record as a nuisance parameter.

    With an incomplete baseline, different zero offsets are mistaken for a hysteresis loop or a
    memory, and a fit does not leave this local minimum. A common zero offset carries no
    information about an effect.
    """
    several = len({view.name for view in data.training}) > 1
    return replace(choices, zero='record') if choices.zero == 'auto' and several else choices


def unsearched(data: Dataset, given: ModelFile, how: SearchOptions) -> SelectionResult:
    """Return the baseline of a file, evaluated on records without a search."""
    base, seen = held_data(data, given, how)
    return SelectionResult(_evaluator_of(seen, base, given, how), base, base)


def _evaluator_of(
    seen: Dataset,
    base: CandidateFit,
    given: ModelFile,
    how: SearchOptions,
    choices: RecordAssumptions | None = None,
) -> FixedBaselineEvaluator:
    policy, end = how.policy(HELD), how.deadline
    return FixedBaselineEvaluator(seen, how.seed, how.workers, base, given, policy, end, choices)


def _find_held(
    data: Dataset, given: ModelFile, how: SearchOptions, progress: Progress
) -> SelectionResult:
    """Search the effects that the model of a file lacks.

    The history before a record can explain much of a residual: with strong creep, three previous
    levels are equivalent to a drift. If a record that starts at rest at 0 V is assigned another
    initial condition, the search runs with both, and the levels cost the penalty of parameters.
    """
    policy, found = how.policy(HELD), list[tuple[float, SelectionResult]]()
    for searched in (True, False):
        if not searched and (
            how.choices.start != 'auto'
            or not _assigned_records(data, found[0][1].evaluator.data, given)[0]
            or how.deadline.skips('stated initial conditions')
        ):
            break
        base, seen = held_data(data, given, how, searched=searched)
        choices = how.choices if searched else None
        evaluator = _evaluator_of(seen, base, given, how, choices)
        still = evaluator.evaluated(replace(base, sampling_offset=evaluator.late))
        base = min(base, still, key=evaluator.score)
        each = with_headlines_only(search(evaluator, base, progress))
        assigned, free = _assigned_records(data, each.evaluator.data, given)
        price = policy.price * (assigned - free)
        found.append((each.evaluator.score(each.final) + price, each))
    return min(found, key=lambda pair: pair[0])[1]


def held_data(
    data: Dataset, given: ModelFile, how: SearchOptions, *, searched: bool = True
) -> tuple[CandidateFit, Dataset]:
    """Return the baseline with the values of its file, and the data with its initial conditions.

    Without `searched`, the records keep their own initial conditions. The known discrepancy of the
    baseline in phase with the drive is subtracted.
    """
    late, policy, choices = given.sampling_offset, how.policy(HELD), how.choices
    nominal = ModelSpec(given.model, dict(given.values), sampling_offset=late)
    known = (
        with_revised_starts(nominal, data, choices, how.workers, alone=True) if searched else data
    )
    zeroed = with_nuisances_of_records(known, choices)
    seen = without_repeated(zeroed, known_discrepancy(given), policy)
    clocked = fitted_to(
        nominal,
        seen.training,
        evaluations=policy.final_evaluations,
        tolerance=policy.final_tolerance,
        free=(),
        clock=clock_about(given, data.training[0].dt, policy.jitter),
        workers=how.workers,
    )
    return evaluated_on(clocked or nominal, seen.training), seen


def _assigned_records(data: Dataset, seen: Dataset, given: ModelFile) -> tuple[int, int]:
    """Return the number of records at rest at 0 V with another start, and levels without price.

    The score contains the price of the levels before a record. A record with the start of a
    reference record with the same drive does not count, and its levels have no price.
    """
    traces = () if given.discrepancy is None else given.discrepancy.traces
    assigned = free = 0
    for before, after in zip(data.training, seen.training, strict=True):
        voltage, kind = after.voltage[after.first :], after.begins.kind
        if before.begins.kind != STEP.kind or after.begins == before.begins:
            continue
        if any(trace.began_similarly(voltage, after.dt, kind) for trace in traces):
            free += after.begins.parameters
        else:
            assigned += 1
    return assigned, free


# Ratio of the strokes at one drive from which repeats are of two actuators.
_STROKES = 2.0


def as_on(
    reference: Sequence[Record],
    baseline: Model | ModelFile,
    choices: RecordAssumptions | None = None,
    workers: int = 1,
) -> ModelFile:
    """Return the baseline as a model file with its discrepancy on reference records.

    A named model is identified on these records. A file keeps its values, and its discrepancy is
    the residual on these records.
    """
    file, missed = _missed(annotated(reference), baseline, choices or RecordAssumptions(), workers)
    return replace(file, discrepancy=missed)


def with_repeats(
    repeats: Sequence[Record],
    baseline: Model | ModelFile,
    choices: RecordAssumptions | None = None,
    workers: int = 1,
) -> ModelFile:
    """Return the baseline as a model file that knows how much unchanged records differ.

    A named model is identified on these records. To those of a file they are added, except for
    the ones that it was identified from. New records are not judged if they are among them.
    """
    records = list(annotated(repeats))
    _require_single(records)
    known = baseline.discrepancy if isinstance(baseline, ModelFile) else None
    if isinstance(baseline, ModelFile):
        own = recognised(records, baseline.provenance.records)
        records = [record for record in records if record.name not in own]
    if isinstance(baseline, ModelFile) and not records:
        file, missed = baseline, known
    else:
        file, missed = _missed(records, baseline, choices or RecordAssumptions(), workers)
    if known is not None and missed is not None and missed is not known:
        rows, traces = (*known.conditions, *missed.conditions), (*known.traces, *missed.traces)
        missed = replace(missed, conditions=rows, traces=traces)
    if missed is None or all(each.records == 1 for each in missed.kinds):
        raise IdentificationError(
            'the repeats hold no two records of the same drive: give at least two of one '
            'experiment, with nothing changed in between'
        )
    _require_one_actuator(missed)
    seen = (*file.provenance.records, *fingerprints(records))
    return replace(file, discrepancy=missed, provenance=replace(file.provenance, records=seen))


def _require_single(records: Sequence[Record]) -> None:
    """Reject a run that is given twice: p counts runs."""
    seen = fingerprints(records)
    for k, record in enumerate(records):
        same = [records[j].name for j in range(k) if seen[j].is_of(record)]
        if same:
            raise IdentificationError(
                f'the repeats {same[0]} and {record.name} are one run; give each once'
            )


def _require_one_actuator(missed: Discrepancy) -> None:
    """Reject repeats of one drive whose strokes differ as those of two actuators or units do."""
    for rows in kinds_of(missed.conditions):
        least, most = (f(each.stroke for each in rows) for f in (min, max))
        if most > _STROKES * least:
            raise IdentificationError(
                f'the repeats move {1e6 * least:.3g} and {1e6 * most:.3g} µm at the same drive: '
                'another actuator, or another unit; give runs with nothing changed in between'
            )


def _missed(
    records: Sequence[Record],
    baseline: Model | ModelFile,
    choices: RecordAssumptions,
    workers: int,
) -> tuple[ModelFile, Discrepancy]:
    """Return a baseline as a model file, and its discrepancy on records."""
    if isinstance(baseline, ModelFile):
        file = baseline
        runs = free_runs(file, records, choices)
    else:
        found = identify(
            records, baseline, workers=workers, begins=choices.start, zero=choices.zero
        )
        file, runs = found.model, found.runs
    left, views = runs.residuals, runs.views
    missed = discrepancy_of(left, held_out=file is baseline)
    if missed is None:
        raise IdentificationError(
            'the reference does not move the actuator: give records of similar drives'
        )
    traces = tuple(
        KnownResidual(each.voltage, each.error, each.dt, view.begins.kind)
        for each, view in zip(left, views, strict=True)
        if each.voltage is not None and np.all(np.isfinite(each.error))
    )
    return file, replace(missed, traces=traces)


def support_for(
    records: Sequence[Record], file: ModelFile, choices: RecordAssumptions | None = None
) -> Support | None:
    """Return what the untouched records of a file say on new records; None without repeats."""
    known = file.discrepancy
    if known is None or all(each.records == 1 for each in known.kinds):
        return None
    new = discrepancy_of(free_runs(file, records, choices).residuals, held_out=True)
    return None if new is None else support_of(new.conditions, known.conditions)
