"""Every effect against every other: screened, fitted jointly with the model, scored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from piezo_hysteresis.discovery.arena import Arena, added_of
from piezo_hysteresis.discovery.screen import Promise, Screen
from piezo_hysteresis.discovery.significance import Improvement, improvement, win_shares
from piezo_hysteresis.discovery.trial import Trial, on_views
from piezo_hysteresis.models import described

__all__ = ['Arena', 'Contest', 'compete']

Progress = Callable[[float, str], None]

# Candidates that get a first fit, and of those the effects that get a last one; every other way of
# the effect that wins gets one, too.
FIRST_FITS = 10
LAST_FITS = 4
# Starts per candidate in the first round.
STARTS = 2
FIRST_EVALUATIONS = 16
# Share of the squared residual that a candidate must promise to be fitted at all.
HOPELESS = 1e-4


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


def compete(arena: Arena, before: Trial, progress: Progress) -> Contest | None:
    """Run one round over the effects that `before` may lack; None where none can be fitted."""
    every = arena.candidates(before)
    screen = Screen(on_views(before, arena.screened), arena.screened)
    promises = arena.map(screen.promise, every)
    progress(0.2, f'{len(every)} candidates screened')
    first = arena.map(lambda p: _first_fit(arena, before, p), _chosen(promises))
    fitted = _ordered(arena, [trial for trial in first if trial is not None])
    progress(0.6, f'{len(fitted)} first fits')
    leaders = _last_fits(arena, _semifinalists(fitted))
    if not leaders:
        return None
    others = _last_fits(arena, _other_ways(leaders, fitted))
    finalists = _ordered(arena, [*leaders, *others])
    progress(1.0, f'{len(finalists)} finalists')
    penalties = [arena.penalty(trial) for trial in finalists]
    shares = win_shares(finalists, penalties, arena.edges, arena.seed)
    gain = improvement(before, finalists[0], arena.edges, len(every))
    return Contest(before, tuple(finalists), tuple(map(float, shares)), gain, len(every))


def _ordered(arena: Arena, trials: Sequence[Trial]) -> list[Trial]:
    return sorted(trials, key=lambda t: (arena.score(t), t.effect, t.variant))


def _chosen(promises: Sequence[Promise]) -> list[Promise]:
    """Return the most promising candidates, at most three ways of one effect."""
    ordered = sorted(
        promises,
        key=lambda p: (-p.explained, p.candidate.effect.name, p.candidate.effect.variant),
    )
    chosen: list[Promise] = []
    for promise in ordered:
        same = sum(c.candidate.effect.name == promise.candidate.effect.name for c in chosen)
        if same < 3 and promise.explained > HOPELESS:
            chosen.append(promise)
        if len(chosen) == FIRST_FITS:
            break
    return chosen


def _first_fit(arena: Arena, before: Trial, promise: Promise) -> Trial | None:
    """Fit from the best starts on short views and return the best.

    The baseline may have hidden the effect in wrong parameters, so one fit starts from the hints.
    """
    candidate = promise.candidate
    added = (*before.added, added_of(candidate))
    starts = list(promise.starts[:STARTS])
    own = {name: starts[0][name] for name in candidate.added}
    for hint in arena.hints:
        known = {k: hint.get(k, v) for k, v in before.values.items()}
        starts.append({**starts[0], **candidate.values(known, own)})
    found = []
    for start in starts:
        trial = arena.fit(
            Trial(candidate.model, start, (), 0, added, sampling_offset=before.sampling_offset),
            short=True,
            evaluations=FIRST_EVALUATIONS,
        )
        if trial is not None:
            found.append(trial)
    return min(found, key=lambda t: t.square, default=None)


def _last_fits(arena: Arena, trials: Sequence[Trial]) -> list[Trial]:
    """Fit on all of the training records; return what survives, best first."""
    last = arena.map(arena.fit, trials)
    return _ordered(arena, [t for t in last if t is not None and arena.stays_finite(t)])


def _semifinalists(fitted: Sequence[Trial]) -> list[Trial]:
    """Return the best fits of different effects.

    An effect that may take the place of different blocks is as different as two effects: what a
    model has in that place already can hide it.
    """
    leading: list[Trial] = []
    for trial in fitted:
        if all(_place(trial) != _place(other) for other in leading):
            leading.append(trial)
    return leading[:LAST_FITS]


def _other_ways(finalists: Sequence[Trial], fitted: Sequence[Trial]) -> list[Trial]:
    """Return first fits of the winning effect in the ways that had no last fit yet."""
    had = {(trial.effect, trial.variant) for trial in finalists}
    return [
        t for t in fitted if t.effect == finalists[0].effect and (t.effect, t.variant) not in had
    ]


def _place(trial: Trial) -> tuple[str, tuple[str, ...]]:
    """Return the effect that came last and what it took the place of."""
    effect = next(e for e in described(trial.effect) if e.variant == trial.variant)
    return trial.effect, effect.replaces
