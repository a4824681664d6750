"""The verdict of a discovery, and the description of a residual that no effect explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.discovery.data.dataset import Check, Dataset
from piezo_hysteresis.discovery.detection.bends import Similar
from piezo_hysteresis.discovery.detection.limits import DetectionLimit
from piezo_hysteresis.discovery.detection.statements import recommendations, sentence, statements
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.baseline import Baselines
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import FixedBaselineEvaluator
from piezo_hysteresis.discovery.selection.search import Outcome
from piezo_hysteresis.discovery.verdict.naming import (
    named_effects,
    summary_of,
    suspects,
    with_fractions,
)
from piezo_hysteresis.discovery.verdict.verdict import (
    HeldOut,
    HeldOutComparison,
    ProofRow,
    Unexplained,
    Verdict,
    over_frequency,
)
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.periods import TwoWayLag, two_way_lag
from piezo_hysteresis.models import Model, described, name_of
from piezo_hysteresis.models.repeated_records import Support
from piezo_hysteresis.numerics.harmonics import harmonics, non_harmonic_lines
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.records import Record

if TYPE_CHECKING:
    from piezo_hysteresis.discovery.selection.elimination import Step


@dataclass(frozen=True)
class Place:
    """Rms residual of one harmonic in one record."""

    record: str  # name of the record
    frequency: float  # drive frequency [Hz]; 0 without a periodic drive
    harmonic: int  # harmonic order; 0 is the mean, -1 the remaining residual
    rms: float  # rms residual of this harmonic [m]


def places(data: Dataset, views: Sequence[FitData], errors: Sequence[FloatArray]) -> list[Place]:
    """Return the rms residual by record and harmonic, largest first."""
    found = []
    for view, error in zip(views, errors, strict=True):
        found += _of_view(view, error, data.periods[view.name])
    return sorted(found, key=lambda place: -place.rms)


def _of_view(view: FitData, error: FloatArray, period: int) -> list[Place]:
    frequency = view.frequency or (1.0 / (period * view.dt) if period else 0.0)
    if frequency <= 0.0 or error.size * view.dt * frequency < 1.0:
        level = float(error.mean())
        rest = float(np.std(error))
        return [
            Place(view.name, view.frequency, 0, abs(level)),
            Place(view.name, view.frequency, -1, rest),
        ]
    orders, phasors, left = harmonics(error, frequency, view.dt)
    sizes = np.abs(phasors) / np.sqrt(2.0)
    sizes[0] *= np.sqrt(2.0)
    rows = [
        Place(view.name, view.frequency, order, float(size))
        for order, size in zip(orders, sizes, strict=True)
    ]
    return [*rows, Place(view.name, view.frequency, -1, left)]


# Ratio to the median of the spectrum from which a line is reported: twice that of `tones`, which
# also requires several records to agree.
LINE = 60.0

# Exponent of a power law below which the dependence is negligible.
_LEVEL = 0.15
# Standard deviation of the log residual about a power law above which it is rejected. Chosen.
_SCATTER = 0.2


def describe(
    data: Dataset,  # [m]
    views: Sequence[FitData],  # [m]
    errors: Sequence[FloatArray],  # [m]
    floor: float,  # [m]
    held_out: tuple[float, float],  # [m]
) -> str:
    """Return sentences on size, location, law and time scale of the residual."""
    sizes = np.array([float(np.sqrt(np.mean(e**2))) for e in errors])
    size, floors = held_out
    sentences = [f'The held-out residual is {size * 1e6:.3g} µm rms, {floors:.3g} noise floors.']
    worst = int(np.argmax(sizes))
    which = 'held-out' if any(views[0] is view for view in data.held_out) else 'fitted'
    if len(sizes) > 1:
        sentences.append(
            f'On {which} records it is largest in {views[worst].name} '
            f'({sizes[worst] * 1e6:.3g} µm) and smallest in '
            f'{views[int(np.argmin(sizes))].name} ({sizes.min() * 1e6:.3g} µm).'
        )
    sentences += _harmonics(data, views, errors, floor)
    sentences += _lines(data, views, errors)
    sentences += law_sentences(views, sizes, floor)
    sentences += _bursts(views, errors, floor)
    sentences += _trend(views, errors, floor)
    return ' '.join(sentences)


def _harmonics(
    data: Dataset, views: Sequence[FitData], errors: Sequence[FloatArray], floor: float
) -> list[str]:
    power: dict[int, float] = {}
    for place in places(data, views, errors):
        power[place.harmonic] = power.get(place.harmonic, 0.0) + place.rms**2
    whole = sum(power.values())
    if whole <= 0.0:
        return []
    sentences = []
    odd = sum(v for k, v in power.items() if k > 0 and k % 2 == 1) / whole
    even = sum(v for k, v in power.items() if k > 0 and k % 2 == 0) / whole
    aside = power.get(-1, 0.0) / whole
    strongest = sorted((k for k in power if k > 0), key=lambda k: -power[k])[:3]
    if odd + even > 0.3:
        kind = 'odd' if odd > 3 * even else 'even' if even > 3 * odd else 'odd and even'
        sentences.append(
            f'{100 * (odd + even):.0f} % of its power is on {kind} harmonics of the drive, mainly '
            f'orders {", ".join(map(str, strongest))}.'
        )
    if aside > 0.3:
        sentences.append(f'{100 * aside:.0f} % of its power is on no harmonic of the drive.')
    if power.get(0, 0.0) / whole > 0.3:
        sentences.append(f'{100 * power[0] / whole:.0f} % of its power is a shift of the mean.')
    return sentences


def _lines(data: Dataset, views: Sequence[FitData], errors: Sequence[FloatArray]) -> list[str]:
    found: list[float] = []
    for view, error in zip(views, errors, strict=True):
        if error.size < 1000:
            continue
        frequency, lines = non_harmonic_lines(error, view.dt, view.frequency)
        power = lines**2
        top = int(np.argmax(power))
        others = power[power > 0]
        if others.size and power[top] > LINE * float(np.median(others)):
            found.append(float(frequency[top]))
    if len(found) < max(2, len(views) // 4):
        return []
    middle = float(np.median(found))
    if np.median(np.abs(np.array(found) - middle)) < 0.02 * middle:
        many = counted(len(found), 'record', 'contains')
        return [f'{many} a tone near {middle:.4g} Hz that is not a harmonic.']
    return ['The records contain tones that are not harmonics, at different frequencies.']


def law_sentences(views: Sequence[FitData], sizes: FloatArray, floor: float) -> list[str]:
    """Return sentences on how sizes by view [m] grow with the drive, above a floor [m]."""
    rows = [
        (v.frequency, float(np.max(np.abs(v.voltage))), float(s))
        for v, s in zip(views, sizes, strict=True)
        if v.frequency > 0 and s > 1.05 * floor
    ]
    if len(rows) < 3:
        return []
    clean = [(f, a, max(s**2 - floor**2, 1e-30) ** 0.5) for f, a, s in rows]
    table = np.array(clean)
    columns = [np.ones(len(table))]
    names = []
    for place, name in ((0, 'frequency'), (1, 'amplitude')):
        if np.ptp(np.log(table[:, place])) > 0.3:
            columns.append(np.log(table[:, place]))
            names.append(name)
    if not names:
        return []
    solved = solve_least_squares(np.column_stack(columns), np.log(table[:, 2]))
    if not solved.sound:
        return []
    logs = np.log(table[:, 2])
    scatter = float(np.std(logs - np.column_stack(columns) @ solved.values))
    if scatter > _SCATTER:
        return []
    pairs = zip(names, solved.values[1:], strict=True)
    return [growth(name, float(power)) for name, power in pairs]


def growth(name: str, power: float) -> str:
    """Return a sentence on the change of the residual with the frequency or the amplitude."""
    if abs(power) < _LEVEL:
        return f'It hardly depends on the {name}.'
    if power > 0:
        return f'It increases with the {name}, about with power {power:.1f}.'
    return f'It decreases with the {name}, about with power {power:.1f}.'


def _bursts(views: Sequence[FitData], errors: Sequence[FloatArray], floor: float) -> list[str]:
    joined = np.concatenate([e**2 for e in errors])
    top = np.sort(joined)[-max(1, joined.size // 100) :]
    share = float(top.sum() / joined.sum())
    if share > 0.5:
        share_text = f'{100 * share:.0f} % of its power is in 1 % of the samples'
        return [f'{share_text}: bursts, jumps or drop-outs rather than a smooth effect.']
    return []


def _trend(views: Sequence[FitData], errors: Sequence[FloatArray], floor: float) -> list[str]:
    changes = []
    for view, error in zip(views, errors, strict=True):
        count = error.size // 4
        if count * view.dt < 0.25:
            continue
        changes.append(float(error[-count:].mean() - error[:count].mean()))
    if changes and np.mean(np.abs(changes)) > 0.5 * floor:
        change = np.mean(np.abs(changes)) * 1e6
        return [f'Within a record its mean changes by {change:.3g} µm on average.']
    return []


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
    alike: Mapping[str, Similar] = MappingProxyType({}),
    unit: str = 'V',
) -> list[str]:
    """Return the recommended experiments, most informative first."""
    separated: dict[str, dict[str, None]] = {}  # effects by the experiment that separates them
    by_amplitude: list[str] = []
    for step in steps:
        near = alike.get(step.fit.effect, Similar())
        if near.ladder is not None:
            by_amplitude += near.ladder.sentences(step.fit.effect, unit)
            continue
        chances = step.round.probabilities()
        alternatives = [
            name for name, chance in chances.items() if chance > ALTERNATIVE_PROBABILITY
        ]
        similar = (each.name for each in near.names)
        alternatives = list(dict.fromkeys((*alternatives, *similar)))
        if len(alternatives) < 2:
            continue
        for name in alternatives:
            experiment = described(name)[0].experiment
            separated.setdefault(experiment, {}).update(dict.fromkeys(alternatives))
    sentences = by_amplitude + [
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
    proof: HeldOutComparison,
    name: str,
    seed: int,
    own: Sequence[str] = (),
    limits: Sequence[DetectionLimit] = (),
    alike: Mapping[str, Similar] = MappingProxyType({}),
    support: Support | None = None,
) -> Verdict:
    """Return the verdict on a search."""
    found, left = outcome.found, outcome.remainder
    final = found.final
    data, floor = found.evaluator.data, found.evaluator.floor
    seen, unit = left.fit.errors, data.records[0].info.input_unit
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
    if isinstance(found.evaluator, FixedBaselineEvaluator):
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
        or tuple(advise(coverage, found.steps, left.significant, alike, unit)),
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
        held_baseline=isinstance(found.evaluator, FixedBaselineEvaluator),
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
    if isinstance(found.evaluator, FixedBaselineEvaluator) and not nothing_else:
        more.append(_repeated(found.evaluator, support, named=bool(effects)))
    return replace(verdict, summary=' '.join(filter(None, [summary_of(verdict), *more])))


def _repeated(evaluator: FixedBaselineEvaluator, support: Support | None, *, named: bool) -> str:
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


def _circumstances(view: FitData) -> dict[str, Any]:
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
