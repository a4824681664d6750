"""Evaluation around a model file: uncertain values, predictive variance, fixed baseline.

A refit hides an effect in wrong parameter values. The values of a ``model.yaml`` therefore stay
fixed. Only the parameters of an effect and the nuisance parameters are fitted: the zero offsets,
initial conditions and sampling offset of the records. The residual is evaluated relative to noise
and discrepancy together.

A change of the baseline parameters is a candidate like any effect, `PARAMETER_SHIFT`. Each
parameter either remains within the covariance of the file, or it is a new value and costs the
penalty of a parameter; the lower cost counts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from math import inf
from typing import Self

import numpy as np
from scipy.special import chdtrc

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import InterSample
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.baseline import (
    same_initial_conditions,
    with_revised_starts,
)
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    effect_of,
    errors_of,
    evaluated_on,
    has_zero_time_constant,
    is_at_the_drive,
)
from piezo_hysteresis.discovery.selection.evaluator import (
    Deadline,
    DetectionTest,
    Evaluator,
    UnexplainedResidual,
)
from piezo_hysteresis.discovery.selection.policy import HELD, SelectionPolicy
from piezo_hysteresis.discovery.selection.residual_model import Expectation, costs, expectation
from piezo_hysteresis.discovery.selection.rules import Improvement
from piezo_hysteresis.discovery.selection.screen import ScoreAscent, with_delayed_discrepancy
from piezo_hysteresis.errors import IdentificationError, PiezoError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.model_discrepancy import discrepancy_text
from piezo_hysteresis.identification.noise import measured_without_outliers, reach_of
from piezo_hysteresis.identification.periods import main_frequency
from piezo_hysteresis.identification.sensitivities import delays_by_ticks
from piezo_hysteresis.identification.simulate import clock_about
from piezo_hysteresis.models import Candidate, Discrepancy, Model, ModelFile, shifted
from piezo_hysteresis.models.simulation.plan import free_states
from piezo_hysteresis.numerics.linalg import symmetric_eigen

# Relative variance below which a principal direction of the covariance is omitted.
_NONE = 1e-12


def widened(
    expected: Sequence[Expectation],
    base: ModelSpec,
    views: Sequence[FitData],
    names: Sequence[str],  # (p, p)
    covariance: FloatArray,  # (p, p)
) -> tuple[Expectation, ...]:
    """Return the expectations of views, increased by the predictive variance of the parameters.

    At a condition where the model was evaluated, the error of its values is already part of the
    known discrepancy; an octave away hardly any of it is.
    """
    if not names or set(names) != set(base.model.free_names):
        return tuple(expected)
    shares = [1.0 - float(np.exp(-2.0 * each.octaves)) for each in expected]
    more = [np.zeros_like(each.expected) for each in expected]
    own = errors_of(base, views)
    for step in _directions(covariance):
        moved = _moved(base, dict(zip(names, step, strict=True)), views)
        for k, error in enumerate(moved or ()):
            powers = expected[k].powers(error - own[k])
            if np.all(np.isfinite(powers)):
                more[k] += shares[k] * powers
    return tuple(replace(x, expected=x.expected + m) for x, m in zip(expected, more, strict=True))


def cost_of_change(
    changes: Mapping[str, float], names: Sequence[str], covariance: FloatArray, price: float
) -> float:  # names, covariance (p, p); price [nats]
    """Return the cost of parameter values that differ from the file [nats].

    Gains that compensate for each other are poorly determined individually and well determined in
    their sum: a change of all of them by one per cent is many standard deviations of the sum and
    hardly one of each. The cost is the lower one of two descriptions. Either some values are new,
    at the price of a parameter each, and the others stay within the covariance; or the same holds
    along the principal directions of the covariance.
    """
    held = price * sum(bool(change) and name not in names for name, change in changes.items())
    at = [k for k, name in enumerate(names) if name in changes]
    step, own = np.array([changes[names[k]] for k in at]), covariance[np.ix_(at, at)]
    along = float(np.minimum(_within(step, own), price).sum())
    return held + min(along, _one_by_one(step, own, price))


def _one_by_one(step: FloatArray, covariance: FloatArray, price: float) -> float:
    """Return the least cost with some new values, selected greedily one at a time [nats]."""
    kept = list(range(step.size))
    best = float(_within(step, covariance).sum())
    for others in range(1, step.size + 1):
        rests = [[each for each in kept if each != k] for k in kept]
        costs = [float(_within(step[r], covariance[np.ix_(r, r)]).sum()) for r in rests]
        kept = rests[int(np.argmin(costs))]
        best = min(best, min(costs) + others * price)
    return best


def _within(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the cost of a change within the covariance per principal direction [nats]."""
    if not np.any(step):
        return np.zeros(step.size)
    found = _principal(covariance)
    if found is None:
        return np.full(step.size, np.inf)
    scale, size, way = found
    size = np.maximum(size, _NONE * max(float(size.max()), _NONE))
    return np.asarray(0.5 * (way.T @ (step / scale)) ** 2 / size)


def _principal(covariance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return standard deviations, and eigenvalues and eigenvectors of the correlation matrix."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    found = symmetric_eigen(covariance / np.outer(scale, scale))
    return None if found is None else (scale, *found)


def _directions(covariance: FloatArray) -> list[FloatArray]:
    """Return steps of one standard deviation along the principal directions."""
    found = _principal(covariance)
    if found is None:
        return []
    scale, size, way = found
    kept = size > _NONE * max(float(size.max()), 0.0)
    return [scale * np.sqrt(s) * v for s, v in zip(size[kept], way.T[kept], strict=True)]


def _moved(
    base: ModelSpec, step: dict[str, float], views: Sequence[FitData]
) -> tuple[FloatArray, ...] | None:
    """Return the residuals of a model one step away.

    If the step is invalid, the reversed step or half a step is used; None if all are invalid.
    """
    for factor in (1.0, -1.0, 0.5, -0.5):
        values = {k: v + factor * step.get(k, 0.0) for k, v in base.values.items()}
        try:
            found = errors_of(replace(base, values=values), views)
        except PiezoError:
            continue
        if all(np.all(np.isfinite(error)) for error in found):
            return tuple(found)
    return None


class FixedBaselineEvaluator(Evaluator):
    """Scores models relative to noise and known discrepancy with a fixed baseline."""

    def __init__(
        self,
        data: Dataset,
        seed: int,
        workers: int,
        base: CandidateFit,
        given: ModelFile,
        policy: SelectionPolicy = HELD,
        deadline: Deadline | None = None,
        choices: RecordAssumptions | None = None,
    ) -> None:
        super().__init__(data, seed, workers, policy, deadline)
        self.choices = choices
        self.base, self.given, self.known = base, given, known_discrepancy(given)
        self._fixed = frozenset(base.model.free_names)
        self.late = given.sampling_offset
        self.clock = clock_about(given, self.views[0].dt, policy.jitter)
        self._uncertain = given.covariance()
        self._drives = tuple(drives_of(data).values())

        def expected(views: Sequence[FitData]) -> tuple[Expectation, ...]:
            found = expectations(data, views, self.known, policy)
            return widened(found, base, views, *self._uncertain)

        self.expected, self.expected_held_out = expected(data.training), expected(data.held_out)
        self._ascent = ScoreAscent(
            self.views, self.expected, self.score, self._beyond_known, self.late
        )

    @property
    def measured(self) -> Dataset:
        """The measured data, with the known discrepancy added back."""
        return _with_repeated(self.data, self.expected, self.expected_held_out, 1.0)

    def as_measured(self, fit: CandidateFit) -> CandidateFit:
        """Return a model evaluated on training views that include the known discrepancy."""
        return replace(evaluated_on(fit, self.measured.training), fitted=fit.fitted)

    def with_data(self, data: Dataset) -> FixedBaselineEvaluator:
        """Return an evaluator with the same settings on other data."""
        given = self.base, self.given, self.policy, self.deadline, self.choices
        return FixedBaselineEvaluator(data, self.seed, self.workers, *given)

    def starts_may_differ(self, fit: CandidateFit) -> bool:
        """Return whether a model may estimate other initial conditions of the records.

        The model without an effect may have found a record at rest that began in motion. The
        effect then leaves a new deviation.
        """
        if self.choices is None:
            return False
        return super().starts_may_differ(fit) or self.exceeds_discrepancy(fit)

    def with_own_starts(self, fit: CandidateFit) -> tuple[FixedBaselineEvaluator, CandidateFit]:
        """Return the fit with initial conditions that the model estimates, if it scores better."""
        if self.choices is None:
            return self, fit
        seen = with_revised_starts(fit, self.data, self.choices, self.workers, alone=True)
        seen = with_nuisances_of_records(seen, self.choices)
        if same_initial_conditions(self.data, seen):
            return self, fit
        renewed = self.with_data(seen)
        again = renewed.fit(fit)
        worse = again is None or renewed.score(again) > self.score(fit)
        return (self, fit) if again is None or worse else (renewed, again)

    def free_of(self, spec: ModelSpec) -> tuple[str, ...]:
        """Return the fitted parameters: those of the effects and shifted parameters."""
        held = self._fixed.difference(spec.shifted)
        return tuple(name for name in spec.model.free_names if name not in held)

    def candidates(self, spec: ModelSpec) -> tuple[Candidate, ...]:
        """Return the model extended by each effect it can accept, and with shifted parameters."""
        found = super().candidates(spec)
        # what is the zero of each record is none of the actuator, and moves without bound
        zeros = spec.model.zero_names if all(view.own_zero for view in self.views) else ()
        own = [n for n in spec.model.free_names if n in self._fixed and n not in zeros]
        if spec.shifted or not own:
            return found
        return (*found, shifted(spec.model, spec.values, own))

    def evaluated_for_ranking(self, fit: CandidateFit) -> CandidateFit:
        """Return a first fit on all training samples; expectations refer to whole records."""
        return self.evaluated(fit)

    def score(self, fit: CandidateFit) -> float:
        """Return the penalized negative log likelihood on the training views [nats]."""
        fitted = self.counted(fit) - len(fit.shifted) + fit.levels
        penalty = self.policy.price * fitted + self._moved(fit) + self.further_names(fit)
        return costs(self._beyond_known(fit), self.expected)[0] + penalty

    def fit(
        self,
        spec: ModelSpec,
        views: Sequence[FitData] | None = None,
        evaluations: int = 0,
        enough: float = inf,
    ) -> CandidateFit | None:
        """Return the fitted model, with the sampling offset of the file if that scores better.

        A free sampling offset compensates for part of every dynamic effect, so a fit with the
        offset of the file is tried as well.
        """
        found = super().fit(spec, views, evaluations, enough)
        if found is None or views is not None:
            return found
        fits = [self.sharpened(found)]
        if self._clock_moved(found):
            here = replace(found, sampling_offset=self.late)
            there = Evaluator.fit(self._still(), here, None, self.policy.first_evaluations)
            fits += [] if there is None else [self.sharpened(there)]
        return min(fits, key=self.score)

    def sharpened(self, fit: CandidateFit) -> CandidateFit:
        """Return a fit on all training views with a better score, near its values."""
        return fit if self.deadline.passed else self._ascent(fit, self.free_of(fit))

    def fit_briefly(
        self, spec: ModelSpec, evaluations: int, enough: float = inf, workers: int = 1
    ) -> CandidateFit | None:
        """Return the model fitted to short views, with the sampling offset of the file if better.

        A baseline whose sampling offset compensates for a delay is a local minimum that a trial
        does not leave.
        """
        found = super().fit_briefly(spec, evaluations, enough, workers)
        if not self._clock_moved(spec):
            return found
        here = replace(spec, sampling_offset=self.late)
        there = Evaluator.fit_briefly(self._still(), here, evaluations, enough, workers)
        fits = [each for each in (found, there) if each is not None]
        return min(fits, key=lambda each: each.square, default=None)

    def _still(self) -> Self:
        """Return the evaluator with a sampling offset that counts as that of the file."""
        still, other = self.policy.still_clock * self.views[0].dt, copy(self)
        other.clock = self.late - still, self.late + still
        return other

    def _clock_moved(self, spec: ModelSpec) -> bool:
        still = self.policy.still_clock * self.views[0].dt
        return abs(spec.sampling_offset - self.late) > 2.0 * still

    def _moved(self, fit: CandidateFit) -> float:
        """Return the penalty of changed baseline parameters and sampling offset [nats].

        With a delay by whole ticks, the sampling offset is the rest of the delay.
        """
        rest = delays_by_ticks(fit.model).intersection(self.free_of(fit))
        total = self.policy.price if self._clock_moved(fit) and not rest else 0.0
        changes = {name: fit.values[name] - self.base.values[name] for name in fit.shifted}
        if any(changes.values()):
            total += cost_of_change(changes, *self._uncertain, self.policy.price)
        return total

    def counted(self, fit: CandidateFit) -> int:
        """Return the number of fitted parameters.

        The zero positions of a static effect are nuisance parameters and do not count.
        """
        every = (effect_of(added) for added in fit.added)
        zeros = sum(
            len(each.zeros)
            for each in every
            if each.block is not None and each.block.between is InterSample.INSTANT
        )
        return len(self.free_of(fit)) - zeros + self._states(fit)

    def _states(self, fit: CandidateFit) -> int:
        """Return the number of unknown initial states of the records that the effects add."""
        dt = self.views[0].dt

        def count(model: Model) -> int:
            return sum(len(free_states(stage, dt, memory=False)) for stage in model.stages)

        more = max(count(fit.model) - count(self.base.model), 0)
        return more * sum(view.begins.kind == 'estimate' for view in self.views)

    def _beyond_known(self, fit: CandidateFit) -> tuple[FloatArray, ...]:
        """Return the training residuals with the known discrepancy behind delays and lags [m]."""
        views, expected = self.views, self.expected
        return with_delayed_discrepancy(fit, fit.errors, views, expected, self.late)

    def _held_out_beyond_known(self, spec: ModelSpec) -> tuple[FloatArray, ...]:
        """Return the same for the held-out residuals [m]."""
        views, expected = self.data.held_out, self.expected_held_out
        errors = evaluated_on(spec, views).errors
        return with_delayed_discrepancy(spec, errors, views, expected, self.late)

    def distance(self, one: CandidateFit, other: CandidateFit) -> float:
        """Return the distance of two responses, in standard deviations of what is expected.

        Each harmonic and octave counts as its number of independent values. The known discrepancy
        is expected with any phase: it is no better known than the effects.
        """
        parts = zip(_with_added(one, self.expected), one.errors, other.errors, strict=True)
        return float(np.sqrt(sum(np.sum(x.whitened(b - a) ** 2) for x, a, b in parts)))

    def excess(self, fit: CandidateFit) -> float:
        """Return the mean square beyond the expectation over all records, relative to it."""
        return costs(self._beyond_known(fit), self.expected)[1]

    def exceeds_discrepancy(self, fit: CandidateFit) -> bool:
        """Return whether the training residuals exceed the known discrepancy."""
        return costs(self._beyond_known(fit), _with_added(fit, self.expected))[2]

    def held_out_exceeds_discrepancy(self, spec: ModelSpec) -> bool:
        """Return whether the held-out residuals exceed the known discrepancy.

        Held-out views can start the search but select no effect.
        """
        expected = _with_added(spec, self.expected_held_out)
        return costs(self._held_out_beyond_known(spec), expected)[2]

    def has_significant_residual(self, fit: CandidateFit, start: CandidateFit) -> bool:
        """Return whether a training or held-out residual exceeds the known discrepancy."""
        return self.exceeds_discrepancy(fit) or self.held_out_exceeds_discrepancy(fit)

    def detection_test(self, fit: CandidateFit, start: CandidateFit) -> DetectionTest:
        """Return a function that decides whether response changes exceed the known discrepancy."""
        expected = _with_added(fit, self.expected)
        errors = self._beyond_known(fit)
        own = [each.powers(error) for each, error in zip(expected, errors, strict=True)]

        def of(changes: Sequence[FloatArray]) -> Callable[[float], bool]:
            more = [each.powers(change) for each, change in zip(expected, changes, strict=True)]
            return lambda factor: any(
                each.new_deviation(power + factor**2 * added)
                for each, power, added in zip(expected, own, more, strict=True)
            )

        return of

    def is_significant(self, before: CandidateFit, after: CandidateFit, tried: int) -> bool:
        """Return whether `after` is significantly better, given the number of `tried` candidates.

        A residual of `before` beyond the known discrepancy is a sufficient proof that an effect is
        missing. A better model without such a residual explains the records, even if a few
        harmonics contain all of the evidence; but not if one of so many candidates always would.
        """
        if self.improvement(before, after, tried).p_value >= self.policy.chance:
            return False
        gain = self.score(before) - self.score(after)
        missing = self.has_significant_residual
        return gain >= self.policy.sure + float(np.log(tried)) or (
            gain > 0.0 and not missing(after, before) and missing(before, before)
        )

    def is_another_change(self, fit: CandidateFit) -> bool:
        """Return whether the last effect is another change: a changed gain, or what has no time.

        A tone at the drive, and creep without a visible time constant, are a gain.
        """
        return (
            super().is_another_change(fit)
            or has_zero_time_constant(fit, self.views[0].dt)
            or is_at_the_drive(fit, self._drives)
        )

    def is_confirmed(self, before: CandidateFit, after: CandidateFit) -> bool:
        """Return whether the last effect reduces the gap, too."""
        return self.reduces_gap(before, after)

    def reduces_gap(self, before: CandidateFit, after: CandidateFit) -> bool:
        """Return whether the gap on held-out or on training records decreases by enough.

        A slow drift or a small tone changes the held-out records less than the discrepancy of the
        baseline differs between records. The error on held-out records must not increase.
        """
        (was, old), (now, new) = map(self.held_out, (before, after))
        if not rules.reduces_gap_enough(old, new, self.policy) and not rules.reduces_gap_enough(
            self.excess(before), self.excess(after), self.policy
        ):
            return False
        return rules.is_no_worse(was, now, self.policy)

    def held_out(self, spec: ModelSpec) -> tuple[float, float]:
        """Return the mean square on held-out views and its excess, in units of the expected."""
        errors, expected = self._held_out_beyond_known(spec), self.expected_held_out
        if not all(np.all(np.isfinite(error)) for error in errors):
            return inf, inf
        squares = [float(e @ e) / e.size / x.total for e, x in zip(errors, expected, strict=True)]
        return sum(squares) / max(len(squares), 1), costs(errors, expected)[1]

    def improvement(self, before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
        """Return the log likelihood ratio in nats and its p-value (Wilks 1938).

        The p-value of a curve of the sensor is that of a second channel, if that is smaller.
        """
        gain = self.score(before) - self.score(after)
        count = self.counted(after) - self.counted(before)
        chance = float(chdtrc(max(count, 1), 2.0 * max(gain, 0.0)))
        if self.data.second is not None:
            chance = min(chance, self.data.second.chance(after.effect))
        return Improvement(before.square - after.square, gain, min(1.0, chance * tried))

    def shares(self, before: CandidateFit, finalists: Sequence[CandidateFit]) -> tuple[float, ...]:
        """Return the posterior probability of each finalist, relative to no added effect.

        All effects have the same prior probability, divided among the variants of an effect.
        """
        ways = [float(sum(f.effect == fit.effect for f in finalists)) for fit in finalists]
        priced = map(lambda fit, n: self.score(fit) + float(np.log(n)), finalists, ways)
        cost = np.array([self.score(before), *priced])
        weights = np.exp(-(cost - cost.min()))
        return tuple(map(float, (weights / weights.sum())[1:]))

    def is_as_good(self, simpler: CandidateFit, richer: CandidateFit) -> bool:
        """Return whether the richer model is not a significant improvement over the simpler."""
        return self.score(simpler) - self.score(richer) < self.policy.sure

    def certainty(self, before: float, after: float) -> float:
        """Return the reliability of the shares, a constant of the policy.

        The shares already include the case that no effect explains the residual.
        """
        return self.policy.trust

    def remainder(self, final: CandidateFit, start: CandidateFit) -> UnexplainedResidual:
        """Return the residual beyond the known discrepancy of the baseline."""
        if self.exceeds_discrepancy(final):
            return UnexplainedResidual(True, self.views, final)
        held_out = self.data.held_out
        if self.held_out_exceeds_discrepancy(final):
            return UnexplainedResidual(True, held_out, evaluated_on(final, held_out))
        if self._is_unexplained(final):
            note = 'One record does not show whether this error is that of another day.'
            return UnexplainedResidual(True, held_out, evaluated_on(final, held_out), note)
        known = f'As it was identified it {discrepancy_text(self.known)}.'
        return UnexplainedResidual(False, self.views, final, known)

    def _is_unexplained(self, spec: ModelSpec) -> bool:
        """Return whether the residual is far above the noise and nothing shows that it repeats.

        Beyond noise and the discrepancy in phase, only repeated records show that the rest is
        usual.
        """
        errors, views = self._held_out_beyond_known(spec), self.data.held_out
        pairs = zip(errors, views, self.expected_held_out, strict=True)
        own = [float(np.sqrt(np.mean(e**2))) for e, _, x in pairs if not x.repeats]
        return max(own, default=0.0) > self.policy.unexplained * self.floor


def _with_added(spec: ModelSpec, expected: Sequence[Expectation]) -> Sequence[Expectation]:
    """Return the expectations for a model with added effects.

    An effect after the actuator also acts on the known discrepancy: a delay rotates each of its
    harmonics. The phase of the discrepancy is then unknown.
    """
    return [each.out_of_phase() for each in expected] if spec.added else expected


def expectations(
    data: Dataset, views: Sequence[FitData], known: Discrepancy, policy: SelectionPolicy
) -> tuple[Expectation, ...]:
    """Return the expected residual power of each view for a model with the discrepancy `known`.

    Views without a record are planned experiments.
    """
    strokes = {r.name: reach_of(measured_without_outliers(r)) for r in data.records}
    drives = drives_of(data)

    def expected(view: FitData) -> Expectation:
        seen = replace(view, frequency=drives.get(view.name, view.frequency))
        stroke = strokes.get(view.name, float(np.ptp(view.measured)))
        return expectation(seen, known, stroke, policy)

    return tuple(map(expected, views))


def drives_of(data: Dataset) -> dict[str, float]:
    """Return the frequency of the drive by record, 0 where it is not periodic [Hz]."""
    return {r.name: r.info.frequency or main_frequency(r) for r in data.records}


def known_discrepancy(given: ModelFile) -> Discrepancy:
    """Return the known discrepancy of a model file."""
    if given.discrepancy is None:
        raise IdentificationError('the model file has no discrepancy: identify it again')
    return given.discrepancy


def with_nuisances_of_records(data: Dataset, choices: RecordAssumptions) -> Dataset:
    """Return the data with equal weights and a zero of every record, unless one is common."""
    own = choices.zero != 'common'
    return data.with_each(lambda view: replace(view, own_zero=own, precision=1.0, influence=None))


def without_repeated(data: Dataset, known: Discrepancy, policy: SelectionPolicy) -> Dataset:
    """Return the data minus the known discrepancy of a model under each drive.

    Fits then see only new deviations; the known discrepancy is not attributed to an effect.
    """
    training = expectations(data, data.training, known, policy)
    held_out = expectations(data, data.held_out, known, policy)
    return _with_repeated(data, training, held_out, -1.0)


def _with_repeated(
    data: Dataset, training: Sequence[Expectation], held_out: Sequence[Expectation], times: float
) -> Dataset:
    """Return the data plus `times` the known discrepancy signal of each view."""

    def moved(views: Sequence[FitData], expected: Sequence[Expectation]) -> tuple[FitData, ...]:
        pairs = zip(views, expected, strict=True)
        return tuple(replace(v, measured=v.measured + times * x.repeated) for v, x in pairs)

    return replace(
        data, training=moved(data.training, training), held_out=moved(data.held_out, held_out)
    )
