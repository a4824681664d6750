"""What a competition is fought over: the views, the floor, how models are fitted and judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from piezo_hysteresis.discovery.blocks import block_edges
from piezo_hysteresis.discovery.dataset import Dataset, thinned
from piezo_hysteresis.discovery.significance import improvement
from piezo_hysteresis.discovery.tones import on_one_clock
from piezo_hysteresis.discovery.trial import (
    Added,
    Trial,
    errors_of,
    fit_trial,
    on_views,
)
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Candidate, candidates

# Samples that the screening and the first fits look at.
SCREEN_SAMPLES = 30_000
FIRST_SAMPLES = 40_000
LAST_EVALUATIONS = 40
# A mean square above that of the noise by less than this is nothing anybody would miss.
NEGLIGIBLE = 0.03
NEGLIGIBLE_IN_ONE = 0.2
# So many standard deviations of a mean square are no evidence of anything.
DOUBTS = 3.0
# No model of an effect is better than this share of the effect, so that what is left of it cannot
# be told from another one; banks and fitted laws that stand for many others are coarser.
EXACT = 0.02
COARSE = 0.07
COARSE_EFFECTS = ('nonlocal_memory', 'rate_dependence', 'hysteresis')
COARSE_VARIANTS = ('in_mode', 'in_nonlinear_mode')
# Standard errors from which an improvement counts.
SURE = 5.0
# An effect without which the sum of squares grows by less than this share does nothing.
IDLE = 1e-3

Item = TypeVar('Item')
Result = TypeVar('Result')


class Arena:
    """Where the effects compete.

    Parameters
    ----------
    data : Dataset
        Only its training views are looked at; of held-out ones only the drive.
    seed : int
        Of every random choice.
    workers : int
        Threads; the result does not depend on it.
    hints : sequence of mapping of str to float
        Other values of the baseline's parameters from which fits may start.
    """

    #: Whether the values of the baseline stay as they are.
    holds = False

    def __init__(
        self,
        data: Dataset,
        seed: int,
        workers: int,
        hints: Sequence[Mapping[str, float]] = (),
    ) -> None:
        self.data = data
        self.floor = data.noise.rms
        self.negligible = NEGLIGIBLE + DOUBTS * data.noise.doubt
        self.seed = seed
        self.hints = tuple(hints)
        self._workers = max(1, workers)
        self.views = data.training
        self.screened = thinned(self.views, SCREEN_SAMPLES, data.periods)
        self.short = thinned(self.views, FIRST_SAMPLES, data.periods)
        self.edges = block_edges(
            [v.measured.size for v in self.views],
            [data.periods[v.name] for v in self.views],
            [v.dt for v in self.views],
        )

    def on_one_clock(self, trial: Trial) -> Arena:
        """Return the arena with the phases of a fixed tone lined up, before one is modelled."""
        if any(block.clocked for block in trial.model.blocks):
            return self
        data = on_one_clock(self.data, trial)
        return Arena(data, self.seed, self._workers, self.hints)

    def candidates(self, trial: Trial) -> tuple[Candidate, ...]:
        """Return the model of `trial` with every effect that it can take up."""
        every = candidates(trial.model, self.data.amplitude, self.data.span)
        return tuple(each for each in every if self.holds or not each.effect.held)

    def penalty(self, trial: Trial) -> float:
        """Return what the parameters of `trial` cost, in units of log sum of squares.

        The information in a record is not its number of samples but of its independent features;
        some hundred per view is generous.
        """
        independent = 200.0 * len(self.views)
        return trial.parameters * float(np.log(independent)) / independent

    def score(self, trial: Trial) -> float:
        """Return the penalised log sum of squares; the smaller the better."""
        return float(np.log(max(trial.square, 1e-300))) + self.penalty(trial)

    def excess(self, trial: Trial) -> float:
        """Return the mean square above the noise of each record, in units of it."""
        return trial.floors**2 - 1.0

    def lacks_something(self, trial: Trial) -> bool:
        """Tell whether the gap is above the floor anywhere by more than anybody would accept."""
        return self.excess(trial) > self.negligible or any(
            float(e @ e) / e.size / noise**2 - 1.0
            > NEGLIGIBLE_IN_ONE + DOUBTS * np.sqrt(2.0 / e.size)
            for e, noise in zip(trial.errors, trial.noises, strict=True)
        )

    def is_crumb(self, trial: Trial, start: Trial, times: float = 1.0) -> bool:
        """Tell whether what is left is what no model of the effects so far could do better.

        With `times` above 1, whether it well may be.
        """
        coarse = any(
            added.effect in COARSE_EFFECTS or added.variant in COARSE_VARIANTS
            for added in trial.added
        )
        share = times * (COARSE if coarse else EXACT) if trial.added else 0.0
        return self.excess(trial) < share**2 * self.excess(start)

    def is_as_good(self, simpler: Trial, richer: Trial) -> bool:
        """Tell whether the richer model is no real improvement over the simpler one."""
        gain = improvement(simpler, richer, self.edges, 1)
        before, after = self.excess(simpler), self.excess(richer)
        share = (before - after) / max(before, 1e-300)
        return gain.ratio < SURE or share < 0.05 or self.excess(simpler) < self.negligible

    def fit(self, trial: Trial, *, short: bool = False, evaluations: int = 0) -> Trial | None:
        """Return `trial` fitted from its own values, to all training views or to short ones."""
        return fit_trial(
            trial.model,
            trial.values,
            self.short if short else self.views,
            evaluations=evaluations or LAST_EVALUATIONS,
            sampling_offset=trial.sampling_offset,
            added=trial.added,
        )

    def fit_to(self, trial: Trial, views: Sequence[Target]) -> Trial | None:
        """Return `trial` fitted to other views, of names that differ."""
        return fit_trial(
            trial.model,
            trial.values,
            views,
            evaluations=LAST_EVALUATIONS,
            sampling_offset=trial.sampling_offset,
            added=trial.added,
        )

    def refit(self, trial: Trial, evaluations: int = 0) -> Trial:
        """Return `trial` fitted once more, itself where that is no better."""
        found = self.fit(trial, evaluations=evaluations)
        return trial if found is None or found.square > trial.square else found

    def without(self, final: Trial, start: Trial, word: str) -> Trial | None:
        """Return the model without the effect `word`, fitted from the values of `final`."""
        kept = [added for added in final.added if added.effect != word]
        bare = self._with_only(final, start, kept)
        return None if bare is None else self.fit(bare)

    def pruned(self, final: Trial, start: Trial) -> Trial:
        """Return `final` without additions that change nothing, itself if there are none.

        The fit of a new effect may bring the ones before it to where they had to be, and leave
        the new one without a purpose. Only then every addition is put to the test.
        """
        idle = self._with_only(final, start, final.added[:-1])
        if idle is None or on_views(idle, self.views).square > (1.0 + IDLE) * final.square:
            return final
        for place in reversed(range(len(final.added))):
            kept = [*final.added[:place], *final.added[place + 1 :]]
            bare = self._with_only(final, start, kept) if kept else None
            fitted = None if bare is None else self.fit(bare)
            if fitted is not None and self.is_as_good(fitted, final):
                final = fitted
        return final

    def _with_only(self, final: Trial, start: Trial, kept: Sequence[Added]) -> Trial | None:
        """Return `start` with some of the additions of `final`, all with the values there."""
        held = start.model.held  # an effect may have freed them
        found = {k: v for k, v in final.values.items() if k in start.values and k not in held}
        values = start.values | found
        late = final.sampling_offset
        bare: Trial | None = Trial(start.model, values, (), 0, sampling_offset=late)
        for added in kept:
            bare = None if bare is None else self._again(bare, added, final)
        return bare

    def _again(self, bare: Trial, added: Added, final: Trial) -> Trial | None:
        """Give `bare` an effect that `final` has, with the values it has there."""
        for each in self.candidates(bare):
            if (each.effect.name, each.effect.variant) != (added.effect, added.variant):
                continue
            held = each.model.held
            known = {
                name: final.values[added.names[own]]
                for own, name in each.renamed.items()
                if name not in held
            }
            values = each.values(bare.values, {**each.neutral, **known})
            parts = (*bare.added, added_of(each))
            return Trial(each.model, values, (), 0, parts, sampling_offset=final.sampling_offset)
        return None

    def stays_finite(self, trial: Trial) -> bool:
        """Tell whether the model survives the held-out drives; what was measured is not used."""
        drives: list[Target] = list(self.data.held_out)
        errors = errors_of(trial.model, trial.values, drives, trial.sampling_offset)
        limit = 100.0 * self.data.span
        return all(bool(np.all(np.abs(e) < limit)) for e in errors)

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Apply `function` to all items, in threads; results in order."""
        if self._workers == 1 or len(items) < 2:
            return [function(each) for each in items]
        with ThreadPoolExecutor(self._workers) as pool:
            return list(pool.map(function, items))


def added_of(candidate: Candidate) -> Added:
    """Return what a candidate adds."""
    effect = candidate.effect
    return Added(effect.name, effect.variant, dict(candidate.renamed))
