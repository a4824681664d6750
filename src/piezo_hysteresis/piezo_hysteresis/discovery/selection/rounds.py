"""One selection round: all candidates are screened, the best are fitted jointly and ranked."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from math import inf

from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    effect_of,
    is_another_change,
)
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.policy import SelectionPolicy
from piezo_hysteresis.discovery.selection.rules import Improvement
from piezo_hysteresis.discovery.selection.screen import Screen, ScreeningScore
from piezo_hysteresis.models import PARAMETER_SHIFT, Candidate, described


def refined_candidates(evaluator: Evaluator, before: CandidateFit) -> tuple[Candidate, ...]:
    """Return the model extended by each candidate, without simpler variants of its effects.

    A second channel of the records excludes a curve of the sensor, or what resembles it.
    """
    return tuple(
        each
        for each in evaluator.candidates(before)
        if not _is_had(each, before) and not evaluator.excludes(each.effect.name, before)
    )


def _is_had(candidate: Candidate, before: ModelSpec) -> bool:
    """Return whether the model already has a refined variant of the candidate."""
    return any(
        effect.refines == candidate.effect.variant
        for added in before.added
        if added.effect == candidate.effect.name
        for effect in described(added.effect)
        if effect.variant == added.variant
    )


def better_of_both(
    evaluator: Evaluator,
    before: CandidateFit,
    chosen: Sequence[ScreeningScore],
    fitted: Sequence[CandidateFit],
) -> list[CandidateFit]:
    """Return first fits, repeated from the initial values of the baseline if these fit better.

    This applies only to the first effect, because with an effect the baseline is fitted jointly.
    It does not apply to a fixed baseline.
    """
    needless = before.added or not chosen or evaluator.deadline.passed
    values = None if needless else evaluator.first_values(before)
    if values is None:
        return list(fitted)
    enough = evaluator.enough(fitted[0], evaluator.policy.final_within) if fitted else inf

    def again(score: ScreeningScore) -> CandidateFit | None:
        candidate = score.candidate
        if evaluator.deadline.skips(candidate.effect.name):
            return None
        own = {name: score.starts[0][name] for name in candidate.added}
        initial = {**score.starts[0], **candidate.values({**before.values, **values}, own)}
        spec = before.with_candidate(candidate, initial)
        # far from the minimum the first steps do not predict the final result
        near = evaluator.fit_briefly(spec, evaluator.policy.first_evaluations)
        if near is None:
            return None
        fit = evaluator.fit_briefly(near, evaluator.policy.restart_evaluations, enough)
        return evaluator.sharpened(evaluator.evaluated_for_ranking(fit or near))

    best = {(fit.effect, fit.variant): fit for fit in fitted}
    for fit in evaluator.map(again, chosen):
        if fit is None:
            continue
        known = best.get((fit.effect, fit.variant))
        if known is None or _rank(fit) < _rank(known):
            best[fit.effect, fit.variant] = fit
    return list(best.values())


def _rank(fit: CandidateFit) -> tuple[bool, float]:
    """Return what orders fits of one variant: one that describes another change is the last."""
    return is_another_change(fit), fit.square


Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class SelectionRound:
    """Result of one selection round.

    Attributes
    ----------
    before : CandidateFit
        The model without the new effect.
    finalists : tuple of CandidateFit
        Fits to all training samples, the selected one first.
    shares : tuple of float
        Probability of each finalist.
    gain : Improvement
        Improvement of the first finalist over `before`.
    tried : int
        Number of screened candidates.
    accepted : bool
        Whether the first finalist is accepted: a significant improvement that explains enough.
    leads : tuple of CandidateFit
        First fits of different effects, best first, where no finalist is accepted.
    """

    before: CandidateFit
    finalists: tuple[CandidateFit, ...]
    shares: tuple[float, ...]
    gain: Improvement
    tried: int
    accepted: bool = True
    leads: tuple[CandidateFit, ...] = ()

    @property
    def best(self) -> CandidateFit:
        """The selected finalist."""
        return self.finalists[0]

    def won_clearly(self, policy: SelectionPolicy) -> bool:
        """Return whether no finalist of another effect has a comparable sum of squares."""
        limit = policy.alternative_within * self.best.square
        return all(fit.effect == self.best.effect or fit.square > limit for fit in self.finalists)

    def lost_clearly(self, policy: SelectionPolicy) -> bool:
        """Return whether a finalist of another effect has a much smaller sum of squares."""
        others = [fit.square for fit in self.finalists if fit.effect != self.best.effect]
        return self.best.square > policy.alternative_within * min(others, default=inf)

    def probabilities(self) -> dict[str, float]:
        """Return the probability of each effect, summed over its variants, largest first."""
        found: dict[str, float] = {}
        for fit, share in zip(self.finalists, self.shares, strict=True):
            found[fit.effect] = found.get(fit.effect, 0.0) + share
        return dict(sorted(found.items(), key=lambda each: -each[1]))


def select(
    evaluator: Evaluator, before: CandidateFit, start: CandidateFit, progress: Progress
) -> SelectionRound | None:
    """Run one selection round over the candidates; return None if none can be fitted."""
    evaluator = evaluator.with_shared_starts(before)
    every = refined_candidates(evaluator, before)
    free = evaluator.free_of(before)
    screen = Screen(
        before,
        evaluator.screened,
        free,
        evaluator.workers,
        stopped=lambda: evaluator.deadline.passed,
    )
    screened = evaluator.map(lambda each: _screened(evaluator, screen, each), every)
    scores = [each for each in screened if each is not None]
    progress(0.2, f'{counted(len(every), "candidate")} screened')
    least = rules.min_screening_score(evaluator.excess(before), evaluator.policy)
    chosen = choose_trials(scores, least, evaluator.policy)
    tried = evaluator.map(lambda each: _trial(evaluator, before, each), chosen)
    progress(0.4, f'{counted(len(chosen), "candidate")} tried')
    promising = choose_first_fits(evaluator, _themselves([f for f in tried if f is not None]))
    first = evaluator.with_early_stopping(
        lambda each, enough: first_fit(evaluator, each, enough, each is promising[0]),
        promising,
        evaluator.policy.final_within,
    )
    again = better_of_both(evaluator, before, chosen, ranked(evaluator, first))
    fitted = ranked(evaluator, _themselves(again))
    progress(0.6, counted(len(fitted), 'first fit'))
    finalists = _finalists(evaluator, before, fitted, start, len(every))
    if not finalists:
        return None
    progress(1.0, f'{len(finalists)} finalists')
    found = round_of(evaluator, before, finalists, len(every), start)
    if found.accepted:
        return found
    return replace(found, leads=tuple(of_different_places(fitted, evaluator.policy)))


def fits_of(
    evaluator: Evaluator, before: CandidateFit, names: Collection[str]
) -> list[CandidateFit]:
    """Return the final fit of each named effect, of its variant with the best screening score."""
    evaluator = evaluator.with_shared_starts(before)
    free = evaluator.free_of(before)
    screen = Screen(before, evaluator.screened, free, evaluator.workers)
    best: dict[str, ScreeningScore] = {}
    for each in refined_candidates(evaluator, before):
        score = screen.score(each) if each.effect.name in names else None
        if score is None or each.effect.refines:
            continue
        known = best.get(each.effect.name)
        if known is None or score.explained > known.explained:
            best[each.effect.name] = score
    trials = evaluator.map(lambda each: _trial(evaluator, before, each), [*best.values()])
    tried = [first_fit(evaluator, fit, inf, leads=False) for fit in trials if fit is not None]
    final = [evaluator.fit(fit) for fit in tried if fit is not None]
    return _finite(evaluator, [fit for fit in final if fit is not None])


def _themselves(fits: Sequence[CandidateFit]) -> Sequence[CandidateFit]:
    """Return the fits without those that describe another change, or all if no other is left.

    Such a fit cannot win, and as the best one it would end the fits of those that can.
    """
    return [fit for fit in fits if not is_another_change(fit)] or fits


def _screened(evaluator: Evaluator, screen: Screen, candidate: Candidate) -> ScreeningScore | None:
    """Return the screening score of a candidate, None after the deadline."""
    return None if evaluator.deadline.skips(candidate.effect.name) else screen.score(candidate)


def _finalists(
    evaluator: Evaluator,
    before: CandidateFit,
    fitted: Sequence[CandidateFit],
    start: CandidateFit,
    tried: int,
) -> list[CandidateFit]:
    """Return the final fits to all samples, best first.

    If no first fit is promising, no final fit is made; the nearest first fits are returned,
    evaluated on all samples.
    """
    promising = evaluator.promising(before, fitted, start)
    if not promising:
        nearest = of_different_places(fitted, evaluator.policy)
        return ranked(evaluator, _finite(evaluator, evaluator.map(evaluator.evaluated, nearest)))

    def wins(fit: CandidateFit) -> bool:
        sufficient = evaluator.stays_finite(fit) and evaluator.explains_enough(before, fit, start)
        return sufficient and evaluator.is_significant(before, fit, tried)

    leaders = _final_fits(evaluator, of_different_places(promising, evaluator.policy), wins)
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
    """Return the round with the given finalists; the first significant one is accepted.

    Only finalists that explain enough compete. The other finalists get the share 0: they explain
    little, or they increase the error on held-out records.
    """
    enough = [evaluator.explains_enough(before, fit, start) for fit in finalists]
    sufficient = [fit for fit, large in zip(finalists, enough, strict=True) if large]
    winner = next(
        (fit for fit in sufficient if evaluator.is_significant(before, fit, tried)), None
    )
    first = winner or (sufficient or finalists)[0]
    order, shares = with_shares(evaluator, before, first, finalists, enough)
    gain = evaluator.improvement(before, first, tried)
    return SelectionRound(before, order, shares, gain, tried, winner is not None)


def with_shares(
    evaluator: Evaluator,
    before: CandidateFit,
    first: CandidateFit,
    finalists: Sequence[CandidateFit],
    enough: Sequence[bool],
) -> tuple[tuple[CandidateFit, ...], tuple[float, ...]]:
    """Return the finalists with `first` in the lead, and their shares: 0 of those too small.

    `enough` says which finalists explain enough; if none does, they compete nevertheless.
    """
    alike = not any(enough)
    rest = [(fit, ok) for fit, ok in zip(finalists, enough, strict=True) if fit is not first]
    order = (first, *(fit for fit, ok in rest if ok or alike))
    others = [fit for fit, ok in rest if not (ok or alike)]
    return (*order, *others), (*evaluator.shares(before, order), *(0.0 for _ in others))


def ranked(evaluator: Evaluator, fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Return fits sorted by their scores, best first."""
    return sorted(fits, key=lambda fit: (evaluator.score(fit), fit.effect, fit.variant))


def choose_trials(
    scores: Sequence[ScreeningScore], least: float, policy: SelectionPolicy
) -> list[ScreeningScore]:
    """Return the candidates that are tried, best scores first, limited per effect at first.

    A refined variant of an effect gets a higher score from its additional parameters alone, so it
    is never the first one of the effect.
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
    """Run a few evaluations from the best starting values and return the best of these fits.

    The score decides and not the sum of squares: a tone may explain less of a residual than its
    fundamental, and be the only new deviation.
    """
    candidate, policy = score.candidate, evaluator.policy
    if evaluator.deadline.skips(candidate.effect.name):
        return None
    best: CandidateFit | None = None
    for start in score.starts[: policy.starts]:
        spec = before.with_candidate(candidate, start)
        enough = inf if best is None else evaluator.enough(best, 1.0)
        fit = evaluator.fit_briefly(spec, policy.trial_evaluations, enough)
        if fit is not None:
            fit = evaluator.evaluated_for_ranking(fit)
            best = fit if best is None else min(best, fit, key=evaluator.score)
    return best


def choose_first_fits(evaluator: Evaluator, tried: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Return the trials with the best scores; all trials use the same samples."""
    return ranked(evaluator, tried)[: evaluator.policy.first_fits]


def first_fit(
    evaluator: Evaluator, trial: CandidateFit, enough: float, leads: bool
) -> CandidateFit | None:
    """Continue the fit of a trial on the short views.

    A time limit does not skip a leading change of the baseline. It skips a leading effect, which
    would be named without the rivals that it might lose to.
    """
    certain = leads and trial.effect == PARAMETER_SHIFT.name
    if not certain and evaluator.deadline.skips(trial.effect):
        return None
    evaluations, workers = evaluator.policy.first_evaluations, evaluator.workers
    fit = evaluator.fit_briefly(trial, evaluations, enough, workers)
    return None if fit is None else evaluator.sharpened(evaluator.evaluated_for_ranking(fit))


def _final_fits(
    evaluator: Evaluator,
    fits: Sequence[CandidateFit],
    wins: Callable[[CandidateFit], bool],
    best: CandidateFit | None = None,
) -> list[CandidateFit]:
    """Return the final fits to all training records with finite responses, best first.

    If the best fit is accepted, a fit that cannot become a rival is terminated early; so is a fit
    that cannot become better than `best`, of the same effect. After the deadline fits are only
    evaluated.
    """

    def ended(fit: CandidateFit, enough: float) -> CandidateFit | None:
        if evaluator.deadline.passed:
            return evaluator.evaluated(fit)
        return evaluator.fit(fit, enough=enough)

    within = evaluator.policy.alternative_within if best is None else 1.0
    final = evaluator.with_early_stopping(ended, fits, within, best, wins)
    return ranked(evaluator, _finite(evaluator, final))


def _nearer(
    evaluator: Evaluator, before: CandidateFit, fit: CandidateFit, leader: CandidateFit
) -> CandidateFit:
    """Return a variant of the leading effect with the better of several starting values.

    The shared parameters of the leader are already fitted to all samples; the additional
    parameters of the variant start at their neutral values.
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
    evaluated = evaluator.map(evaluator.evaluated, [fit, *moved])
    return min(evaluated, key=evaluator.score)


def _finite(evaluator: Evaluator, fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    return [fit for fit in fits if evaluator.stays_finite(fit)]


def of_different_places(
    fitted: Sequence[CandidateFit], policy: SelectionPolicy
) -> list[CandidateFit]:
    """Return the best fits of different effects.

    An effect that can replace different blocks counts as a different effect for each of them,
    because the block that remains in the chain can hide it.
    """
    leading: list[CandidateFit] = []
    limit = policy.final_within * min((fit.square for fit in fitted), default=0.0)
    for fit in fitted:
        if fit.square <= limit and all(_place(fit) != _place(other) for other in leading):
            leading.append(fit)
    return leading[: policy.final_fits]


def _place(fit: CandidateFit) -> tuple[str, tuple[str, ...]]:
    """Return the last added effect and the blocks that it replaces."""
    return fit.effect, effect_of(fit.added[-1]).replaces


def _other_variants(
    leaders: Sequence[CandidateFit], fitted: Sequence[CandidateFit]
) -> list[CandidateFit]:
    """Return first fits of the leading effect for the variants without a final fit."""
    had = {(fit.effect, fit.variant) for fit in leaders}
    return [
        f for f in fitted if f.effect == leaders[0].effect and (f.effect, f.variant) not in had
    ]
