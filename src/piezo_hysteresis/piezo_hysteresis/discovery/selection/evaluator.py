"""Evaluation of candidate models on the views, within the time limit of a search."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from math import inf, log
from typing import Any, Self, TypeVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset, thinned
from piezo_hysteresis.discovery.data.tones import with_aligned_phases
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    errors_of,
    evaluated_on,
    fitted_to,
    is_another_change,
)
from piezo_hysteresis.discovery.selection.policy import SelectionPolicy
from piezo_hysteresis.discovery.selection.rules import Improvement
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import EFFECT_NAMES, Candidate, candidates

# Share of the time that a search leaves to the elimination. Chosen.
_RESERVED = 0.25


@dataclass
class Deadline:
    """A time limit that a search checks before each new step.

    The elimination of redundant effects is skipped last: until then an effect may be listed that a
    later one replaced.
    """

    seconds: float = inf  # time limit from `began`; unlimited by default [s]
    reserved: float = _RESERVED  # [1]
    began: float = field(default_factory=time.monotonic)  # monotonic time of the start [s]
    untried: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the limit."""
        if not (isinstance(self.seconds, (int, float)) and self.seconds > 0.0):
            raise IdentificationError(
                f'the time limit must be a number above 0 s, got {self.seconds!r}; leave it out '
                'for none'
            )

    @property
    def passed(self) -> bool:
        """Whether the time limit has passed."""
        return time.monotonic() - self.began > (1.0 - self.reserved) * self.seconds

    def with_reserve(self) -> Deadline:
        """Return the same limit with the time that is reserved for the elimination."""
        return replace(self, reserved=0.0)

    def skips(self, what: str) -> bool:
        """Return whether the time limit has passed, and record the skipped step."""
        late = self.passed
        if late:
            self.untried[what] = None
        return late


DetectionTest = Callable[[Sequence[FloatArray]], Callable[[float], bool]]
"""``test(changes)(factor)``: whether scaled response changes [m] start a search."""

Item = TypeVar('Item')
Result = TypeVar('Result')


@dataclass(frozen=True)
class UnexplainedResidual:
    """Residual of the final model."""

    significant: bool  # whether the residual exceeds noise
    views: tuple[FitData, ...]  # views on which it is evaluated
    fit: CandidateFit  # the model evaluated on these views
    note: str = ''  # additional statement for the user; may be empty


class Evaluator(ABC):
    """Fits models to the training views and scores them there."""

    def __init__(
        self,
        data: Dataset,
        seed: int,
        workers: int,
        policy: SelectionPolicy,
        deadline: Deadline | None = None,
    ) -> None:
        self.data, self.seed, self.policy = data, seed, policy
        self.deadline = deadline or Deadline()
        self.floor = data.noise.rms
        self.workers = max(1, workers)
        self.views = data.training
        self.screened = thinned(self.views, policy.screening_samples, data.periods)
        self.short = thinned(self.views, policy.first_fit_samples, data.periods)

    def with_shared_starts(self, before: ModelSpec) -> Self:
        """Return an evaluator whose brief fits use the unknown initial states of one model.

        To first order these states have the same effect with every candidate, so that screening
        and first fits need no search for them.
        """
        packed, late = before.model.pack(before.values), before.sampling_offset

        def sharing(view: FitData) -> FitData:
            if view.begins.kind != 'estimate':
                return view
            known = Prediction(before.model, packed, view, late).nuisances
            return replace(view, shared=(known.rows, known.prior))

        other = copy(self)
        other.screened, other.short = (
            tuple(self.map(sharing, views)) for views in (self.screened, self.short)
        )
        return other

    def with_reserve(self) -> Self:
        """Return an evaluator that may use the time reserved for the elimination."""
        other = copy(self)
        other.deadline = self.deadline.with_reserve()
        return other

    def noting_apart(self) -> Self:
        """Return an evaluator with the same time limit, which notes what it skips by itself."""
        other = copy(self)
        other.deadline = replace(self.deadline, untried={})
        return other

    # --- differences between a joint fit and a fixed baseline ------------------------------

    @abstractmethod
    def with_data(self, data: Dataset) -> Evaluator:
        """Return an evaluator with the same settings on other data."""

    @abstractmethod
    def free_of(self, spec: ModelSpec) -> tuple[str, ...]:
        """Return the names of the fitted parameters of a model."""

    @abstractmethod
    def score(self, fit: CandidateFit) -> float:
        """Return the penalized score that ranks models; smaller is better."""

    @abstractmethod
    def excess(self, fit: CandidateFit) -> float:
        """Return the mean square beyond the expectation on the fitted views, relative to it."""

    @abstractmethod
    def held_out(self, spec: ModelSpec) -> tuple[float, float]:
        """Return the mean square on held-out views and its excess, over the expected one."""

    @abstractmethod
    def has_significant_residual(self, fit: CandidateFit, start: CandidateFit) -> bool:
        """Return whether a significant residual remains; `start` is the baseline."""

    @abstractmethod
    def detection_test(self, fit: CandidateFit, start: CandidateFit) -> DetectionTest:
        """Return a function that decides whether response changes of a model would start a search.

        Changes and errors are uncorrelated, so their powers add. The function returns True if the
        search starts with a probability of 95 % over the noise.
        """

    @abstractmethod
    def is_significant(self, before: CandidateFit, after: CandidateFit, tried: int) -> bool:
        """Return whether `after` is significantly better, given `tried` candidates."""

    @abstractmethod
    def improvement(self, before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
        """Return the size and significance of the improvement, given `tried` candidates."""

    @abstractmethod
    def shares(self, before: CandidateFit, finalists: Sequence[CandidateFit]) -> tuple[float, ...]:
        """Return the probability of each finalist, given that one of them is correct."""

    @abstractmethod
    def is_as_good(self, simpler: CandidateFit, richer: CandidateFit) -> bool:
        """Return whether the richer model is not a relevant improvement over the simpler one."""

    @abstractmethod
    def certainty(self, before: float, after: float) -> float:
        """Return the probability that the missing effect is among the candidates.

        `before` and `after` are the gaps on held-out records, in noise rms.
        """

    @abstractmethod
    def remainder(self, final: CandidateFit, start: CandidateFit) -> UnexplainedResidual:
        """Return the residual of the final model and its significance."""

    # --- shared by both evaluators -----------------------------------------------------------

    def explains_enough(
        self, before: CandidateFit, after: CandidateFit, start: CandidateFit
    ) -> bool:
        """Return whether the last effect of `after` explains enough, also on held-out records."""
        if self.is_another_change(after):
            return False
        old, new = self.excess(before), self.excess(after)
        known = self.discrepancy(before, start)
        return rules.explains_enough(old, new, known, self.policy) and self.is_confirmed(
            before, after
        )

    def is_another_change(self, fit: CandidateFit) -> bool:
        """Return whether the fitted values of the last added effect describe another change."""
        return is_another_change(fit)

    def is_confirmed(self, before: CandidateFit, after: CandidateFit) -> bool:
        """Return whether the held-out records permit the last effect of `after`."""
        (old, _), (new, _) = map(self.held_out, (before, after))
        return rules.is_no_worse(old, new, self.policy)

    def reduces_gap(self, before: CandidateFit, after: CandidateFit) -> bool:
        """Return whether the effects of `after` reduce the gap on held-out records by enough."""
        (_, old), (_, new) = map(self.held_out, (before, after))
        return rules.reduces_gap_enough(old, new, self.policy)

    @property
    def measured(self) -> Dataset:
        """The measured data, without subtraction of a known discrepancy."""
        return self.data

    def as_measured(self, fit: CandidateFit) -> CandidateFit:
        """Return a model evaluated on the measured training views."""
        return fit

    #: Bounds of the sampling offset [s]; None for the bounds of any recording.
    clock: tuple[float, float] | None = None

    @property
    def unseen_delay(self) -> float:
        """Largest delay that is indistinguishable from the sampling offset of the records [s]."""
        low, high = self.clock or (0.0, 2.0 * self.views[0].dt)
        return 0.5 * (high - low)

    def further_names(self, fit: CandidateFit) -> float:
        """Return the penalty of the names of a model beyond the first one [nats].

        Each is one of many names, so it pays the logarithm of their number, as in the extended
        Bayesian criterion (Chen and Chen 2008). Another element of an accepted effect needs no
        further name: the laws of creep, modes and loops are sums of an unknown number of elements.
        """
        names = {added.effect for added in fit.added}
        return max(len(names) - 1, 0) * log(len(EFFECT_NAMES))

    def candidates(self, spec: ModelSpec) -> tuple[Candidate, ...]:
        """Return the model extended by each effect that it can accept."""
        return candidates(spec.model, self.data.amplitude, self.data.span)

    def excludes(self, effect: str, before: CandidateFit) -> bool:
        """Return whether a second channel of the records excludes an effect beyond a model."""
        second, names = self.data.second, {added.effect for added in before.added}
        return second is not None and second.excludes(effect, names, before.rms)

    def discrepancy(self, fit: CandidateFit, start: CandidateFit) -> float:
        """Return the excess that the inexact laws of a model can leave."""
        return 0.0

    def first_values(self, before: ModelSpec) -> dict[str, float] | None:
        """Return the parameter values of a baseline before any fit; None if it is fixed."""
        return None

    def starts_may_differ(self, fit: CandidateFit) -> bool:
        """Return whether a model may estimate other initial conditions of the records."""
        return any(v.begins.kind == 'estimate' or v.begins.levels for v in self.views)

    def with_own_starts(self, fit: CandidateFit) -> tuple[Evaluator, CandidateFit]:
        """Return an evaluator and a fit whose initial conditions the model itself estimates."""
        return self, fit

    def evaluated_for_ranking(self, fit: CandidateFit) -> CandidateFit:
        """Return a first fit evaluated on the samples on which first fits are ranked."""
        return fit

    def sharpened(self, fit: CandidateFit) -> CandidateFit:
        """Return a first fit at the optimum of its score, near its values."""
        return fit

    def promising(
        self, before: CandidateFit, fits: Sequence[CandidateFit], start: CandidateFit
    ) -> list[CandidateFit]:
        """Return the first fits that explain enough to justify a final fit."""
        old = self.excess(self.evaluated_for_ranking(evaluated_on(before, self.short)))
        known = self.discrepancy(before, start)
        return [
            fit for fit in fits if rules.is_promising(old, self.excess(fit), known, self.policy)
        ]

    def tolerance(self, spec: ModelSpec) -> float:
        """Return the relative decrease at which a fit to all samples stops."""
        return self.policy.final_tolerance

    def enough(self, best: CandidateFit, within: float) -> float:
        """Return the sum of squares above which a fit is terminated, given the best fit so far."""
        return inf

    def fit(
        self,
        spec: ModelSpec,
        views: Sequence[FitData] | None = None,
        evaluations: int = 0,
        enough: float = inf,
    ) -> CandidateFit | None:
        """Return the model fitted from its own values to `views` (default: all training views)."""
        return self._fitted(
            spec,
            self.views if views is None else views,
            evaluations=evaluations or self.policy.final_evaluations,
            tolerance=self.tolerance(spec),
            enough=enough,
            workers=self.workers,
        )

    def fit_briefly(
        self, spec: ModelSpec, evaluations: int, enough: float = inf, workers: int = 1
    ) -> CandidateFit | None:
        """Return the model fitted to the short views, precise enough for ranking."""
        return self._fitted(
            spec,
            self.short,
            evaluations=evaluations,
            tolerance=self.policy.first_tolerance,
            enough=enough,
            derivatives=False,
            workers=workers,
        )

    def _fitted(
        self, spec: ModelSpec, views: Sequence[FitData], **how: Any
    ) -> CandidateFit | None:
        return fitted_to(
            spec,
            views,
            free=self.free_of(spec),
            clock=self.clock,
            stopped=lambda: self.deadline.passed,
            **how,
        )

    def refit(self, fit: CandidateFit, evaluations: int = 0) -> CandidateFit:
        """Return the model after another fit, or the same fit if that is not better."""
        again = self.fit(fit, evaluations=evaluations)
        return fit if again is None or self.score(again) > self.score(fit) else again

    def evaluated(self, spec: ModelSpec) -> CandidateFit:
        """Return the model evaluated on all training views."""
        return evaluated_on(spec, self.views)

    def with_tones_aligned(self, fit: CandidateFit) -> Evaluator:
        """Return an evaluator with the phases of a fixed tone aligned over all records.

        A model that already contains a tone keeps the data unchanged.
        """
        if any(block.is_tone for block in fit.model.blocks):
            return self
        names = {view.name for view in self.views}
        others = [view for view in self.data.held_out if view.name not in names]
        aligned = with_aligned_phases(self.data, fit.errors, others, errors_of(fit, others))
        return self if aligned is self.data else self.with_data(aligned)

    def stays_finite(self, spec: ModelSpec) -> bool:
        """Return whether the response to the held-out drives is finite.

        The held-out displacement is not used.
        """
        limit = 100.0 * self.data.span
        errors = errors_of(spec, self.data.held_out)
        return all(bool(np.all(np.abs(e) < limit)) for e in errors)

    def with_early_stopping(
        self,
        function: Callable[[CandidateFit, float], CandidateFit | None],
        fits: Sequence[CandidateFit],
        within: float,
        best: CandidateFit | None = None,
        wins: Callable[[CandidateFit], bool] = lambda fit: True,
    ) -> list[CandidateFit]:
        """Return the continued fits, without those that fail.

        Without an earlier `best`, the first fit, which is the best so far, is continued alone
        first. The other fits are terminated early if they cannot come near it.
        """
        ahead = [function(fit, inf) for fit in fits[:1]] if best is None else []
        first = ahead[0] if ahead else best
        enough = inf
        if first is not None and len(fits) > len(ahead) and wins(first):
            enough = self.enough(first, within)
        others = self.map(lambda fit: function(fit, enough), fits[len(ahead) :])
        return [fit for fit in (*ahead, *others) if fit is not None]

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Return the function values of all items in order, computed in threads."""
        if self.workers == 1 or len(items) < 2:
            return [function(each) for each in items]
        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(function, items))
