"""Detection limits in words, and the experiments that would lower them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import inf, isfinite, pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.discovery.data.dataset import HELD_OUT, part_of
from piezo_hysteresis.discovery.detection.limits import (
    BetterExperiment,
    DetectionCalculator,
    DetectionLimit,
    Signature,
    shape_of,
    size_of,
)
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, errors_of
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.experiments.planned_experiment import (
    ExperimentLimits,
    InvestigationError,
    PlannedExperiment,
    catalogue,
)
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.record_start import STEP
from piezo_hysteresis.models.effects import is_never_reached

# Prefixes of SI units, and the power of ten of each.
_PREFIXES = (('n', -9), ('µ', -6), ('m', -3), ('', 0), ('k', 3), ('M', 6))
# Units without SI prefixes.
_BARE = ('1', '1/s', '1/V')
# Value from which a threshold counts as infinite.
_INFINITE = 1e5
# Number of experiments that are recommended; the table of the report has all.
_RECOMMENDED = 2
# Relative difference below which two sizes count as equal.
_ALIKE = 0.15


@dataclass(frozen=True)
class Statement:
    """Detection limit of one effect in words."""

    effect: str  # name of the effect
    brief: str  # range of the smallest detectable sizes
    sizes: str  # these sizes with the shape parameters for which they are valid
    displacement_m: tuple[float, float]  # [m]
    apart: str  # most similar effect and the size from which on it can be distinguished
    hidden: str  # shapes that the records do not show at any size; empty if there are none
    better: str  # experiment that lowers the largest limit most, with the size that it shows


def statements(limits: Sequence[DetectionLimit]) -> tuple[Statement, ...]:
    """Return one statement per effect, for its first variant."""
    found: dict[str, list[DetectionLimit]] = {}
    for each in limits:
        found.setdefault(each.effect, []).append(each)
    return tuple(_statement(name, group) for name, group in found.items())


def _statement(name: str, group: Sequence[DetectionLimit]) -> Statement:
    first = [each for each in group if each.variant == group[0].variant]
    shown = _distinct([each for each in first if each.shown])
    hidden = {_shape(each): None for each in first if not each.shown}
    rms = [each.displacement_rms_m for each in shown] or [float('nan')]
    alike = [each for each in shown if each.apart_factor > 1.0]
    worst = max(alike, key=lambda each: each.apart_factor, default=None)
    return Statement(
        name,
        _brief(shown),
        '; '.join(map(_size, shown)) or 'no size',
        (min(rms), max(rms)),
        '' if worst is None else f'{worst.nearest} below {worst.apart_factor:.2g} times that',
        ', '.join(filter(None, hidden)) or ('any' if hidden and not shown else ''),
        next(
            (
                f'{better.name}: {_size(replace(each, size=better.size))}'
                for each in first
                if (better := each.better) is not None
            ),
            '',
        ),
    )


def recommendations(limits: Sequence[DetectionLimit]) -> tuple[str, ...]:
    """Return a sentence for each of the experiments that lower most limits."""
    lowered: dict[str, dict[str, str]] = {}
    for each in limits:
        if each.better is None:
            continue
        before = _brief([each]) if each.shown else 'no size'
        after = _brief([replace(each, size=each.better.size)])
        lowered.setdefault(each.better.name, {})[each.effect] = (
            f'{each.effect} from {before} to {after}'
        )
    ordered = sorted(lowered.items(), key=lambda each: -len(each[1]))
    return tuple(
        f'To show smaller effects: {name} ({", ".join(texts.values())}).'
        for name, texts in ordered[:_RECOMMENDED]
    )


def _distinct(limits: Sequence[DetectionLimit]) -> list[DetectionLimit]:
    """Return the limits sorted by size, without those that differ only in sign."""
    found: list[DetectionLimit] = []
    for each in sorted(limits, key=lambda each: _numbers(each)[0][1] if _numbers(each) else 0.0):
        one = _numbers(each)
        if not any(each.shape == other.shape and _alike(one, _numbers(other)) for other in found):
            found.append(each)
    return found


def _alike(one: list[tuple[str, float]], other: list[tuple[str, float]]) -> bool:
    return [k for k, _ in one] == [k for k, _ in other] and all(
        abs(a - b) <= _ALIKE * max(a, b) for (_, a), (_, b) in zip(one, other, strict=True)
    )


def _numbers(limit: DetectionLimit) -> list[tuple[str, float]]:
    """Return the distance of each size from its neutral value.

    Thresholds are returned unchanged.
    """
    found = []
    for name, value in limit.size.items():
        neutral = limit.neutral[name]
        size = abs(value) if is_never_reached(neutral) else abs(value - neutral)
        if 0.0 < size < _INFINITE:
            found.append((name, size))
    return found


def _brief(limits: Sequence[DetectionLimit]) -> str:
    """Return the range of sizes of sorted limits."""
    ends = [_numbers(each)[0] for each in (*limits[:1], *limits[-1:]) if _numbers(each)]
    if not ends:
        return 'no size'
    texts = [_value(size, limits[0].units[name]) for name, size in ends if name == ends[0][0]]
    return ' to '.join(dict.fromkeys(texts))


def _size(limit: DetectionLimit) -> str:
    numbers = _numbers(limit)
    if len(numbers) > 1 and len({size for _, size in numbers}) == 1:
        name, size = numbers[0]
        text = f'{name} and the like {_value(size, limit.units[name])}'
    else:
        text = ', '.join(f'{name} {_value(size, limit.units[name])}' for name, size in numbers)
    shape = _shape(limit)
    return f'{text} ({shape})' if shape else text


def _value(size: float, unit: str) -> str:
    return f'{100.0 * size:.2g} %' if unit == '1' else in_prefixes(size, unit)


def _shape(limit: DetectionLimit) -> str:
    return ', '.join(f'{k} {in_prefixes(v, limit.units[k])}' for k, v in limit.shape.items())


def in_prefixes(value: float, unit: str) -> str:
    """Return a number with an SI prefix and up to three digits: ``0.19 ms``, ``17 nm/s``."""
    if unit in _BARE or unit.startswith('1/') or value == 0.0 or not isfinite(value):
        return f'{value:.2g}' + ('' if unit == '1' else f' {unit}')
    prefix, power = next(
        (pair for pair in reversed(_PREFIXES) if abs(value) >= 10.0 ** pair[1]), _PREFIXES[0]
    )
    return f'{value / 10.0**power:.3g} {prefix}{unit}'


def sentence(found: Sequence[Statement]) -> str:
    """Return the range of all limits in the response as a sentence, empty without a limit."""
    seen = sorted(
        (each for each in found if isfinite(each.displacement_m[1])),
        key=lambda each: each.displacement_m[1],
    )
    if not seen:
        return ''
    low, high = seen[0].displacement_m[1], seen[-1].displacement_m[1]
    hidden = [each.effect for each in found if not isfinite(each.displacement_m[1])]
    more = f' They would not show {", ".join(hidden)} at any size.' if hidden else ''
    return (
        f'These records would have shown {counted(len(seen), "known effect")}: from '
        f'{in_prefixes(low, "m")} rms of the response ({seen[0].effect}) to '
        f'{in_prefixes(high, "m")} '
        f'({seen[-1].effect}).{more}'
    )


# Ticks of rest before a record.
_EDGE = 4


def view_of(experiment: PlannedExperiment, rate: float, noise: float) -> FitData:
    """Return an experiment as a view for the fit functions, with zero measured displacement."""
    prelude = round(experiment.prelude * rate)
    voltage, frequency = experiment.voltage(rate), experiment.frequency
    return at_rest_before(experiment.name, voltage, 1.0 / rate, frequency, noise, prelude)


def at_rest_before(
    name: str, driven: FloatArray, dt: float, frequency: float, noise: float, prelude: int = 0
) -> FitData:
    """Return a drive as a view that begins at rest, with zero measured displacement."""
    voltage = np.concatenate([np.full(_EDGE, driven[0]), driven])
    first = _EDGE + prelude
    return FitData(
        name=name,
        voltage=voltage,
        measured=np.zeros(voltage.size - first),
        first=first,
        stride=1,
        dt=dt,
        frequency=frequency,
        repeats=1,
        noise=noise,
        period=0,
        start=-_EDGE * dt,
        origin=_EDGE,
        begins=STEP,
    )


# Number of samples to which the given records are shortened.
_SAMPLES = 8_000
# Longest experiment [ticks]; slow effects need longer ones.
_LONGEST, _SLOW = 32_000, {'step': 320_000, 'rest': 320_000}
# Number of sines of the catalogue, spread over its frequencies.
_SINES = 3
# Highest drive frequency, relative to that of a sine with amplitude and slew rate of the records.
_FASTER = 4.0
# Largest predicted stroke, relative to that of the records.
_STROKE = 1.2
# Largest limit with the experiment, relative to that without it, which counts as lower.
_LOWER = 0.5


def with_better_experiments(
    evaluator: Evaluator,
    final: CandidateFit,
    start: CandidateFit,
    limits: Sequence[DetectionLimit],
) -> tuple[DetectionLimit, ...]:
    """Return the limits, the highest of each effect with the experiment that lowers it most."""
    present = _highest(DetectionCalculator(evaluator, final, start, samples=_SAMPLES))
    best: dict[str, tuple[float, BetterExperiment]] = {}
    for experiment in _possible(evaluator.data.training) if present else ():
        if evaluator.deadline.skips(f'limits with {experiment.name}'):
            break
        view = _predicted(evaluator, final, experiment)
        if view is None:
            continue
        more = DetectionCalculator(evaluator, final, start, samples=_SAMPLES, planned=(view,))
        for effect, factor, size in _lowered(more, present):
            if effect not in best or factor < best[effect][0]:
                best[effect] = factor, BetterExperiment(experiment.name, experiment.seconds, size)
    highest = {each.candidate.effect.name: each for each in present}
    return tuple(
        replace(each, better=best[each.effect][1])
        if each.effect in best and _is_of(each, highest[each.effect])
        else each
        for each in limits
    )


def _lowered(
    records: DetectionCalculator, present: Sequence[Signature]
) -> Iterator[tuple[str, float, dict[str, float]]]:
    """Yield effect, factor and size of each limit that is much lower in other records."""
    again = records.at_limits([(each.candidate, each.start, each.scale) for each in present])
    for before, after in zip(present, again, strict=True):
        if after is None or not after.shown:
            continue
        factor = after.scale / before.scale if before.shown else 0.0
        if factor < _LOWER:
            yield before.candidate.effect.name, factor, size_of(after)


def _is_of(limit: DetectionLimit, found: Signature) -> bool:
    """Return whether a limit has variant, shape and changed parameters of a signature."""
    if (limit.variant, limit.shape) != (found.candidate.effect.variant, shape_of(found)):
        return False
    size, neutral = size_of(found), limit.neutral
    return all((limit.size[k] != neutral[k]) == (size[k] != neutral[k]) for k in neutral)


def _highest(records: DetectionCalculator) -> list[Signature]:
    """Return, per effect, the shape of its first variant with the largest detection limit."""
    every = records.candidates()
    firsts = [next(group) for _, group in groupby(every, key=lambda each: each.effect.name)]
    pairs = [(each, start, 1.0) for each in firsts for start in each.starts]
    found = [each for each in records.at_limits(pairs) if each is not None]
    worst: dict[str, Signature] = {}
    for each in found:
        name = each.candidate.effect.name
        if name not in worst or _size_of(each) > _size_of(worst[name]):
            worst[name] = each
    return list(worst.values())


def _size_of(found: Signature) -> float:
    """Return the size of an effect: the largest distance from its neutral values."""
    if not found.shown:
        return inf
    neutral = found.candidate.neutral
    distances = (
        1.0 / abs(value) if is_never_reached(neutral[name]) else abs(value - neutral[name])
        for name, value in size_of(found).items()
    )
    return max(distances, default=0.0)


def _possible(views: Sequence[FitData]) -> list[PlannedExperiment]:
    """Return the experiments within voltage range and slew rate of the records."""
    rate = 1.0 / views[0].dt
    low = min(0.0, *(float(v.voltage.min()) for v in views))
    high = max(0.0, *(float(v.voltage.max()) for v in views))
    slew = max(float(np.max(np.abs(np.diff(v.voltage)))) for v in views) * rate
    if not (low < high and slew > 0.0):
        return []
    frequency = _FASTER * slew / (pi * (high - low))
    try:
        every = catalogue(ExperimentLimits(low, high, slew, frequency), rate)
    except InvestigationError:
        return []
    groups: dict[str, list[PlannedExperiment]] = {}
    for each in every:
        group = each.name.split()[0]
        if each.seconds * rate <= _SLOW.get(group, _LONGEST):
            groups.setdefault(group, []).append(each)
    sines = [each for each in groups.pop('sine', ()) if each.amplitude > 0.3 * (high - low)]
    spread = sorted({round(k) for k in np.linspace(0, len(sines) - 1, _SINES)}) if sines else []
    longest = [max(group, key=lambda each: each.seconds) for group in groups.values()]
    chosen = [*(sines[k] for k in spread), *longest]
    return sorted(chosen, key=lambda each: each.seconds)


def _predicted(
    evaluator: Evaluator, final: CandidateFit, experiment: PlannedExperiment
) -> FitData | None:
    """Return an experiment with its predicted displacement and noise, None beyond the stroke."""
    views = evaluator.data.training
    noise = float(np.median([v.noise for v in views]))
    view = view_of(experiment, 1.0 / views[0].dt, noise)
    predicted = -errors_of(final, (view,))[0]
    stroke = max(float(np.ptp(v.measured)) for v in views)
    if not np.ptp(predicted) <= _STROKE * stroke:  # also after divergence
        return None
    rng = np.random.default_rng(evaluator.seed)
    view = replace(view, measured=predicted + noise * rng.standard_normal(predicted.size))
    return part_of(view, 0, round((1.0 - HELD_OUT) * predicted.size))
