"""The held view: a baseline that knows its values and what it misses, and one effect more.

A refit hides an effect in wrong parameters. So the values of a ``model.yaml`` stay as they are;
only what an effect adds, the zeros and starts of the records and their clock are free, and what is
left is judged against noise and discrepancy together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.arena import LAST_EVALUATIONS, Arena, added_of
from piezo_hysteresis.discovery.baseline import told_by
from piezo_hysteresis.discovery.compete import FIRST_EVALUATIONS, HOPELESS, STARTS, Contest
from piezo_hysteresis.discovery.dataset import Dataset
from piezo_hysteresis.discovery.expectation import Expectation, costs, expectation
from piezo_hysteresis.discovery.policy import POLICY, SelectionPolicy
from piezo_hysteresis.discovery.screen import Promise, Screen
from piezo_hysteresis.discovery.search import Progress
from piezo_hysteresis.discovery.settle import Step
from piezo_hysteresis.discovery.significance import Improvement
from piezo_hysteresis.discovery.tones import on_one_clock
from piezo_hysteresis.discovery.trial import Trial, fit_trial, on_views
from piezo_hysteresis.identification.checks import main_frequency
from piezo_hysteresis.identification.circumstances import Choices
from piezo_hysteresis.identification.record_start import STEP
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Discrepancy, Model, ModelFile, described
from piezo_hysteresis.models.modelfile import OFFSET_NOTE
from piezo_hysteresis.models.stages import free_states


@dataclass(frozen=True)
class Judged:
    """How a model does against what is expected.

    Attributes
    ----------
    cost : float
        Minus its log likelihood, and what its parameters cost [nats].
    excess : float
        Mean square beyond what is expected, in units of it, over all records [1].
    news : bool
        Whether any record shows more than the model is known to miss.
    """

    cost: float
    excess: float
    news: bool


class HeldArena(Arena):
    """An arena in which the values of the baseline stay.

    Parameters
    ----------
    data : Dataset
        As in `Arena`.
    seed, workers : int
        As in `Arena`.
    base : Trial
        The baseline as its file says.
    known : Discrepancy
        What it misses.
    policy : SelectionPolicy
        What decides.
    """

    holds = True

    def __init__(
        self,
        data: Dataset,
        seed: int,
        workers: int,
        base: Trial,
        known: Discrepancy,
        policy: SelectionPolicy = POLICY,
    ) -> None:
        super().__init__(data, seed, workers)
        self.base, self.known, self.policy = base, known, policy
        self._fixed = frozenset(base.model.free_names)
        strokes = {r.name: float(np.ptp(r.displacement)) for r in data.records}
        drives = {r.name: r.info.frequency or main_frequency(r) for r in data.records}

        def expected(view: Target) -> Expectation:
            seen = replace(view, frequency=drives[view.name])
            return expectation(seen, known, strokes[view.name], policy)

        self.expected = tuple(map(expected, data.training))
        self.expected_held_out = tuple(map(expected, data.held_out))

    def on_one_clock(self, trial: Trial) -> HeldArena:
        """Return the arena with the phases of a fixed tone lined up, before one is modelled."""
        if any(block.clocked for block in trial.model.blocks):
            return self
        data = on_one_clock(self.data, trial)
        return HeldArena(data, self.seed, self._workers, self.base, self.known, self.policy)

    def free_of(self, trial: Trial) -> tuple[str, ...]:
        """Return what is fitted of a model: what it has beyond the baseline."""
        return tuple(name for name in trial.model.free_names if name not in self._fixed)

    def fit_to(
        self, trial: Trial, views: Sequence[Target], evaluations: int = LAST_EVALUATIONS
    ) -> Trial | None:
        """Return `trial` with what it has beyond the baseline fitted to views."""
        late, dt = self.base.sampling_offset, views[0].dt
        return fit_trial(
            trial.model,
            trial.values,
            views,
            evaluations=evaluations,
            sampling_offset=trial.sampling_offset,
            added=trial.added,
            free=self.free_of(trial),
            clock=(late - dt, late + dt),
        )

    def fit(self, trial: Trial, *, short: bool = False, evaluations: int = 0) -> Trial | None:
        """Return `trial` fitted from its own values, to all training views or to short ones."""
        views = self.short if short else self.views
        return self.fit_to(trial, views, evaluations or LAST_EVALUATIONS)

    def judged(self, trial: Trial) -> Judged:
        """Return how a model does on the training views."""
        cost, excess, news = costs(trial.errors, self.expected)
        price = self.policy.price * self.counted(trial)
        return Judged(cost + price, excess, news)

    def counted(self, trial: Trial) -> int:
        """Return how many fitted parameters cost: where something has its zero is a nuisance."""
        zeros = sum(
            len(effect.zeros)
            for added in trial.added
            for effect in described(added.effect)
            if effect.variant == added.variant
        )
        return len(self.free_of(trial)) - zeros + self._states(trial)

    def _states(self, trial: Trial) -> int:
        """Return how many unknown states at the start of records an effect brought along."""
        dt = self.views[0].dt

        def count(model: Model) -> int:
            return sum(len(free_states(stage, dt, memory=False)) for stage in model.stages)

        more = max(count(trial.model) - count(self.base.model), 0)
        return more * sum(view.begins.kind == 'estimate' for view in self.views)

    def has_news(self, trial: Trial) -> bool:
        """Tell whether a model judged on all training views misses more than it is known to."""
        return costs(trial.errors, self.expected)[2]

    def has_news_held_out(self, trial: Trial) -> bool:
        """Tell the same of held-out views. They open the search; what it names, training shows."""
        errors = on_views(trial, self.data.held_out).errors
        return costs(errors, self.expected_held_out)[2]

    def held_out(self, trial: Trial) -> float:
        """Return the mean square of the errors on held-out views, in units of the expected one."""
        errors = on_views(trial, self.data.held_out).errors
        pairs = list(zip(errors, self.expected_held_out, strict=True))
        if not all(np.all(np.isfinite(error)) for error, _ in pairs):
            return float('inf')
        return sum(float(e @ e) / e.size / x.total for e, x in pairs) / max(len(pairs), 1)


def held_data(
    data: Dataset, given: ModelFile, choices: Choices, *, searched: bool = True
) -> tuple[Trial, Dataset]:
    """Return the baseline as its file says, and the data as it sees how they begin.

    Where starts are not `searched`, records begin as they say themselves.
    """
    late = float(given.provenance.notes.get(OFFSET_NOTE, 0.0))
    nominal = Trial(given.model, dict(given.values), (), 0, sampling_offset=late)
    told = told_by(nominal, data, choices, alone=True) if searched else data
    own = choices.zero != 'common'

    def zeroed(views: Sequence[Target]) -> tuple[Target, ...]:
        return tuple(replace(v, own_zero=own, precision=1.0, influence=None) for v in views)

    seen = replace(told, training=zeroed(told.training), held_out=zeroed(told.held_out))
    dt = data.training[0].dt
    clocked = fit_trial(
        given.model,
        nominal.values,
        seen.training,
        evaluations=LAST_EVALUATIONS,
        sampling_offset=late,
        free=(),
        clock=(late - dt, late + dt),
    )
    return on_views(clocked or nominal, seen.training), seen


Found = tuple[HeldArena, list[Step], Trial, Contest | None]


def find_held(
    data: Dataset,
    given: ModelFile,
    choices: Choices,
    seed: int,
    workers: int,
    progress: Progress,
    policy: SelectionPolicy = POLICY,
) -> Found:
    """Find what the model of a file lacks; see `search.search` for what is returned.

    What happened before a record can explain much: three levels of a strongly creeping model pass
    for a drift. So where a record that begins at rest at 0 V is said to have begun otherwise, both
    are followed to their end, and the levels cost what parameters cost.
    """
    assert given.discrepancy is not None
    found: list[tuple[float, Found]] = []
    for searched in (True, False):
        base, seen = held_data(data, given, choices, searched=searched)
        if not searched and (choices.start != 'auto' or not _invented(data, found[0][1][0].data)):
            break
        arena = HeldArena(seen, seed, workers, base, given.discrepancy, policy)
        each = search_held(arena, progress)
        levels = _invented(data, each[0].data)
        found.append((each[0].judged(each[2]).cost + policy.price * levels, each))
    return min(found, key=lambda pair: pair[0])[1]


def _invented(data: Dataset, seen: Dataset) -> int:
    """Return how many numbers tell the starts of records that seem to begin at rest at 0 V."""
    count = 0
    for before, after in zip(data.training, seen.training, strict=True):
        if before.begins.kind == STEP.kind and after.begins != before.begins:
            count += 1 + len(after.begins.levels)
    return count


def search_held(arena: HeldArena, progress: Progress) -> Found:
    """Add effects to a baseline whose values stay, one by one, as long as there is news."""
    current, steps = arena.base, list[Step]()
    contest: Contest | None = None
    for place in range(arena.policy.effects):
        arena = arena.on_one_clock(current)
        current = on_views(current, arena.views)
        if not (arena.has_news(current) or arena.has_news_held_out(current)):
            return arena, steps, current, None
        progress(0.15 + 0.2 * place, f'held baseline: looking for effect {place + 1}')
        contest = compete_held(arena, current)
        if contest is None:
            break
        current = contest.best
        steps.append(Step(contest, current))
    return arena, steps, current, contest


def compete_held(arena: HeldArena, before: Trial) -> Contest | None:
    """Run one round; return None where no effect proves itself."""
    every = arena.candidates(before)
    free = arena.free_of(before)
    screen = Screen(on_views(before, arena.screened), arena.screened, free)
    promises = arena.map(screen.promise, every)
    first = arena.map(lambda p: _first(arena, before, p), _chosen(promises, arena.policy))
    ordered = _ordered(arena, [trial for trial in first if trial is not None])
    kept = _semifinal(ordered, arena.policy.last_fits)
    last = arena.map(arena.fit, kept)
    finalists = _ordered(arena, [t for t in last if t is not None and arena.stays_finite(t)])
    worthy = [t for t in finalists if _worthy(arena, before, t, len(every))]
    if not worthy:
        return None
    rest = [t for t in finalists if t is not worthy[0]]
    return _contest(arena, before, [worthy[0], *rest], len(every))


def _chosen(promises: Sequence[Promise], policy: SelectionPolicy) -> list[Promise]:
    """Return the candidates that are fitted: each effect by its best way, then the others."""
    ordered = sorted(promises, key=lambda p: -p.explained)
    hopeful = [p for p in ordered if p.explained > HOPELESS]
    first: dict[str, Promise] = {}
    for promise in hopeful:
        first.setdefault(promise.candidate.effect.name, promise)
    others = [p for p in hopeful if p is not first[p.candidate.effect.name]]
    return [*first.values(), *others][: policy.first_fits]


def _first(arena: HeldArena, before: Trial, promise: Promise) -> Trial | None:
    candidate = promise.candidate
    added = (*before.added, added_of(candidate))
    late = before.sampling_offset
    fits = [
        arena.fit(
            Trial(candidate.model, start, (), 0, added, sampling_offset=late),
            short=True,
            evaluations=FIRST_EVALUATIONS,
        )
        for start in promise.starts[:STARTS]
    ]
    found = [fit for fit in fits if fit is not None]
    best = min(found, key=lambda t: t.square, default=None)
    return None if best is None else on_views(best, arena.views)


def _ordered(arena: HeldArena, trials: Sequence[Trial]) -> list[Trial]:
    return sorted(trials, key=lambda t: (arena.judged(t).cost, t.effect, t.variant))


def _semifinal(ordered: Sequence[Trial], most: int) -> list[Trial]:
    """Return the best way of each of the best effects, and every way of the very best one."""
    names = list(dict.fromkeys(t.effect for t in ordered))[:most]
    leaders = [next(t for t in ordered if t.effect == name) for name in names]
    others = [t for t in ordered if names and t.effect == names[0] and t is not leaders[0]]
    return [*leaders, *others]


def _worthy(arena: HeldArena, before: Trial, after: Trial, tried: int) -> bool:
    """Tell whether an effect is sure, worth its name, and no worse on held-out records."""
    old, new, policy = arena.judged(before), arena.judged(after), arena.policy
    if old.cost - new.cost < policy.sure + float(np.log(tried)):
        return False
    if old.excess - new.excess < policy.share * old.excess:
        return False
    return arena.held_out(after) <= (1.0 + policy.worse) * arena.held_out(before)


def _contest(arena: HeldArena, before: Trial, finalists: Sequence[Trial], tried: int) -> Contest:
    """Return the round with the probability of each finalist; what is missing is none of them."""
    cost = np.array([arena.judged(before).cost, *(arena.judged(t).cost for t in finalists)])
    weights = np.exp(-(cost - cost.min()))
    weights /= weights.sum()
    gain = float(cost[0] - cost[1])
    count = arena.counted(finalists[0]) - arena.counted(before)
    chance = float(chi2.sf(2.0 * max(gain, 0.0), max(count, 1)))
    improved = Improvement(before.square - finalists[0].square, gain, min(1.0, chance * tried))
    shares: FloatArray = weights[1:]
    return Contest(before, tuple(finalists), tuple(map(float, shares)), improved, tried)
