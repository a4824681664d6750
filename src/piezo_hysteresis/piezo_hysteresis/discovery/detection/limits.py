"""Detection limit of each effect, and the size from which on its name is unique.

An effect of size s changes the response by x(s). A fit of the baseline absorbs a part of it, by
the fitted parameters, the sampling offset and the zero offset of each record. The remaining change
p(s) is compared with the residual r of the final model in two ways:

    d(s) = |p(s)| in standard deviations of the random residual, from the spectrum of r;
    r and p(s) together pass the test that starts every search.

The detection limit is the smallest size that passes this test with d >= 4.9: the probability that
a random residual hides such an effect is 5 %, that it resembles the effect 1 in 2000. Two effects
k and l can be distinguished from the size at which d_kl, the distance between x_k and the nearest
multiple of x_l, reaches 7. Below that size their names form one class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import thinned
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    errors_of,
    evaluated_on,
    nudged,
)
from piezo_hysteresis.discovery.selection.elimination import Step
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.free_run import StageCache
from piezo_hysteresis.models import Candidate
from piezo_hysteresis.models.effects import is_never_reached
from piezo_hysteresis.numerics.qr import inner, orthonormal, projected_out

# Bins of the periodogram over which the spectrum of a residual is averaged.
_SMOOTHED = 15
# Relative norm of a projected direction below which it is linearly dependent on the others.
_DEPENDENT = 1e-7


class Whitening:
    """Divides each view by the spectrum of its residual, so that the residual has unit variance.

    The noise spectrum is a lower bound, because a fit may have removed random components from a
    line.
    """

    def __init__(
        self, errors: Sequence[FloatArray], noises: Sequence[float], weights: Sequence[float]
    ) -> None:  # errors [m] (n_i,); noises [m]
        self.sizes = [error.size for error in errors]
        self._roots = [
            np.sqrt(np.maximum(_smooth(np.abs(np.fft.rfft(e)) ** 2 / e.size), noise**2) / weight)
            for e, noise, weight in zip(errors, noises, weights, strict=True)
        ]

    def __call__(self, changes: Sequence[FloatArray]) -> FloatArray:
        """Return the concatenated changes of all views [m], in standard deviations."""
        pairs = zip(changes, self._roots, strict=True)
        return np.concatenate([np.fft.irfft(np.fft.rfft(c) / root, c.size) for c, root in pairs])

    def inverse(self, whitened: FloatArray) -> list[FloatArray]:
        """Return the changes of each view [m] from whitened ones."""
        parts = np.split(whitened, np.cumsum(self.sizes)[:-1])
        pairs = zip(parts, self._roots, strict=True)
        return [np.fft.irfft(np.fft.rfft(part) * root, part.size) for part, root in pairs]


def _smooth(power: FloatArray) -> FloatArray:
    """Return the running mean of a periodogram, shape (bins,)."""
    width = min(_SMOOTHED, power.size)
    counts = np.convolve(np.ones(power.size), np.ones(width), 'same')
    return np.asarray(np.convolve(power, np.ones(width), 'same') / counts)


class NuisanceDirections:
    """Whitened response directions of the parameters that a fit adjusts."""

    def __init__(
        self,
        free: Sequence[FloatArray],  # (n,)
        bounded: FloatArray,  # (n,)
        bounds: tuple[float, float],  # [s]
        uncertain: Sequence[FloatArray] = (),  # (n,)
    ) -> None:
        # a prior counts as one more measurement per uncertain parameter
        self._priors = len(uncertain)
        rows = np.zeros((len(free) + self._priors, bounded.size + self._priors))
        for row, direction in zip(rows, (*free, *uncertain), strict=True):
            row[: bounded.size] = direction
        rows[len(free) :, bounded.size :] = np.eye(self._priors)
        basis = orthonormal(rows, _DEPENDENT)
        self._basis = basis[np.any(basis != 0.0, axis=1)]
        self._bounded = projected_out(self._with_priors(bounded), self._basis)[1]
        self._square = inner(self._bounded, self._bounded)
        self._bounds = bounds

    def remove(self, change: FloatArray) -> FloatArray:
        """Return the part of a change that no nuisance parameter explains.

        Shape (n + u,): the changes of the u uncertain parameters follow, in standard deviations.
        """
        left = projected_out(self._with_priors(change), self._basis)[1]
        if self._square > 0.0:
            share = inner(self._bounded, left) / self._square
            left = left - float(np.clip(share, *self._bounds)) * self._bounded
        return left

    def _with_priors(self, change: FloatArray) -> FloatArray:
        return np.concatenate([change, np.zeros(self._priors)])


# Distance at which an effect is detected with a power of 95 %: 3.29 + 1.64 standard deviations.
DETECTED = 4.93
# Distance from every other effect that makes a name unique: calibrated on hidden effects, because
# the theoretical value (3.3) is too low.
APART = 7.0
# Largest number of simulations of one effect.
_SIMULATIONS = 12
# Relative tolerance of the limit, and of two sizes that enclose a threshold.
_NEAR, _CLOSE = 1.15, 1.05
# Smallest factor between a new size and the ends of its interval.
_APART_FROM_ENDS = 1.02
# Search interval of a limit, relative to the starting value of the effect.
_SMALLEST, _LARGEST = 1e-7, 1e4
# Finite-difference step of the sampling offset, relative to a tick.
_TICK = 0.05
# Smallest change of a response relative to its range that double precision resolves in a free run.
_RESOLVED = 1e-10


@dataclass(frozen=True)
class BetterExperiment:
    """Experiment that lowers a detection limit, if it is recorded in addition."""

    name: str  # name of the experiment in the catalogue
    seconds: float  # its duration [s]
    size: dict[str, float]  # values at the limit with it of the parameters that define the size


@dataclass(frozen=True)
class DetectionLimit:
    """Smallest size of one effect that the records would have shown.

    Attributes
    ----------
    effect, variant : str
        Name of the effect and of its variant.
    size : dict of str to float
        Values at the limit of the parameters that define the size, SI units.
    neutral : dict of str to float
        Values of the same parameters for which the effect is inactive.
    shape : dict of str to float
        Other parameters of the effect; the limit is valid for these values.
    units : dict of str to str
        Units of size and shape parameters.
    displacement_rms_m : float
        Rms change of the response at the limit, before a fit absorbs a part of it [m].
    shown : bool
        Whether the effect is detectable at any size within the bounds of its parameters.
    apart_factor : float
        Size, in units of the limit, from which on the effect can be distinguished from every
        other.
    nearest : str
        Most similar effect; empty if there is no other.
    experiment : str
        Experiment that shows a smaller size.
    better : BetterExperiment, optional
        Of the experiments that were calculated, the one with the smallest limit.
    """

    effect: str
    variant: str
    size: dict[str, float]
    neutral: dict[str, float]
    shape: dict[str, float]
    units: dict[str, str]
    displacement_rms_m: float
    shown: bool
    apart_factor: float
    nearest: str
    experiment: str
    better: BetterExperiment | None = None


@dataclass(frozen=True)
class Signature:
    """Change of the response by an effect of a given size."""

    candidate: Candidate
    start: Mapping[str, float]
    values: Mapping[str, float]
    scale: float
    rms: float
    whitened: FloatArray
    shown: bool


def detection_limits(
    evaluator: Evaluator, final: CandidateFit, start: CandidateFit
) -> tuple[DetectionLimit, ...]:
    """Return the detection limit of every effect that `final` lacks, per variant and shape."""
    return DetectionCalculator(evaluator, final, start).limits()


class DetectionCalculator:
    """Detectability of effects in the thinned training records."""

    def __init__(
        self,
        evaluator: Evaluator,
        final: CandidateFit,
        start: CandidateFit,
        *,
        residual: CandidateFit | None = None,
        samples: int | None = None,
        planned: Sequence[FitData] = (),
    ) -> None:
        data = evaluator.data
        samples = samples or evaluator.policy.screening_samples
        short = thinned(data.training, samples, data.periods)
        longer = sum(v.measured.size for v in data.training) / sum(v.measured.size for v in short)
        views = (*short, *planned)
        if longer > 1.0 or planned:
            periods = {**{view.name: view.period for view in planned}, **data.periods}
            evaluator = evaluator.with_data(replace(data, training=views, periods=periods))
        self._evaluator, self._views = evaluator, views
        # a fixed baseline was evaluated on views that still contain its known discrepancy
        self._final = evaluated_on(final, views)
        chance = self._final if residual is None else evaluated_on(residual, views)
        weights = [longer] * len(short) + [1.0] * len(planned)
        self._whitening = Whitening(chance.errors, chance.noises, weights)
        self._cache = StageCache(final.model, final.model.pack(final.values), views)
        self._nuisances = self._directions()
        self._detection_test = evaluator.detection_test(self._final, start)

    def limits(self) -> tuple[DetectionLimit, ...]:
        """Return the limit of every effect, see `detection_limits`."""
        pairs = [(each, start) for each in self.candidates() for start in each.starts]
        found = self.at_limits([(*pair, 1.0) for pair in pairs])
        signatures = [each for each in found if each is not None]
        shown = [each for each in signatures if each.shown]
        return tuple(self._limit(each, shown) for each in signatures)

    def at_limits(
        self, sizes: Sequence[tuple[Candidate, Mapping[str, float], float]]
    ) -> list[Signature | None]:
        """Return effects at their detection limits, by threads; None after the deadline."""
        end = self._evaluator.deadline

        def found(size: tuple[Candidate, Mapping[str, float], float]) -> Signature | None:
            return None if end.skips('some detection limits') else self._at_limit(*size)

        return self._evaluator.map(found, sizes)

    def candidates(self) -> list[Candidate]:
        """Return the model extended by each effect that has a defined size."""
        every = self._evaluator.candidates(self._final)
        return [each for each in every if each.neutral and not each.effect.refits]

    def left(self, spec: ModelSpec) -> FloatArray | None:
        """Return the whitened change of another model beyond nuisances; None after divergence."""
        change = self._change(spec)
        return None if change is None else self._nuisances.remove(change)

    def signatures(
        self, pairs: Sequence[tuple[Candidate, Mapping[str, float]]]
    ) -> list[Signature | None]:
        """Return the signature of every candidate at its start, computed in threads."""
        return self._evaluator.map(lambda pair: self.signature(*pair), pairs)

    def signature(self, candidate: Candidate, start: Mapping[str, float]) -> Signature | None:
        """Return the change by an effect beyond nuisances; None after divergence."""
        for scale in (1.0, 0.1):
            found = self._signature(candidate, start, scale)
            if found is not None:
                return found
        return None

    # --- nuisance parameters ---------------------------------------------------------------

    def _directions(self) -> NuisanceDirections:
        """Return the directions of a fit: free parameters, and the bounded sampling offset."""
        final = self._final
        changes = self._evaluator.map(
            lambda name: self._change(replace(final, values=nudged(final, name))),
            self._evaluator.free_of(final),
        )
        free = [
            change / np.sqrt(inner(change, change))
            for change in changes
            if change is not None and np.any(change)
        ]
        dt = self._views[0].dt
        later = replace(final, sampling_offset=final.sampling_offset + _TICK * dt)
        clock = self._change(later)
        clock = np.zeros(sum(self._whitening.sizes)) if clock is None else clock / (_TICK * dt)
        low, high = self._evaluator.clock or (0.0, dt)
        late = final.sampling_offset
        return NuisanceDirections(free, clock, (min(low - late, 0.0), max(high - late, 0.0)))

    def _change(self, spec: ModelSpec) -> FloatArray | None:
        """Return the whitened change relative to the final model; None after divergence."""
        changes = self._changes(spec)
        return None if changes is None else self._whitening(changes)

    def _changes(self, spec: ModelSpec) -> list[FloatArray] | None:
        try:
            errors = errors_of(spec, self._views, self._cache)
        except PiezoError:
            return None
        if not all(np.all(np.isfinite(e)) for e in errors):
            return None
        return [old - new for old, new in zip(self._final.errors, errors, strict=True)]

    # --- detection limit of an effect --------------------------------------------------------

    def _at_limit(
        self, candidate: Candidate, start: Mapping[str, float], scale: float
    ) -> Signature | None:
        """Return an effect at its detection limit, or at its largest possible size."""
        hidden, best = 0.0, None
        last: Mapping[str, float] = {}
        for _ in range(_SIMULATIONS):
            found = self._signature(candidate, start, scale)
            if found is not None and found.values == last:  # limited by the parameter bounds
                break
            last = {} if found is None else found.values
            factor = np.inf if found is None else self.detectable_factor(found)
            if found is not None and factor <= 1.0:
                best = found
                if factor > 1.0 / _NEAR:
                    break
            elif found is None and best is None:  # a large starting value can cause divergence
                scale *= 0.1
                continue
            else:
                hidden = max(hidden, scale)
            if best is not None and hidden > best.scale / _CLOSE:
                break
            if best is None and factor == np.inf:
                if found is None or found.values == self._scaled(candidate, start, 10.0 * scale):
                    break
                scale *= 10.0
                continue
            scale = self._next(scale, factor, hidden, best)
            if best is not None and scale == best.scale:
                break
        if best is not None:
            return replace(best, shown=True)
        return self._signature(candidate, start, max(hidden, 1.0))

    @staticmethod
    def _next(scale: float, factor: float, hidden: float, best: Signature | None) -> float:
        """Return the next size to test: the limit of a linear effect, within known bounds."""
        aim = scale * factor * _NEAR**0.5 if factor < np.inf else 10.0 * scale
        if best is None:
            return aim if aim > hidden else 3.0 * hidden
        low, high = hidden * _APART_FROM_ENDS, best.scale / _APART_FROM_ENDS
        if not low < aim < high:
            aim = float(np.sqrt(hidden * best.scale)) if hidden > 0.0 else 0.1 * best.scale
        return aim

    def _scaled(
        self, candidate: Candidate, start: Mapping[str, float], scale: float
    ) -> dict[str, float]:
        return scaled(candidate, candidate.values(self._final.values, start), scale)

    def _signature(
        self, candidate: Candidate, start: Mapping[str, float], scale: float
    ) -> Signature | None:
        values = self._scaled(candidate, start, scale)
        spec = ModelSpec(
            candidate.model, dict(values), sampling_offset=self._final.sampling_offset
        )
        changes = self._changes(spec)
        if changes is None:
            return None
        rms = float(np.sqrt(np.mean(np.concatenate(changes) ** 2)))
        left = self._nuisances.remove(self._whitening(changes))
        return Signature(candidate, start, values, scale, rms, left, False)

    def detectable_factor(self, found: Signature) -> float:
        """Return the factor to the detection limit for an effect that is linear in its size."""
        away = np.sqrt(inner(found.whitened, found.whitened))
        low, high = DETECTED / away if away > 0.0 else np.inf, _LARGEST
        if low > high:
            return np.inf
        shows = self._detection_test(self._whitening.inverse(found.whitened))
        reach = max(float(np.ptp(view.measured)) for view in self._views)
        low = max(low, _SMALLEST, _RESOLVED * reach / found.rms)
        if shows(low):
            return float(low)
        if not shows(high):
            return np.inf
        for _ in range(30):
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if shows(middle) else (middle, high)
            if high < 1.02 * low:
                break
        return float(high)

    # --- similar effects ---------------------------------------------------------------------

    def _limit(self, found: Signature, others: Sequence[Signature]) -> DetectionLimit:
        candidate, effect = found.candidate, found.candidate.effect
        nearest, least = '', np.inf
        for other in others:
            if other.candidate.effect.name == effect.name:
                continue
            _, away = nearest_multiple(found.whitened, other.whitened, one_sided(other.candidate))
            if away < least:
                nearest, least = other.candidate.effect.name, away
        own = set(candidate.added)
        units = {q.name: q.unit for q in candidate.model.parameters if q.name in own}
        size, shape = size_of(found), shape_of(found)
        return DetectionLimit(
            effect.name,
            effect.variant,
            size,
            {k: candidate.neutral[k] for k in size},
            shape,
            units,
            found.rms,
            found.shown,
            float(max(APART / max(least, 1e-9), 1.0)),
            nearest,
            effect.experiment,
        )


def size_of(found: Signature) -> dict[str, float]:
    """Return the values of the parameters that define the size of an effect."""
    added = set(found.candidate.added)
    return {name: found.values[name] for name in found.candidate.neutral if name in added}


def shape_of(found: Signature) -> dict[str, float]:
    """Return the values of the other parameters of an effect."""
    size = size_of(found)
    return {name: found.values[name] for name in found.candidate.added if name not in size}


def nearest_multiple(x: FloatArray, other: FloatArray, positive: bool) -> tuple[float, float]:
    """Return the multiple of another change that is nearest to a change, and its distance."""
    square = inner(other, other)
    share = inner(x, other) / square if square > 0.0 else 0.0
    share = max(share, 0.0) if positive else share
    left = x - share * other
    return share, float(np.sqrt(inner(left, left)))


def one_sided(candidate: Candidate) -> bool:
    """Return whether the neutral values of an effect are at a bound each."""
    bounds = {q.name: (q.low, q.high) for q in candidate.model.parameters}
    return all(value in bounds[name] for name, value in candidate.neutral.items())


def scaled(candidate: Candidate, values: Mapping[str, float], scale: float) -> dict[str, float]:
    """Return the values of a candidate with its size scaled, within the parameter bounds.

    Thresholds whose neutral value is infinite are divided instead.
    """
    bounds = {q.name: (q.low, q.high) for q in candidate.model.parameters}
    found = dict(values)
    for name, neutral in candidate.neutral.items():
        if not is_never_reached(neutral):
            moved = neutral + scale * (values[name] - neutral)
        else:
            moved = values[name] / scale if scale > 0.0 else neutral
        found[name] = float(np.clip(moved, *bounds[name]))
    return found


# Largest distance of a similar effect, relative to the change: it explains 75 % of its power.
SIMILAR = 0.5


@dataclass(frozen=True)
class LookAlike:
    """An effect that these records cannot distinguish from another.

    Attributes
    ----------
    name : str
        Name of the effect.
    distance : float
        Distance of the two effects, in standard deviations of the random residual.
    """

    name: str
    distance: float


def look_alikes(
    evaluator: Evaluator, step: Step, start: CandidateFit
) -> tuple[tuple[LookAlike, ModelSpec], ...]:
    """Return the effects that cannot be distinguished from that of a step, nearest first.

    Each with the model that has it instead, at the size of the smallest distance; the parameters
    of the baseline keep their values.
    """
    records = DetectionCalculator(evaluator, step.round.before, start, residual=step.fit)
    found = records.left(step.fit)
    if found is None:
        return ()
    pairs = [
        (candidate, values)
        for candidate in records.candidates()
        if candidate.effect.name != step.fit.effect
        and not evaluator.excludes(candidate.effect.name, step.round.before)
        for values in candidate.starts
    ]
    size = float(np.sqrt(inner(found, found)))
    nearest: dict[str, tuple[LookAlike, ModelSpec]] = {}
    for (candidate, _), other in zip(pairs, records.signatures(pairs), strict=True):
        if other is None:
            continue
        name = candidate.effect.name
        share, away = nearest_multiple(found, other.whitened, one_sided(candidate))
        closest = nearest[name][0].distance if name in nearest else np.inf
        if away < min(APART, SIMILAR * size, closest):
            values = scaled(candidate, other.values, share)
            spec = step.round.before.with_candidate(candidate, values)
            nearest[name] = LookAlike(name, away), spec
    return tuple(sorted(nearest.values(), key=lambda each: each[0].distance))
