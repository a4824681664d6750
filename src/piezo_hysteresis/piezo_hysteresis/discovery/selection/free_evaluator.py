"""Evaluator for a baseline without known discrepancy; it is fitted jointly with every effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import hypot, inf, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.baseline import (
    first_values,
    same_initial_conditions,
    with_other_starts,
    with_renewed_starts,
)
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
)
from piezo_hysteresis.discovery.selection.evaluator import (
    Deadline,
    DetectionTest,
    Evaluator,
    UnexplainedResidual,
)
from piezo_hysteresis.discovery.selection.policy import POLICY, SelectionPolicy
from piezo_hysteresis.discovery.selection.rules import Improvement, improvement, win_shares
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import Candidate


def block_edges(
    sizes: Sequence[int], periods: Sequence[int], dts: Sequence[float], seconds: float, fewest: int
) -> list[list[int]]:
    """Return the edges of blocks of whole periods, at least `seconds` long, per view.

    A few slow periods give too few blocks for a statistical test; parts of periods are then used.
    """
    lengths = []
    for period, dt in zip(periods, dts, strict=True):
        block = max(round(seconds / dt), 1)
        lengths.append(period * max(1, round(block / period)) if period else block)
    blocks = sum(size / length for size, length in zip(sizes, lengths, strict=True))
    shrink = min(1.0, blocks / fewest)
    edges = []
    for size, length in zip(sizes, lengths, strict=True):
        count = max(1, int(size // max(shrink * length, 1.0)))
        edges.append([k * size // count for k in range(count + 1)])
    return edges


# Ratio of standard errors from which training alone determines a value poorly.
_OPEN = 1.5
_MOST_NAMES = 3


def explained_together(training: CandidateFit, both: CandidateFit) -> str:
    """Return a sentence on a held-out gap that a fit to all records closes.

    If the held-out records exceed the range of the training records (a chirp into a mode), values
    that the training records determine poorly cause a gap, although no effect is missing. A fit to
    all records then has no residual; with a missing effect a residual remains in that fit, too.
    The values of `training` stay unchanged, because a model fitted to all records could not be
    tested on any.
    """
    names = _better_determined(training, both)
    which = f' ({", ".join(names)})' if names else ''
    return (
        'One set of values explains all records to the floor: the residual on held-out records '
        f'comes from values that the fitted records determine poorly{which}.'
    )


def _better_determined(training: CandidateFit, both: CandidateFit) -> list[str]:
    """Return the parameters that all records determine much better than training, worst first."""
    if training.fitted is None or both.fitted is None:
        return []
    before, after = training.fitted.std, both.fitted.std
    free = training.model.free_names
    ratios = {n: before[n] / max(after[n], 1e-300) for n in before if n in free}
    worst = sorted((n for n, r in ratios.items() if r > _OPEN), key=lambda n: -ratios[n])
    return worst[:_MOST_NAMES]


_AUTO = RecordAssumptions()
# 5 % quantile of the standard normal distribution, in standard deviations below the mean.
_ONE_IN_TWENTY = 1.645


class FreeEvaluator(Evaluator):
    """Scores models relative to the noise, because the baseline has no known discrepancy."""

    def __init__(
        self,
        data: Dataset,
        seed: int,
        workers: int,
        policy: SelectionPolicy = POLICY,
        deadline: Deadline | None = None,
        choices: RecordAssumptions = _AUTO,
    ) -> None:
        super().__init__(data, seed, workers, policy, deadline)
        self.choices = choices
        self.negligible = policy.negligible + policy.noise_deviations * data.noise.excess_deviation
        self.edges = block_edges(
            [v.measured.size for v in self.views],
            [data.periods[v.name] for v in self.views],
            [v.dt for v in self.views],
            policy.block_seconds,
            policy.min_blocks,
        )

    def with_data(self, data: Dataset) -> FreeEvaluator:
        """Return an evaluator with the same settings on other data."""
        return FreeEvaluator(
            data, self.seed, self.workers, self.policy, self.deadline, self.choices
        )

    def first_values(self, before: ModelSpec) -> dict[str, float]:
        """Return the parameter values of a baseline from the scan of starting values."""
        return first_values(before, self.data, self.policy.screening_samples)

    def starts_may_differ(self, fit: CandidateFit) -> bool:
        """Return whether a model may estimate other initial conditions of the records."""
        return super().starts_may_differ(fit) or bool(
            with_other_starts(fit, self.data, self.choices)
        )

    def with_own_starts(self, fit: CandidateFit) -> tuple[FreeEvaluator, CandidateFit]:
        """Return the fit with initial conditions that the model estimates, if it is better."""
        renewed = with_renewed_starts(fit, self.data, self.choices, self.workers)
        best: tuple[FreeEvaluator, CandidateFit] = self, fit
        tried = [self.data]
        for seen, most in ((renewed, 1.0), *with_other_starts(fit, self.data, self.choices)):
            if any(same_initial_conditions(each, seen) for each in tried):
                continue
            tried.append(seen)
            other, limit = self.with_data(seen), min(best[1].square, most * fit.square)
            again = other.fit(fit, enough=limit)
            if again is not None and again.square < limit:
                best = other, again
        return best

    def candidates(self, spec: ModelSpec) -> tuple[Candidate, ...]:
        """Return the model extended by each effect that can be fitted jointly with it."""
        return tuple(each for each in super().candidates(spec) if not each.effect.zeros)

    def free_of(self, spec: ModelSpec) -> tuple[str, ...]:
        """Return the names of the fitted parameters: all that the model does not hold."""
        return spec.model.free_names

    def tolerance(self, spec: ModelSpec) -> float:
        """Return the relative decrease at which a fit stops; it is larger for a large excess.

        An effect must explain a share of the excess, so an early stop may leave only a small
        fraction of it.
        """
        known = isinstance(spec, CandidateFit) and spec.errors
        seen = spec if isinstance(spec, CandidateFit) and known else self.evaluated(spec)
        missing = 1.0 - 1.0 / (1.0 + max(self.excess(seen), 0.0))
        return max(self.policy.final_tolerance, self.policy.first_tolerance * missing)

    def enough(self, best: CandidateFit, within: float) -> float:
        """Return the sum of squares above which a fit is terminated, given the best fit so far."""
        return within * best.square

    def penalty(self, fit: CandidateFit) -> float:
        """Return the penalty of parameters and names, in units of the log sum of squares."""
        independent = self.policy.records_information * len(self.views)
        nats = 0.5 * fit.parameters * float(np.log(independent)) + self.further_names(fit)
        return 2.0 * nats / independent

    def score(self, fit: CandidateFit) -> float:
        """Return the penalized log sum of squares, similar to the criterion of Schwarz 1978."""
        return float(np.log(max(fit.square, 1e-300))) + self.penalty(fit)

    def excess(self, fit: CandidateFit) -> float:
        """Return the mean square above the noise of each record, relative to it."""
        return fit.floors**2 - 1.0

    def shows_a_gap(
        self, fit: CandidateFit, excesses: Sequence[float] | None = None, trace: float = -inf
    ) -> bool:
        """Return whether the residual on the views of a fit exceeds the noise and a `trace`.

        The trace is the excess that inexact laws explain; `excesses` are those of the residual.
        """
        by_record = _excesses(fit) if excesses is None else excesses
        excess, deviation = _over_all(fit, by_record), self.data.noise.excess_deviation
        found = rules.shows_a_gap(excess, by_record, fit.excess_deviations, deviation, self.policy)
        return found and excess >= trace

    def discrepancy(self, fit: CandidateFit, start: CandidateFit) -> float:
        """Return the excess that the inexact laws of the added effects can leave."""
        inexact = [added.inexactness for added in fit.added]
        return rules.model_discrepancy(inexact, self.excess(start))

    def has_significant_residual(self, fit: CandidateFit, start: CandidateFit) -> bool:
        """Return whether the residual exceeds the noise and the known inexactness of the laws."""
        return self.shows_a_gap(fit, trace=self._trace(fit, start))

    def _trace(self, fit: CandidateFit, start: CandidateFit) -> float:
        """Return the excess that the inexact laws of a model explain, up to the negligible one."""
        return min(self.negligible, self.discrepancy(fit, start))

    def detection_test(self, fit: CandidateFit, start: CandidateFit) -> DetectionTest:
        """Return a function that decides whether response changes exceed the noise.

        It uses the 5 % quantile of the noise mean square, so that the decision holds with 95 %
        probability.
        """
        low = 1.0 - _ONE_IN_TWENTY * hypot(
            self.data.noise.excess_deviation, sqrt(2.0 / fit.samples)
        )
        trace = self._trace(fit, start)

        def of(changes: Sequence[FloatArray]) -> Callable[[float], bool]:
            squares = [
                float(c @ c) / c.size / noise**2
                for c, noise in zip(changes, fit.noises, strict=True)
            ]
            return lambda factor: self.shows_a_gap(
                fit, [max(low, 0.0) + factor**2 * square - 1.0 for square in squares], trace
            )

        return of

    def is_significant(self, before: CandidateFit, after: CandidateFit, tried: int) -> bool:
        """Return whether `after` is significantly better than `before`."""
        errors = self.improvement(before, after, 1).ratio
        return rules.is_significant(errors, self.score(before) - self.score(after), self.policy)

    def held_out(self, spec: ModelSpec) -> tuple[float, float]:
        """Return the mean square on held-out views and its excess, in units of the noise."""
        square = evaluated_on(spec, self.data.held_out).floors ** 2
        return square, square - 1.0

    def improvement(self, before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
        """Return the size and significance of the improvement from the residual spectrum."""
        return improvement(before, after, tried)

    def shares(self, before: CandidateFit, finalists: Sequence[CandidateFit]) -> tuple[float, ...]:
        """Return the share of bootstrap resamples in which each finalist is the best."""
        penalties = [self.penalty(each) for each in finalists]
        found = win_shares(finalists, penalties, self.edges, self.seed, self.policy.resamples)
        return tuple(map(float, found))

    def is_as_good(self, simpler: CandidateFit, richer: CandidateFit) -> bool:
        """Return whether the richer model is not a relevant improvement over the simpler one."""
        errors = self.improvement(simpler, richer, 1).ratio
        old, new = self.excess(simpler), self.excess(richer)
        return rules.is_as_good(old, new, errors, self.negligible, self.policy)

    def certainty(self, before: float, after: float) -> float:
        """Return the probability that the missing effect is among the candidates.

        It is proportional to the explained share of the held-out excess; the unexplained share
        counts against every candidate.
        """
        return self.policy.trust * rules.explained(before, after)

    def remainder(self, final: CandidateFit, start: CandidateFit) -> UnexplainedResidual:
        """Return the residual on training views, or on held-out views if only they show one."""
        if self.shows_a_gap(final):
            return UnexplainedResidual(True, self.views, final)
        held_out = self.data.held_out
        seen, note = evaluated_on(final, held_out), ''
        left = self.shows_a_gap(seen)
        if left:
            views = [replace(v, name=f'{v.name} (held out)') for v in held_out]
            both = self.fit(final, [*self.views, *views])
            evaluated = (
                [] if both is None else [self.evaluated(both), evaluated_on(both, held_out)]
            )
            if both is not None and not any(map(self.shows_a_gap, evaluated)):
                note = explained_together(final, both)
        return UnexplainedResidual(left and not note, held_out, seen, note)


def _excesses(fit: CandidateFit) -> list[float]:
    """Return the mean square above the noise of each record, relative to that of the noise."""
    pairs = zip(fit.errors, fit.noises, strict=True)
    return [float(e @ e) / e.size / max(noise, 1e-150) ** 2 - 1.0 for e, noise in pairs]


def _over_all(fit: CandidateFit, excesses: Sequence[float]) -> float:
    """Return the excess over all records, weighted by their number of samples."""
    pairs = zip(fit.errors, excesses, strict=True)
    return sum(error.size * excess for error, excess in pairs) / max(fit.samples, 1)
