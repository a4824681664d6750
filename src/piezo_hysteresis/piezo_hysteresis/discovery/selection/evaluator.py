"""What a search looks at: the views, and how a model is fitted to them and scored on them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import inf
from typing import TypeVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset, thinned
from piezo_hysteresis.discovery.data.tones import on_one_clock
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    errors_of,
    fitted_to,
    judged_on,
)
from piezo_hysteresis.discovery.selection.deadline import Deadline
from piezo_hysteresis.discovery.selection.policy import SelectionPolicy
from piezo_hysteresis.discovery.selection.significance import Improvement
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Candidate, candidates

Opening = Callable[[Sequence[FloatArray]], Callable[[float], bool]]
"""``opening(changes)(factor)``: whether changes of every view [m], multiplied, open a search."""

Item = TypeVar('Item')
Result = TypeVar('Result')


@dataclass(frozen=True)
class Remainder:
    """What a model leaves in the end.

    Attributes
    ----------
    significant : bool
        Whether it is more than noise, nuisances and what was known.
    views : tuple of Target
        Where it shows.
    fit : CandidateFit
        The model judged on these views.
    note : str
        What is to be said of it besides; may be empty.
    """

    significant: bool
    views: tuple[Target, ...]
    fit: CandidateFit
    note: str = ''


class Evaluator(ABC):
    """Fits models to the training views and scores them there.

    Parameters
    ----------
    data : Dataset
        Only its training views are looked at; of held-out ones the drive, and errors as a veto.
    seed : int
        Of every random choice.
    workers : int
        Threads; the result does not depend on it.
    policy : SelectionPolicy
        What decides.
    deadline : Deadline, optional
        When nothing more is started.
    """

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

    # --- what the two views of a baseline differ in ---------------------------------------

    @abstractmethod
    def with_data(self, data: Dataset) -> Evaluator:
        """Return the same evaluator on other data."""

    @abstractmethod
    def free_of(self, spec: ModelSpec) -> tuple[str, ...]:
        """Return which parameters of a model are fitted."""

    @abstractmethod
    def score(self, fit: CandidateFit) -> float:
        """Return what ranks models, parameters priced; the smaller the better."""

    @abstractmethod
    def excess(self, fit: CandidateFit) -> float:
        """Return the mean square beyond what is expected on its views, in units of it."""

    @abstractmethod
    def lacks_something(self, fit: CandidateFit, start: CandidateFit) -> bool:
        """Return whether there is something left to look for, `start` being the baseline."""

    @abstractmethod
    def opening(self, fit: CandidateFit, start: CandidateFit) -> Opening:
        """Return which changes of the response of a model would open a search.

        Changes and errors are uncorrelated: their powers add up. The answer is yes where it holds
        with a probability of 95 % over the noise.
        """

    @abstractmethod
    def is_sure(self, before: CandidateFit, after: CandidateFit, tried: int) -> bool:
        """Return whether `after` is better by more than chance, of `tried`."""

    @abstractmethod
    def is_worthy(self, before: CandidateFit, after: CandidateFit, start: CandidateFit) -> bool:
        """Return whether what came last in `after` explains enough, on held-out records too."""

    @abstractmethod
    def improvement(self, before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
        """Return how sure `after` is better, of `tried` candidates."""

    @abstractmethod
    def shares(self, before: CandidateFit, finalists: Sequence[CandidateFit]) -> tuple[float, ...]:
        """Return the probability that each finalist is right, given that one of them is."""

    @abstractmethod
    def is_as_good(self, simpler: CandidateFit, richer: CandidateFit) -> bool:
        """Return whether the richer model is no real improvement over the simpler one."""

    @abstractmethod
    def certainty(self, before: float, after: float) -> float:
        """Return the probability that what is missing is among the effects that competed.

        `before` and `after` are the gaps on held-out records, in noise rms.
        """

    @abstractmethod
    def remainder(self, final: CandidateFit, start: CandidateFit) -> Remainder:
        """Return what is left in the end."""

    # --- what they share -------------------------------------------------------------------

    @property
    def measured(self) -> Dataset:
        """The data as they were measured."""
        return self.data

    def as_measured(self, fit: CandidateFit) -> CandidateFit:
        """Return a model judged on training views as they were measured."""
        return fit

    #: Between what the sampling offset may lie [s]; None for what every recording may have.
    clock: tuple[float, float] | None = None

    @property
    def unseen_delay(self) -> float:
        """How long a delay may be that passes for the clock of the records [s]."""
        low, high = self.clock or (0.0, 2.0 * self.views[0].dt)
        return 0.5 * (high - low)

    def candidates(self, spec: ModelSpec) -> tuple[Candidate, ...]:
        """Return a model with every effect that it can take up."""
        return candidates(spec.model, self.data.amplitude, self.data.span)

    def discrepancy(self, fit: CandidateFit, start: CandidateFit) -> float:
        """Return the excess that the laws of a model are known to leave."""
        return 0.0

    def first_values(self, before: ModelSpec) -> dict[str, float] | None:
        """Return the values of a baseline before any fit of it, None where it is held."""
        return None

    def with_own_starts(self, fit: CandidateFit) -> tuple[Evaluator, CandidateFit]:
        """Return the model with initial conditions that it estimates, and its evaluator."""
        return self, fit

    def first_judged(self, fit: CandidateFit) -> CandidateFit:
        """Return a first fit as it is ranked among the others."""
        return fit

    def promising(
        self, before: CandidateFit, fits: Sequence[CandidateFit], start: CandidateFit
    ) -> list[CandidateFit]:
        """Return the first fits that a longer one may make worth a name."""
        old = self.excess(self.first_judged(judged_on(before, self.short)))
        known = self.discrepancy(before, start)
        return [
            fit for fit in fits if rules.is_promising(old, self.excess(fit), known, self.policy)
        ]

    def tolerance(self, spec: ModelSpec) -> float:
        """Return the relative decrease that counts as none in a fit to all samples."""
        return self.policy.final_tolerance

    def enough(self, best: CandidateFit, within: float) -> float:
        """Return the sum of squares up to which a fit is of use beside the best so far."""
        return inf

    def fit(
        self,
        spec: ModelSpec,
        views: Sequence[Target] | None = None,
        evaluations: int = 0,
        enough: float = inf,
    ) -> CandidateFit | None:
        """Return a model fitted from its own values, to all training views or those given."""
        views = self.views if views is None else views
        return self._fitted(spec, views, evaluations, self.clock, enough)

    def _fitted(
        self,
        spec: ModelSpec,
        views: Sequence[Target],
        evaluations: int,
        clock: tuple[float, float] | None,
        enough: float = inf,
    ) -> CandidateFit | None:
        return fitted_to(
            spec,
            views,
            evaluations=evaluations or self.policy.final_evaluations,
            tolerance=self.tolerance(spec),
            free=self.free_of(spec),
            clock=clock,
            enough=enough,
            stopped=lambda: self.deadline.passed,
            workers=self.workers,
        )

    def fit_briefly(
        self, spec: ModelSpec, evaluations: int, enough: float = inf, workers: int = 1
    ) -> CandidateFit | None:
        """Return a model fitted to the short views, near enough to be ranked."""
        return self._fitted_briefly(spec, evaluations, self.clock, enough, workers)

    def _fitted_briefly(
        self,
        spec: ModelSpec,
        evaluations: int,
        clock: tuple[float, float] | None,
        enough: float,
        workers: int,
    ) -> CandidateFit | None:
        return fitted_to(
            spec,
            self.short,
            evaluations=evaluations,
            tolerance=self.policy.first_tolerance,
            enough=enough,
            derivatives=False,
            free=self.free_of(spec),
            clock=clock,
            stopped=lambda: self.deadline.passed,
            workers=workers,
        )

    def refit(self, fit: CandidateFit, evaluations: int = 0) -> CandidateFit:
        """Return a model fitted once more, itself where that is no better."""
        again = self.fit(fit, evaluations=evaluations)
        return fit if again is None or again.square > fit.square else again

    def judged(self, spec: ModelSpec) -> CandidateFit:
        """Return a model judged on all training views."""
        return judged_on(spec, self.views)

    def with_tones_aligned(self, fit: CandidateFit) -> Evaluator:
        """Return the evaluator with phases of a fixed tone lined up, before one is modelled."""
        if any(block.clocked for block in fit.model.blocks):
            return self
        names = {view.name for view in self.views}
        others = [view for view in self.data.held_out if view.name not in names]
        aligned = on_one_clock(self.data, fit.errors, others, errors_of(fit, others))
        return self if aligned is self.data else self.with_data(aligned)

    def stays_finite(self, spec: ModelSpec) -> bool:
        """Return whether a model survives the held-out drives; what was measured is not used."""
        limit = 100.0 * self.data.span
        errors = errors_of(spec, self.data.held_out)
        return all(bool(np.all(np.abs(e) < limit)) for e in errors)

    def raced(
        self,
        function: Callable[[CandidateFit, float], CandidateFit | None],
        fits: Sequence[CandidateFit],
        within: float,
        best: CandidateFit | None = None,
        wins: Callable[[CandidateFit], bool] = lambda fit: True,
    ) -> list[CandidateFit]:
        """Return fits gone on with, those that fail left out.

        The first, which is the best so far, goes ahead where there is no `best` from before; the
        others only have to show what may come near it.

        Parameters
        ----------
        function : callable
            Goes on with a fit, given the sum of squares from which on it is of use.
        fits : sequence of CandidateFit
            The best first.
        within : float
            Sum of squares over that of the best that is still of use.
        best : CandidateFit, optional
            Of the same kind as what comes out.
        wins : callable
            Whether the best is such that the others have to come near it.
        """
        ahead = [function(fit, inf) for fit in fits[:1]] if best is None else []
        first = ahead[0] if ahead else best
        enough = inf
        if first is not None and len(fits) > len(ahead) and wins(first):
            enough = self.enough(first, within)
        others = self.map(lambda fit: function(fit, enough), fits[len(ahead) :])
        return [fit for fit in (*ahead, *others) if fit is not None]

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Return the function of all items, computed in threads, in order."""
        if self.workers == 1 or len(items) < 2:
            return [function(each) for each in items]
        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(function, items))
