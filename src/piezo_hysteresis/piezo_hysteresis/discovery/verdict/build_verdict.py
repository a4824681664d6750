"""Builds the verdict from the result of a search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.discovery.data.check import Check
from piezo_hysteresis.discovery.detection.limits import DetectionLimit, LookAlike
from piezo_hysteresis.discovery.detection.statements import recommendations, sentence, statements
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.anchored_evaluator import HeldEvaluator
from piezo_hysteresis.discovery.selection.baseline import Baselines
from piezo_hysteresis.discovery.selection.search import Outcome
from piezo_hysteresis.discovery.verdict.describe import describe, places
from piezo_hysteresis.discovery.verdict.naming import (
    named_effects,
    summary_of,
    suspects,
    with_fractions,
)
from piezo_hysteresis.discovery.verdict.verdict import (
    HeldOut,
    Proof,
    ProofRow,
    Unexplained,
    Verdict,
    over_frequency,
)
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.identification.two_way_lag import TwoWayLag, two_way_lag
from piezo_hysteresis.models import Model, described, name_of
from piezo_hysteresis.models.repeated_records import Support
from piezo_hysteresis.records import Record

if TYPE_CHECKING:
    from piezo_hysteresis.discovery.selection.elimination import Step

ALTERNATIVE_PROBABILITY = 0.02


def instead(model: Model) -> tuple[str, ...]:
    """Return the advice for a model that was tested on the records of its own identification."""
    name = name_of(model)
    by_name = f'To find what the model lacks, give its name: `discover DATA --baseline {name}`.'
    changed = 'To find what has changed since, record new data and pass them with the model file.'
    return (by_name, changed) if name else (changed,)


def advise(
    check: Check,
    steps: Sequence[Step],
    left: bool,
    alike: Mapping[str, Sequence[LookAlike]] = MappingProxyType({}),
) -> list[str]:
    """Return the recommended experiments, most informative first."""
    separated: dict[str, dict[str, None]] = {}  # effects by the experiment that separates them
    for step in steps:
        chances = step.round.probabilities()
        alternatives = [
            name for name, chance in chances.items() if chance > ALTERNATIVE_PROBABILITY
        ]
        similar = (each.name for each in alike.get(step.fit.effect, ()))
        alternatives = list(dict.fromkeys((*alternatives, *similar)))
        if len(alternatives) < 2:
            continue
        for name in alternatives:
            experiment = described(name)[0].experiment
            separated.setdefault(experiment, {}).update(dict.fromkeys(alternatives))
    sentences = [
        f'To distinguish {", ".join(names)}: {experiment[0].lower()}{experiment[1:]}'
        for experiment, names in separated.items()
    ]
    named = {step.fit.effect for step in steps}
    for names, advice in check.confounded:
        if named & set(names) or (left and not steps):
            sentences.append(f'To distinguish {", ".join(names)}: {advice}.')
    if left:
        sentences.append(
            'Repeat the record with the largest residual: a residual that does not repeat is a '
            'disturbance, one that repeats comes from the actuator.'
        )
    if not sentences:
        sentences = [f'To continue: {advice}.' for advice in check.experiments()[:2]]
    return list(dict.fromkeys(sentences))


_MOST_PLACES = 20
# What a file without repeats leaves open.
ONE_RECORD = (
    'The model file does not show how much unchanged records differ: repeat one and give the '
    'repeats to `identify`, or to `discover` with --repeats.'
)
OTHER_REPEATS = (
    'The repeats are of other drives than these records: they do not show how much these differ.'
)


def build_verdict(
    coverage: Check,
    base: Baselines,
    outcome: Outcome,
    proof: Proof,
    name: str,
    seed: int,
    own: Sequence[str] = (),
    limits: Sequence[DetectionLimit] = (),
    alike: Mapping[str, tuple[LookAlike, ...]] = MappingProxyType({}),
    support: Support | None = None,
) -> Verdict:
    """Return the verdict on a search."""
    found, left = outcome.found, outcome.remainder
    final = found.final
    data, floor = found.evaluator.data, found.evaluator.floor
    seen = left.fit.errors
    on_held_out = (proof.after, proof.after_in_floors)
    description = left.note
    if left.significant:
        where = describe(data, left.views, seen, floor, on_held_out)
        description = f'{where} {left.note}'.rstrip()
    untried = tuple(found.evaluator.deadline.untried)
    kind = rules.verdict_name(len(found.steps), left.significant)
    if kind == 'none':
        short = f'{1e3 * found.evaluator.unseen_delay:.2g} ms'
        clock = f'A delay of up to {short} cannot be distinguished from a clock offset.'
        description = f'{description} {clock} {sentence(statements(limits))}'.strip()
    effects = named_effects(
        found.steps, base.joint, final, data.records, floor, outcome.certainty, alike
    )
    if isinstance(found.evaluator, HeldEvaluator):
        effects = with_fractions(effects, final, data.training[0].dt, found.evaluator.late)
    if support is not None:
        effects = tuple(each.at_most(1.0 - support.chance) for each in effects)
    verdict = Verdict(
        baseline=name,
        seed=seed,
        noise_floor_rms_m=floor,
        held_out=HeldOut(proof.before, proof.after, proof.before_in_floors, proof.after_in_floors),
        effects=effects,
        verdict=kind,
        unexplained=Unexplained(left.significant, description),
        where=tuple(
            {
                'record': p.record,
                'frequency_hz': p.frequency,
                'harmonic': p.harmonic,
                'rms_m': p.rms,
            }
            for p in places(data, data.training, base.joint.errors)[:_MOST_PLACES]
        ),
        next_experiments=recommendations(limits)
        or tuple(advise(coverage, found.steps, left.significant, alike)),
        records={
            'training': [v.name for v in data.training],
            'held_out': [v.name for v in data.held_out],
        },
        seconds=0.0,
        suspects=suspects(found.steps, found.last, untried) if kind == 'unknown' else (),
        check=tuple(coverage.sentences()),
        proof=tuple(_row(row, floor) for row in proof.rows),
        over_frequency=tuple(
            {**_row(row, floor), 'held_out': row.held_out}
            for row in over_frequency(data, base.joint, final, proof)
        ),
        baseline_gaps_rms_m=_gaps(base),
        free_run_stable=proof.stable,
        sampling_offset_s=final.sampling_offset,
        starts={v.name: _circumstances(v) for v in (*data.held_out, *data.training)},
        not_tried=untried,
        identified_from=tuple(own),
        held_baseline=isinstance(found.evaluator, HeldEvaluator),
        detection_limits=tuple(limits),
        repeats=None if support is None else support.to_dict(),
        two_way=_two_way(base.joint.model, data.records),
    )
    nothing_else = {view.name for view in (*data.training, *data.held_out)} <= set(own)
    if nothing_else:
        verdict = replace(verdict, next_experiments=instead(base.joint.model))
    elif verdict.held_baseline and kind == 'none' and not outcome.ends_in_noise:
        missing = instead(base.joint.model)[:-1]
        verdict = replace(verdict, next_experiments=(*missing, *verdict.next_experiments))
    more = [coverage.outside]
    if isinstance(found.evaluator, HeldEvaluator) and not nothing_else:
        more.append(_repeated(found.evaluator, support, named=bool(effects)))
    return replace(verdict, summary=' '.join(filter(None, [summary_of(verdict), *more])))


def _repeated(evaluator: HeldEvaluator, support: Support | None, *, named: bool) -> str:
    """Return what repeats say of the records, or what is missing for that."""
    if support is not None:
        return support.sentence(named)
    others = any(each.records > 1 for each in evaluator.known.kinds)
    return OTHER_REPEATS if others else ONE_RECORD


def _two_way(baseline: Model, records: Sequence[Record]) -> tuple[TwoWayLag, ...]:
    """Return by how much the ways of each record differ, for a baseline without a memory."""
    if any(block.has_memory for block in baseline.blocks):
        return ()
    return tuple(lag for lag in map(two_way_lag, records) if lag is not None)


def _circumstances(view: Target) -> dict[str, Any]:
    """Return the nuisance parameters and the noise of one record."""
    return {
        'start': str(view.begins),
        'own_zero': view.own_zero,
        'noise_rms_m': view.noise,
        'lost_samples': view.lost,
    }


def _row(row: ProofRow, floor: float) -> dict[str, Any]:
    return {
        'record': row.record,
        'frequency_hz': row.frequency,
        'amplitude_v': row.amplitude,
        'before_in_floors': row.before / floor,
        'after_in_floors': row.after / floor,
    }


def _gaps(base: Baselines) -> dict[str, float]:
    gaps = {'joint_fit': base.joint.rms}
    if base.slow is not None:
        gaps['low_frequency_fit'] = base.slow.rms
    if base.nominal is not None:
        gaps['nominal'] = base.nominal.rms
    return gaps
