"""A discovery from the records to its verdict and its model file."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from piezo_hysteresis.common.results import Reportable
from piezo_hysteresis.discovery.data.dataset import (
    Check,
    Dataset,
    beyond_the_fit,
    check,
    outside_of,
    split,
    unsynchronised,
)
from piezo_hysteresis.discovery.data.second_channel import sensor_curve
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.detection.bends import similar_effects
from piezo_hysteresis.discovery.detection.limits import DetectionLimit, detection_limits
from piezo_hysteresis.discovery.detection.statements import with_better_experiments
from piezo_hysteresis.discovery.selection.baseline import Baselines
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.elimination import Step
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.rounds import Progress, SelectionRound
from piezo_hysteresis.discovery.selection.search import without_names
from piezo_hysteresis.discovery.selection.start import (
    SearchOptions,
    as_on,
    run_search,
    support_for,
    unsearched,
    with_repeats,
)
from piezo_hysteresis.discovery.verdict.build_verdict import build_verdict
from piezo_hysteresis.discovery.verdict.verdict import HeldOutComparison, Verdict, compare_held_out
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.measurement import as_measured
from piezo_hysteresis.identification.method_settings import require_settings
from piezo_hysteresis.identification.model_discrepancy import discrepancy_of, residual_of
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.prediction import predictions, with_mean_zero
from piezo_hysteresis.identification.simulate import entry_for, free_runs
from piezo_hysteresis.models import Correlation, Discrepancy, Model, ModelFile, Provenance
from piezo_hysteresis.models.choice import Modelled, ModelLike, chosen
from piezo_hysteresis.models.modelfile import OFFSET_NOTE, OFFSET_STD_NOTE
from piezo_hysteresis.models.schedule import OperatingRange
from piezo_hysteresis.records import Record, listed
from piezo_hysteresis.records.fingerprint import Fingerprint, fingerprints, recognised


def final_model(found: Discovery, data: Sequence[str] = ()) -> ModelFile:
    """Return the final model with values, standard deviations and provenance."""
    final = found.final
    own = with_mean_zero(
        final.model,
        {name: final.values[name] for name in final.model.parameter_names},
        found.data.training,
        final.sampling_offset,
    )
    deviations, together = _uncertainty(found, own)
    effects = ', '.join(e.name for e in found.verdict.effects) or 'none'
    file = ModelFile(
        final.model,
        own,
        deviations,
        Provenance(
            data=tuple(data),
            date=datetime.now(UTC).isoformat(timespec='seconds'),
            fit=f'discover, baseline {found.verdict.baseline}, seed {found.verdict.seed}',
            rate=found.data.records[0].rate,
            noise_floor=found.floor,
            notes={
                'effects': effects,
                OFFSET_NOTE: float(final.sampling_offset),
                **_clock_note(found),
            },
            records=_seen(found),
            voltage=_covered(found),
        ),
        together,
        remaining_discrepancy(found),
    )
    worst = max(row.free_run_rms for row in free_runs(file, found.data.records).errors)
    return replace(file, provenance=replace(file.provenance, free_run_rms=worst))


def _clock_note(found: Discovery) -> dict[str, float]:
    """Return the note on the standard deviation of the sampling offset.

    It comes from the fit, or from the file of a baseline with the same offset.
    """
    fitted, given = found.final.fitted, found.given
    std = fitted.std.get(SAMPLING_OFFSET, inf) if fitted is not None else inf
    if given is not None and given.sampling_offset == found.final.sampling_offset:
        std = min(std, given.sampling_offset_std)
    return {OFFSET_STD_NOTE: float(std)} if np.isfinite(std) else {}


def _seen(found: Discovery) -> tuple[Fingerprint, ...]:
    """Return the records used for the model, including those of a fixed baseline."""
    before = found.given.provenance.records if found.given is not None else ()
    return tuple(dict.fromkeys((*before, *fingerprints(found.data.records))))


def _covered(found: Discovery) -> OperatingRange | None:
    """Return the voltages of the records, and of those of a fixed baseline."""
    before = found.given.provenance.voltage if found.given is not None else None
    own = OperatingRange.of(found.data.records)
    return before if own is None else own.joined(before)


def _uncertainty(
    found: Discovery, own: Mapping[str, float]
) -> tuple[dict[str, float], Correlation | None]:
    """Return standard deviations and correlation of fitted and of fixed values.

    Values that equal those of the baseline file keep their standard deviations from the file.
    """
    final = found.final
    std = final.fitted.std if final.fitted is not None else {}
    fitted = {k: v for k, v in std.items() if k in own and np.isfinite(v)}
    if found.given is not None and found.given.discrepancy is not None:
        before = found.given
        kept = {
            k: v
            for k, v in before.deviations.items()
            if own.get(k) == before.values[k] and k not in fitted
        }
        known = before.correlation
        if known is not None and not set(known.names) & set(fitted):
            return {**kept, **fitted}, Correlation.among(known.names, known.matrix, tuple(kept))
        fitted = {**kept, **fitted}
    if final.fitted is None:
        return fitted, None
    renewed = tuple(name for name in fitted if name in final.fitted.free)
    return fitted, Correlation.among(final.fitted.free, final.fitted.correlation, renewed)


def remaining_discrepancy(found: Discovery) -> Discrepancy | None:
    """Return the discrepancy of the final model by frequency, harmonic and amplitude."""
    records = {r.name: r for r in found.data.records}
    views = found.data.training
    kept = [records[view.name] for view in views]
    final = found.final
    runs = predictions(final.model, final.values, views, final.sampling_offset, checked=False)
    return discrepancy_of(map(residual_of, kept, runs), held_out=False)


@dataclass(frozen=True, repr=False)
class Discovery(Reportable, Modelled):
    """Result of a discovery.

    Attributes
    ----------
    verdict : Verdict
        Verdict, as in ``verdict.json``.
    data : Dataset
        Records, split into training and held-out views.
    floor : float
        Noise rms [m].
    baselines : Baselines
        Versions of the baseline.
    steps : tuple of Step
        Accepted effects, in the order of their selection.
    final : CandidateFit
        The model with all accepted effects.
    proof : HeldOutComparison
        Gaps of both models on held-out records.
    check : Check
        Quality and coverage of the records.
    given : ModelFile or None
        Model file of the baseline.
    last : SelectionRound or None
        The last round without an accepted effect, if there is one.
    alike : mapping of str to tuple of ModelSpec
        By the name of each found effect, the models of the effects that these records cannot
        distinguish from it.
    """

    _INSTEAD: ClassVar = {
        'verdict.effects': 'effects effect missing missing_effects',
        'to_frame(), or verdict.effects': 'names probabilities',
        'verdict.summary': 'summary text',
        'verdict.held_out': 'held_out',
        'floor': 'noise noise_floor',
        'verdict.detection_limits': 'detection_limits limits',
        'verdict.seconds': 'seconds',
        'verdict.check': 'warnings',
        'verdict.next_experiments': 'next_experiments',
        'verdict.effects[0].alternatives': 'alternatives',
    }

    verdict: Verdict
    data: Dataset
    floor: float
    baselines: Baselines
    steps: tuple[Step, ...]
    final: CandidateFit
    proof: HeldOutComparison
    check: Check
    given: ModelFile | None = None
    last: SelectionRound | None = None
    alike: Mapping[str, tuple[ModelSpec, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        lines = [f'Discovery: {self.verdict.summary}']
        lines += [
            f'  {each.name}, probability {each.probability:.3g}' for each in self.verdict.effects
        ]
        return '\n'.join(lines)

    def columns(self) -> dict[str, list[Any]]:
        """Return the effects by column, in the order of their selection; gaps are in metres."""
        effects = self.verdict.effects
        return {
            'effect': [each.name for each in effects],
            'probability': [each.probability for each in effects],
            'p_value': [each.p_value for each in effects],
            'gap_before_rms_m': [each.gap_before_rms_m for each in effects],
            'gap_after_rms_m': [each.gap_after_rms_m for each in effects],
            'alternatives': [
                ', '.join(other.name for other in each.alternatives) for each in effects
            ],
        }

    def model_file(self, data: Sequence[str] = ()) -> ModelFile:
        """Return the baseline with the accepted effects as a model file.

        Parameters
        ----------
        data : sequence of str
            Names of the files with the records.
        """
        return final_model(self, data)


def discover(
    records: Record | Sequence[Record],
    baseline: ModelLike,
    *,
    name: str = '',
    seed: int = 0,
    workers: int = 1,
    reference: Record | Sequence[Record] = (),
    repeats: Record | Sequence[Record] = (),
    begins: str = 'auto',
    zero: str = 'auto',
    policy: Mapping[str, float] | None = None,
    time_limit: float = inf,
    recommend: bool = True,
    progress: Progress = lambda fraction, message: None,
) -> Discovery:
    """Search the effects that `baseline` lacks in `records`.

    Parameters
    ----------
    records : Record or sequence of Record
        Records of one actuator at one rate.
    baseline : str, Path, Model, ModelFile or Identification
        Model that is tested for missing effects. A name is fitted to `records`. The values of a
        model, a file or a result stay fixed; of a model with a set of parameters per drive, the
        records have to be of one drive. Records from which it was identified cannot show a
        new effect and are excluded. If all records are excluded, the verdict is ``none`` and
        states this.
    name : str
        Name of the baseline in the verdict.
    seed : int
        Seed of all random choices: the same seed gives the same verdict.
    workers : int
        Number of threads; the verdict does not depend on it.
    reference : Record or sequence of Record
        Records of the same actuator in its earlier state; a residual of the baseline on them is
        not reported.
    repeats : Record or sequence of Record
        Records of the same actuator with nothing changed, at least two of one drive. They
        calibrate what counts as new: `Verdict.repeats`.
    begins : str
        Initial condition of the records: ``auto``, ``rest``, ``step``, ``settled`` or
        ``estimate``.
    zero : str
        Zero of the displacement: ``record``, ``common`` or ``auto``.
    policy : mapping of str to float, optional
        Thresholds that differ from those of `SelectionPolicy`.
    time_limit : float
        Time after which no new step is started [s]. The verdict is the best result so far and
        lists the skipped steps. It then depends on the speed of the machine.
    recommend : bool
        Whether a verdict ``none`` states the experiments that lower its detection limits.
    progress : callable
        Called with ``(fraction, message)``.

    Raises
    ------
    IdentificationError
        If the records cannot be evaluated; the message states what to record.
    ModelError
        If the model is unknown.
    """
    records = listed(records)
    require_settings(seed=seed, workers=workers)
    if isinstance(baseline, str | Path):
        name = name or str(baseline)
    baseline = chosen(baseline)
    began = time.monotonic()
    end = Deadline(time_limit)
    choices = RecordAssumptions(begins, zero)
    records, remarks = as_measured(records)
    if isinstance(baseline, ModelFile):
        baseline = entry_for(baseline, records)
    if before := as_measured(listed(reference))[0]:
        baseline = as_on(before, baseline, choices, workers)
    if unchanged := as_measured(listed(repeats))[0]:
        baseline = with_repeats(unchanged, baseline, choices, workers)
    how = SearchOptions(choices, seed, workers, dict(policy or {}), end)
    given = annotated(records)
    own = _own_records(given, baseline)
    known = [record for record in given if record.name not in own] or given
    coverage = check(known)
    unlike = unsynchronised(known)
    if isinstance(baseline, ModelFile) and not unlike.entirely:
        unlike = outside_of(known, baseline)
    data = split(known, how.choices.start)
    data = replace(data, second=sensor_curve(known, before))
    if data.second is not None:
        remarks = [*remarks, data.second.sentence()]
    if not isinstance(baseline, ModelFile):
        unit = known[0].info.input_unit
        remarks = [*remarks, *beyond_the_fit(data.training, data.held_out, unit)]
    coverage = replace(coverage, findings=(*remarks, *coverage.findings), outside=unlike.sentence)
    progress(0.02, 'checked, split and noise measured')
    only_own = len(own) == len(given)
    support = None
    if isinstance(baseline, ModelFile) and not only_own:
        support = support_for(known, baseline, choices)
    usual = support is not None and support.complete and not support.deviates
    base, outcome = run_search(data, baseline, how, progress, nothing_new=only_own or usual)
    if unlike.entirely:
        outcome = without_names(outcome)
    found, end = outcome.found, end.with_reserve()
    measured = found.evaluator.measured
    proof = compare_held_out(measured, outcome.before, outcome.after)
    limits: tuple[DetectionLimit, ...] = ()
    # a residual that starts a search by itself would show an effect of any size
    explained = not outcome.remainder.significant
    if len(own) < len(given) and explained and not end.skips('detection limits'):
        progress(0.97, 'calculating detection limits')
        limits = detection_limits(found.evaluator, found.final, found.start)
        if recommend and not found.steps:
            limits = with_better_experiments(found.evaluator, found.final, found.start, limits)
    alike = {
        step.fit.effect: similar_effects(found.evaluator, step, found.start)
        for step in found.steps
        if not end.skips('similar effects')
    }
    title = name or base.joint.model.name
    more = own, limits, alike, support
    verdict = build_verdict(coverage, base, outcome, proof, title, seed, *more)
    return Discovery(
        replace(verdict, seconds=time.monotonic() - began),
        measured,
        found.evaluator.floor,
        base,
        found.steps,
        found.final,
        proof,
        coverage,
        baseline if isinstance(baseline, ModelFile) else None,
        found.last,
        {name: each.models for name, each in alike.items()},
    )


def limits_of(
    records: Record | Sequence[Record], model: ModelFile, *, workers: int = 1
) -> tuple[DetectionLimit, ...]:
    """Return the smallest size of each known effect that records would show beyond a model.

    Parameters
    ----------
    records : Record or sequence of Record
        Of one actuator at one rate.
    model : ModelFile
        With its discrepancy, which an effect must exceed.
    workers : int
        Threads; the result does not depend on it.

    Raises
    ------
    IdentificationError
        If the file states no discrepancy, or the records do not show their noise.
    """
    how = SearchOptions(RecordAssumptions('auto', 'auto'), 0, workers, {}, Deadline(inf))
    data = split(annotated(as_measured(listed(records))[0]), how.choices.start)
    found = unsearched(data, model, how)
    limits = detection_limits(found.evaluator, found.final, found.start)
    return with_better_experiments(found.evaluator, found.final, found.start, limits)


def _own_records(records: Sequence[Record], baseline: Model | ModelFile) -> tuple[str, ...]:
    """Return the names of the records from which the model file was identified."""
    if not isinstance(baseline, ModelFile):
        return ()
    return tuple(recognised(records, baseline.provenance.records))
