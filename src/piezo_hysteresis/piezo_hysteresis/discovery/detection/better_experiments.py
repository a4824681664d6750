"""The experiment that lowers each detection limit most, if it is recorded in addition.

Every experiment of the catalogue within voltage range and slew rate of the records is simulated
with the final model and white noise. The limits of the given records and this one together are
calculated as those of the given records. The result is a prediction: the model may be wrong under
the conditions of the experiment.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from math import inf, pi

import numpy as np

from piezo_hysteresis.discovery.data.dataset import HELD_OUT, part_of
from piezo_hysteresis.discovery.detection.limits import (
    BetterExperiment,
    DetectionLimit,
    Records,
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
from piezo_hysteresis.identification.initial_conditions.record_start import STEP
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models.effects import is_never_reached

# Ticks of rest before a record.
_EDGE = 4


def view_of(experiment: PlannedExperiment, rate: float, noise: float) -> Target:
    """Return an experiment as a view for the fit functions, with zero measured displacement."""
    driven = experiment.voltage(rate)
    voltage = np.concatenate([np.full(_EDGE, driven[0]), driven])
    first = _EDGE + round(experiment.prelude * rate)
    return Target(
        name=experiment.name,
        voltage=voltage,
        measured=np.zeros(voltage.size - first),
        first=first,
        stride=1,
        dt=1.0 / rate,
        frequency=experiment.frequency,
        repeats=1,
        noise=noise,
        period=0,
        start=-_EDGE / rate,
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
    present = _highest(Records(evaluator, final, start, samples=_SAMPLES))
    best: dict[str, tuple[float, BetterExperiment]] = {}
    for experiment in _possible(evaluator.data.training) if present else ():
        if evaluator.deadline.skips(f'limits with {experiment.name}'):
            break
        view = _predicted(evaluator, final, experiment)
        if view is None:
            continue
        more = Records(evaluator, final, start, samples=_SAMPLES, planned=(view,))
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
    records: Records, present: Sequence[Signature]
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


def _highest(records: Records) -> list[Signature]:
    """Return, per effect, the shape of its first variant with the largest detection limit."""
    every = records.candidates()
    firsts = [next(group) for _, group in groupby(every, key=lambda each: each.effect.name)]
    pairs = [(each, start, 1.0) for each in firsts for start in each.starts]
    found = [each for each in records.at_limits(pairs) if each is not None]
    worst: dict[str, Signature] = {}
    for each in found:
        name = each.candidate.effect.name
        if name not in worst or _size(each) > _size(worst[name]):
            worst[name] = each
    return list(worst.values())


def _size(found: Signature) -> float:
    """Return the size of an effect: the largest distance from its neutral values."""
    if not found.shown:
        return inf
    neutral = found.candidate.neutral
    distances = (
        1.0 / abs(value) if is_never_reached(neutral[name]) else abs(value - neutral[name])
        for name, value in size_of(found).items()
    )
    return max(distances, default=0.0)


def _possible(views: Sequence[Target]) -> list[PlannedExperiment]:
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
) -> Target | None:
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
