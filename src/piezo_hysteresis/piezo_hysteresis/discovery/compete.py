"""Every effect against every other: screened, fitted jointly with the model, scored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.discovery.dataset import Dataset, thinned
from piezo_hysteresis.discovery.floor import block_edges
from piezo_hysteresis.discovery.screen import Promise, Screen
from piezo_hysteresis.discovery.significance import Improvement, improvement, win_shares
from piezo_hysteresis.discovery.tones import on_one_clock
from piezo_hysteresis.discovery.trial import (
    Trial,
    errors_of,
    fit_trial,
    offset_bounds,
    on_views,
)
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import candidates

Progress = Callable[[float, str], None]

# Samples that the screening, the first fits and the last fits look at.
SCREEN_SAMPLES = 30_000
FIRST_SAMPLES = 40_000
# Candidates that get a first fit, and of those the ones that get a last one.
FIRST_FITS = 9
LAST_FITS = 4
# Starts per candidate in the first round.
STARTS = 2
FIRST_EVALUATIONS = 16
LAST_EVALUATIONS = 40
# A mean square above that of the noise by less than this is nothing anybody would miss.
NEGLIGIBLE = 0.03
NEGLIGIBLE_IN_ONE = 0.2


@dataclass(frozen=True)
class Contest:
    """One round of the competition.

    Attributes
    ----------
    before : Trial
        The model that lacks something.
    finalists : tuple of Trial
        The best fits, best first.
    shares : tuple of float
        Share of the resamples in which each finalist is the best.
    gain : Improvement
        Of the best finalist over `before`.
    tried : int
        Candidates that were looked at.
    """

    before: Trial
    finalists: tuple[Trial, ...]
    shares: tuple[float, ...]
    gain: Improvement
    tried: int

    @property
    def best(self) -> Trial:
        """The winner."""
        return self.finalists[0]

    def probabilities(self) -> dict[str, float]:
        """Share of the resamples by effect, variants of one effect together."""
        found: dict[str, float] = {}
        for trial, share in zip(self.finalists, self.shares, strict=True):
            found[trial.effect] = found.get(trial.effect, 0.0) + share
        return dict(sorted(found.items(), key=lambda each: -each[1]))


class Arena:
    """Where the effects compete.

    Parameters
    ----------
    data : Dataset
        Only its training views are looked at; of held-out ones only the drive.
    floor : float
        Noise rms [m].
    seed : int
        Of every random choice.
    workers : int
        Threads; the result does not depend on it.
    """

    def __init__(self, data: Dataset, floor: float, seed: int, workers: int) -> None:
        self.data = data
        self.floor = floor
        self._seed = seed
        self._workers = max(1, workers)
        self.views = data.training
        self._screened = thinned(self.views, SCREEN_SAMPLES, data.periods)
        self._first = thinned(self.views, FIRST_SAMPLES, data.periods)
        self.edges = block_edges(
            [v.measured.size for v in self.views],
            [data.periods[v.name] for v in self.views],
            [v.dt for v in self.views],
        )

    def on_one_clock(self, trial: Trial) -> Arena:
        """Return the arena with the phases of a fixed tone lined up, before one is modelled."""
        if any(block.clocked for block in trial.model.blocks):
            return self
        return Arena(on_one_clock(self.data, trial), self.floor, self._seed, self._workers)

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
        """Return the mean square above the floor, in units of the floor."""
        return trial.square / trial.samples / self.floor**2 - 1.0

    def lacks_something(self, trial: Trial) -> bool:
        """Tell whether the gap is above the floor anywhere by more than anybody would accept."""
        views = [float(e @ e) / e.size / self.floor**2 - 1.0 for e in trial.errors]
        return self.excess(trial) > NEGLIGIBLE or max(views) > NEGLIGIBLE_IN_ONE

    def contest(self, before: Trial, progress: Progress) -> Contest | None:
        """Run one round; None where no candidate can be fitted."""
        ratios = (self.data.amplitude, self.data.span)
        every = candidates(before.model, *ratios)
        screen = Screen(on_views(before, self._screened), self._screened)
        promises = self._map(screen.promise, every)
        progress(0.2, f'{len(every)} candidates screened')
        chosen = self._chosen(promises)
        first = self._map(lambda p: self._first_fit(before, p), chosen)
        fitted = sorted(
            (t for group in first for t in group), key=lambda t: (self.score(t), t.variant)
        )
        progress(0.6, f'{len(fitted)} first fits')
        semifinal = self._semifinalists(fitted)
        last = self._map(lambda t: self._last_fit(before, t), semifinal)
        finalists = sorted(
            (t for t in last if t is not None and self._stays_finite(t)),
            key=lambda t: (self.score(t), t.variant),
        )
        progress(1.0, f'{len(finalists)} finalists')
        if not finalists:
            return None
        shares = win_shares(
            finalists, [self.penalty(t) for t in finalists], self.edges, self._seed
        )
        gain = improvement(before, finalists[0], self.edges, len(every))
        return Contest(before, tuple(finalists), tuple(map(float, shares)), gain, len(every))

    def refit(self, trial: Trial, evaluations: int = LAST_EVALUATIONS) -> Trial:
        """Return `trial` fitted once more to all training views."""
        found = fit_trial(
            trial.model,
            trial.values,
            self.views,
            evaluations=evaluations,
            offset=self._offset(trial, trial),
            effect=trial.effect,
            variant=trial.variant,
        )
        return trial if found is None or found.square > trial.square else found

    def without(self, final: Trial, start: Trial, kept: Sequence[Trial]) -> Trial | None:
        """Return the model with the effects of `kept` alone, fitted from the values of `final`."""
        model = start.model
        for trial in kept:
            every = candidates(model, self.data.amplitude, self.data.span)
            match = next(
                (
                    c
                    for c in every
                    if (c.effect.name, c.effect.variant) == (trial.effect, trial.variant)
                ),
                None,
            )
            if match is None:
                return None
            model = match.model
        known = {
            name: final.values[name] for name in model.parameter_names if name in final.values
        }
        values = {**model.defaults(), **known, 'sampling_offset': final.values['sampling_offset']}
        last = kept[-1] if kept else start
        return fit_trial(
            model,
            values,
            self.views,
            evaluations=LAST_EVALUATIONS,
            offset=self._offset(start, final),
            effect=last.effect,
            variant=last.variant,
        )

    def is_as_good(self, simpler: Trial, richer: Trial) -> bool:
        """Tell whether the richer model is no real improvement over the simpler one."""
        gain = improvement(simpler, richer, self.edges, 1)
        share = (simpler.square - richer.square) / max(
            simpler.square - simpler.samples * self.floor**2, 1e-300
        )
        return gain.ratio < 5.0 or share < 0.05 or self.excess(simpler) < NEGLIGIBLE

    def _chosen(self, promises: Sequence[Promise]) -> list[Promise]:
        """Return the most promising candidates, at most two ways of one effect."""
        ordered = sorted(
            promises,
            key=lambda p: (-p.explained, p.candidate.effect.name, p.candidate.effect.variant),
        )
        chosen: list[Promise] = []
        for promise in ordered:
            same = sum(c.candidate.effect.name == promise.candidate.effect.name for c in chosen)
            if same < 2 and promise.explained > 1e-4:
                chosen.append(promise)
            if len(chosen) == FIRST_FITS:
                break
        return chosen

    def _first_fit(self, before: Trial, promise: Promise) -> list[Trial]:
        """Fit from the best starts on short views; keep the better one."""
        found = []
        effect = promise.candidate.effect
        for start in promise.starts[:STARTS]:
            trial = fit_trial(
                promise.candidate.model,
                start,
                self._first,
                evaluations=FIRST_EVALUATIONS,
                offset=self._offset(before, before),
                effect=effect.name,
                variant=effect.variant,
            )
            if trial is not None:
                found.append(trial)
        return [min(found, key=lambda t: t.square)] if found else []

    def _semifinalists(self, fitted: Sequence[Trial]) -> list[Trial]:
        """Return the best fits of different effects first, then the best variants."""
        leading: list[Trial] = []
        for trial in fitted:
            if all(trial.effect != other.effect for other in leading):
                leading.append(trial)
        rest = [t for t in fitted[:2] if all(t is not other for other in leading)]
        return [*leading[: LAST_FITS - len(rest)], *rest]

    def _last_fit(self, before: Trial, trial: Trial) -> Trial | None:
        return fit_trial(
            trial.model,
            trial.values,
            self.views,
            evaluations=LAST_EVALUATIONS,
            offset=self._offset(before, trial),
            effect=trial.effect,
            variant=trial.variant,
        )

    def _offset(self, before: Trial, trial: Trial) -> tuple[float, float]:
        dt = self.views[0].dt
        a = offset_bounds(before.model, before.values, dt)
        b = offset_bounds(trial.model, trial.values, dt)
        return min(a[0], b[0]), max(a[1], b[1])

    def _stays_finite(self, trial: Trial) -> bool:
        """Tell whether the model survives the held-out drives; what was measured is not used."""
        drives: list[Target] = list(self.data.held_out)
        errors = errors_of(trial.model, trial.values, drives)
        limit = 100.0 * self.data.span
        return all(bool(np.all(np.abs(e) < limit)) for e in errors)

    def _map(self, function: Callable, items: Sequence) -> list:  # type: ignore[type-arg]
        if self._workers == 1 or len(items) < 2:
            return [function(each) for each in items]
        with ThreadPoolExecutor(self._workers) as pool:
            return list(pool.map(function, items))
