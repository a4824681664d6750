"""One round of selection: every effect screened, the best fitted with the model and ranked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.candidate_filter import competing
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.policy import SelectionPolicy
from piezo_hysteresis.discovery.selection.restart import better_of_both
from piezo_hysteresis.discovery.selection.screen import Screen, ScreeningScore
from piezo_hysteresis.discovery.selection.significance import Improvement
from piezo_hysteresis.models import Candidate, described

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class SelectionRound:
    """One round.

    Attributes
    ----------
    before : CandidateFit
        The model that lacks something.
    finalists : tuple of CandidateFit
        Fits to all training samples, the chosen one first.
    shares : tuple of float
        Probability of each finalist.
    gain : Improvement
        Of the first finalist over `before`.
    tried : int
        Candidates that were looked at.
    accepted : bool
        Whether the first finalist is an effect: sure, and worth its name.
    """

    before: CandidateFit
    finalists: tuple[CandidateFit, ...]
    shares: tuple[float, ...]
    gain: Improvement
    tried: int
    accepted: bool = True

    @property
    def best(self) -> CandidateFit:
        """The chosen one."""
        return self.finalists[0]

    def won_clearly(self, policy: SelectionPolicy) -> bool:
        """Return whether no finalist of another effect came near."""
        limit = policy.rival_within * self.best.square
        return all(fit.effect == self.best.effect or fit.square > limit for fit in self.finalists)

    def probabilities(self) -> dict[str, float]:
        """Probability by effect, variants of one effect together."""
        found: dict[str, float] = {}
        for fit, share in zip(self.finalists, self.shares, strict=True):
            found[fit.effect] = found.get(fit.effect, 0.0) + share
        return dict(sorted(found.items(), key=lambda each: -each[1]))


def select(
    evaluator: Evaluator, before: CandidateFit, start: CandidateFit, progress: Progress
) -> SelectionRound | None:
    """Run one round over the effects that `before` may lack; None where none can be fitted.

    Parameters
    ----------
    evaluator : Evaluator
        Fits and scores.
    before, start : CandidateFit
        The model so far, and the baseline.
    progress : callable
        Called with ``(fraction, message)``.
    """
    every = competing(evaluator, before)
    free = evaluator.free_of(before)
    screen = Screen(before, evaluator.screened, free, evaluator.workers)
    screened = evaluator.map(lambda each: _screened(evaluator, screen, each), every)
    scores = [each for each in screened if each is not None]
    progress(0.2, f'{len(every)} candidates screened')
    least = rules.least_promise(evaluator.excess(before), evaluator.policy)
    chosen = choose_trials(scores, least, evaluator.policy)
    tried = evaluator.map(lambda each: _trial(evaluator, before, each), chosen)
    progress(0.4, f'{len(chosen)} candidates tried')
    hopeful = choose_first_fits(evaluator, [fit for fit in tried if fit is not None])
    first = evaluator.raced(
        lambda each, enough: _first_fit(evaluator, each, enough),
        hopeful,
        evaluator.policy.final_within,
    )
    fitted = ranked(evaluator, better_of_both(evaluator, before, chosen, ranked(evaluator, first)))
    progress(0.6, f'{len(fitted)} first fits')
    finalists = _finalists(evaluator, before, fitted, start, len(every))
    if not finalists:
        return None
    progress(1.0, f'{len(finalists)} finalists')
    return round_of(evaluator, before, finalists, len(every), start)


def _screened(evaluator: Evaluator, screen: Screen, candidate: Candidate) -> ScreeningScore | None:
    """Return what a candidate promises, None where there is no time to look at it."""
    return None if evaluator.deadline.skips(candidate.effect.name) else screen.score(candidate)


def _finalists(
    evaluator: Evaluator,
    before: CandidateFit,
    fitted: Sequence[CandidateFit],
    start: CandidateFit,
    tried: int,
) -> list[CandidateFit]:
    """Return the best first fits ended on all samples, best first.

    Where none of them promises anything, none is: they stand there as what came nearest.
    """
    hopeful = evaluator.promising(before, fitted, start)
    if not hopeful:
        nearest = of_different_places(fitted, evaluator.policy)
        return ranked(evaluator, _finite(evaluator, evaluator.map(evaluator.judged, nearest)))

    def wins(fit: CandidateFit) -> bool:
        worthy = evaluator.stays_finite(fit) and evaluator.is_worthy(before, fit, start)
        return worthy and evaluator.is_sure(before, fit, tried)

    leaders = _final_fits(evaluator, of_different_places(hopeful, evaluator.policy), wins)
    if not leaders:
        return []
    variants = [
        _nearer(evaluator, before, fit, leaders[0]) for fit in _other_variants(leaders, fitted)
    ]
    others = _final_fits(evaluator, variants, wins, leaders[0])
    return ranked(evaluator, [*leaders, *others])


def round_of(
    evaluator: Evaluator,
    before: CandidateFit,
    finalists: Sequence[CandidateFit],
    tried: int,
    start: CandidateFit,
) -> SelectionRound:
    """Return the round in which finalists, best first, met: the first that is an effect wins.

    Those that explain enough compete for the name. The others are no outcome of the round: what is
    there besides, but explains little, or what fails on held-out records.
    """
    worthy = [fit for fit in finalists if evaluator.is_worthy(before, fit, start)]
    winner = next((fit for fit in worthy if evaluator.is_sure(before, fit, tried)), None)
    rivals = worthy or list(finalists)
    first = rivals[0] if winner is None else winner
    order = (first, *(fit for fit in rivals if fit is not first))
    others = tuple(fit for fit in finalists if all(fit is not rival for rival in rivals))
    shares = (*evaluator.shares(before, order), *(0.0 for _ in others))
    gain = evaluator.improvement(before, first, tried)
    return SelectionRound(before, (*order, *others), shares, gain, tried, winner is not None)


def ranked(evaluator: Evaluator, fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Return fits in the order of their scores."""
    return sorted(fits, key=lambda fit: (evaluator.score(fit), fit.effect, fit.variant))


def choose_trials(
    scores: Sequence[ScreeningScore], least: float, policy: SelectionPolicy
) -> list[ScreeningScore]:
    """Return what is tried: the most promising, of each effect its best variants first.

    A richer way of an effect promises more by what it has more, so it is never the first of them.
    """
    ordered = sorted(
        (each for each in scores if each.explained > least),
        key=lambda s: (-s.explained, s.candidate.effect.name, s.candidate.effect.variant),
    )
    first: list[ScreeningScore] = []
    later: list[ScreeningScore] = []
    for score in ordered:
        same = sum(c.candidate.effect.name == score.candidate.effect.name for c in first)
        same += bool(score.candidate.effect.refines)
        (first if same < policy.variants_first else later).append(score)
    return [*first, *later][: policy.trials]


def _trial(
    evaluator: Evaluator, before: CandidateFit, score: ScreeningScore
) -> CandidateFit | None:
    """Try the best starts for a little and return where the best one led."""
    candidate, policy = score.candidate, evaluator.policy
    if evaluator.deadline.skips(candidate.effect.name):
        return None
    best: CandidateFit | None = None
    for start in score.starts[: policy.starts]:
        spec = before.with_candidate(candidate, start)
        enough = inf if best is None else evaluator.enough(best, 1.0)
        fit = evaluator.fit_briefly(spec, policy.trial_evaluations, enough)
        if fit is not None and (best is None or fit.square < best.square):
            best = fit
    return best


def choose_first_fits(evaluator: Evaluator, tried: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Return the trials that went best; they were all on the same samples."""
    scores = evaluator.map(lambda fit: evaluator.score(evaluator.first_judged(fit)), tried)
    pairs = sorted(
        zip(scores, tried, strict=True), key=lambda p: (p[0], p[1].effect, p[1].variant)
    )
    return [fit for _, fit in pairs[: evaluator.policy.first_fits]]


def _first_fit(evaluator: Evaluator, trial: CandidateFit, enough: float) -> CandidateFit | None:
    """Fit to short views from where a trial ended."""
    if evaluator.deadline.skips(trial.effect):
        return None
    evaluations, workers = evaluator.policy.first_evaluations, evaluator.workers
    fit = evaluator.fit_briefly(trial, evaluations, enough, workers)
    return None if fit is None else evaluator.first_judged(fit)


def _final_fits(
    evaluator: Evaluator,
    fits: Sequence[CandidateFit],
    wins: Callable[[CandidateFit], bool],
    best: CandidateFit | None = None,
) -> list[CandidateFit]:
    """Return what survives of fits on all of the training records, best first.

    Where the best of them wins, one that cannot become a rival is not followed to its end, nor one
    beside a `best` of the same effect that cannot become better. Where the time is over, they are
    only judged.
    """

    def ended(fit: CandidateFit, enough: float) -> CandidateFit | None:
        if evaluator.deadline.passed:
            return evaluator.judged(fit)
        return evaluator.fit(fit, enough=enough)

    within = evaluator.policy.rival_within if best is None else 1.0
    final = evaluator.raced(ended, fits, within, best, wins)
    return ranked(evaluator, _finite(evaluator, final))


def _nearer(
    evaluator: Evaluator, before: CandidateFit, fit: CandidateFit, leader: CandidateFit
) -> CandidateFit:
    """Return a variant of the leading effect, from where the leader is if that is nearer.

    What both have, the leader has found on all samples already; what the variant has besides
    does nothing at first.
    """
    chosen = [
        each
        for each in evaluator.candidates(before)
        if (each.effect.name, each.effect.variant) == (fit.effect, fit.variant)
    ]
    neutral = chosen[0].neutral if chosen else {}
    held = fit.model.held
    shared = {k: v for k, v in leader.values.items() if k in fit.values and k not in held}
    known = {k: v for k, v in fit.values.items() if k not in shared}
    starts = (known, {k: neutral.get(k, v) for k, v in known.items()})
    moved = [replace(fit, values=start | shared, sampling_offset=leader.sampling_offset)
             for start in starts]  # fmt: skip
    judged = evaluator.map(evaluator.judged, [fit, *moved])
    return min(judged, key=lambda each: each.square)


def _finite(evaluator: Evaluator, fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    return [fit for fit in fits if evaluator.stays_finite(fit)]


def of_different_places(
    fitted: Sequence[CandidateFit], policy: SelectionPolicy
) -> list[CandidateFit]:
    """Return the best fits of different effects.

    An effect that may take the place of different blocks is as different as two effects: what a
    model has in that place already can hide it.
    """
    leading: list[CandidateFit] = []
    limit = policy.final_within * min((fit.square for fit in fitted), default=0.0)
    for fit in fitted:
        if fit.square <= limit and all(_place(fit) != _place(other) for other in leading):
            leading.append(fit)
    return leading[: policy.final_fits]


def _place(fit: CandidateFit) -> tuple[str, tuple[str, ...]]:
    """Return the effect that came last and what it took the place of."""
    effect = next(e for e in described(fit.effect) if e.variant == fit.variant)
    return fit.effect, effect.replaces


def _other_variants(
    leaders: Sequence[CandidateFit], fitted: Sequence[CandidateFit]
) -> list[CandidateFit]:
    """Return first fits of the winning effect in the variants that had no final fit yet."""
    had = {(fit.effect, fit.variant) for fit in leaders}
    return [
        f for f in fitted if f.effect == leaders[0].effect and (f.effect, f.variant) not in had
    ]
