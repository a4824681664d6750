"""Decision rules of the search as functions of plain numbers, independent of models and records.

The excess is the mean square above that of the noise, in units of the noise mean square. The
thresholds are those of `SelectionPolicy`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.special import ndtr

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.policy import SelectionPolicy

BlockEdges = Sequence[Sequence[int]]


@dataclass(frozen=True)
class Improvement:
    """Improvement of one model over another."""

    square: float  # decrease of the weighted sum of squares [m^2]
    ratio: float  # decrease divided by its standard error
    p_value: float  # probability of such a ratio without any improvement


def block_squares(errors: Sequence[FloatArray], edges: BlockEdges) -> list[FloatArray]:
    """Return the sum of squares of every block, per view."""
    return [
        np.add.reduceat(e**2, np.asarray(marks[:-1], dtype=np.int64))
        for e, marks in zip(errors, edges, strict=True)
    ]


def improvement(before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
    """Return the improvement between two fits to the same views; `tried` models were compared.

    The difference of the two responses is deterministic; only the residual is random. The decrease
    of the sum of squares is the square of the difference plus twice its product with the residual.
    That product has the variance of a random signal with the spectrum of the residual, with the
    noise as a lower bound at each frequency, because a fit may have removed random components from
    a line. A short effect is thus as significant as a permanent one, and a residual that both
    models share is no evidence, however often it repeats (Vuong 1989, for errors with a spectrum).
    """
    variance = 0.0
    for old, new, precision, noise in zip(
        before.errors, after.errors, after.precisions, after.noises, strict=True
    ):
        left = np.maximum(np.abs(np.fft.rfft(new)) ** 2 / new.size, noise**2)
        moved = np.abs(np.fft.rfft(old - new)) ** 2 / new.size
        both_sides = np.full(left.size, 2.0)
        both_sides[0] = 1.0
        variance += 4.0 * precision**4 * float(both_sides @ (left * moved))
    square = before.square - after.square
    ratio = square / float(np.sqrt(variance)) if variance > 0.0 else 0.0
    p_value = min(1.0, float(ndtr(-ratio)) * max(tried, 1))
    return Improvement(square, ratio, p_value)


def win_shares(
    fits: Sequence[CandidateFit],
    penalties: Sequence[float],
    edges: BlockEdges,
    seed: int,
    draws: int,
) -> FloatArray:
    """Return the share of block-bootstrap resamples (Efron 1979) in which each fit is the best."""
    generator = np.random.default_rng(seed)
    squares = [block_squares(fit.weighted, edges) for fit in fits]
    sums = np.zeros((len(fits), draws))
    for view in range(len(edges)):
        rows = np.array([s[view] for s in squares])
        count = rows.shape[1]
        weights = generator.multinomial(count, np.full(count, 1.0 / count), size=draws)
        sums += rows @ weights.T
    scores = np.log(np.maximum(sums, 1e-300)) + np.asarray(penalties)[:, None]
    winners = np.argmin(scores, axis=0)
    return np.bincount(winners, minlength=len(fits)) / draws


def shows_a_gap(
    excess: float, by_record: Sequence[float], excess_deviations: Sequence[float],
    excess_deviation: float,  # [1]
    policy: SelectionPolicy,
) -> bool:  # fmt: skip
    """Return whether the residual exceeds the noise by more than a negligible amount."""
    if not excess <= policy.negligible + policy.noise_deviations * excess_deviation:
        return True
    return any(
        not each <= policy.negligible_in_record + policy.noise_deviations * chance
        for each, chance in zip(by_record, excess_deviations, strict=True)
    )


def model_discrepancy(inexactness: Sequence[float], excess_at_start: float) -> float:
    """Return the excess that the inexact laws of the accepted effects can leave."""
    return max(inexactness, default=0.0) ** 2 * max(excess_at_start, 0.0)


def explains_enough(
    before: float, after: float, discrepancy: float, policy: SelectionPolicy
) -> bool:
    """Return whether an effect that reduces the excess from `before` to `after` explains enough.

    Some effect always fits the known discrepancy of the accepted laws. The required reduction is
    therefore a share of the excess plus this discrepancy.
    """
    return before - after >= policy.min_share * before + discrepancy


def is_promising(before: float, after: float, discrepancy: float, policy: SelectionPolicy) -> bool:
    """Return whether a first fit reduces the excess enough to justify a final fit."""
    return before - after >= policy.promising * (policy.min_share * before + discrepancy)


def min_screening_score(excess: float, policy: SelectionPolicy) -> float:
    """Return the least screening score with which a candidate is fitted.

    The score is a share of the squared residual.
    """
    asked = policy.min_share * max(excess, 0.0) / (1.0 + max(excess, 0.0))
    return max(policy.min_score, policy.required_score_share * asked)


def is_significant(standard_errors: float, score_gain: float, policy: SelectionPolicy) -> bool:
    """Return whether an improvement is significant and outweighs the parameter penalty."""
    return standard_errors >= policy.min_standard_errors and score_gain > 0.0


def is_as_good(
    simpler: float, richer: float, standard_errors: float, negligible: float,
    policy: SelectionPolicy,
) -> bool:  # fmt: skip
    """Return whether a richer model is not a relevant improvement over a simpler one."""
    if simpler < negligible or standard_errors < policy.min_standard_errors:
        return True
    return simpler - richer < policy.needless_share * simpler


def is_no_worse(before: float, after: float, policy: SelectionPolicy) -> bool:
    """Return whether the error on held-out records has not increased beyond the tolerance.

    Held-out records only veto.
    """
    return after <= (1.0 + policy.worse) * before


def reduces_gap_enough(before: float, after: float, policy: SelectionPolicy) -> bool:
    """Return whether the gap has decreased by enough to report the effects."""
    old, new = (max(excess, 0.0) ** 0.5 for excess in (before, after))
    return after <= before and old - new >= policy.least_gap * old


def explained(before: float, after: float) -> float:
    """Return the removed share of the excess, 0 to 1; both gaps are in noise rms."""
    excess = before**2 - 1.0
    if not excess > 0.0:
        return 1.0
    return min(max((before**2 - after**2) / excess, 0.0), 1.0) if after < inf else 0.0


def verdict_name(named: int, left: bool) -> str:
    """Return the word of the verdict: ``named``, ``none`` or ``unknown``.

    A significant effect is named, even if a large residual remains. The word is ``none`` if the
    residual is within noise and nuisance parameters, and ``unknown`` if a residual remains and no
    effect is significant.
    """
    if named:
        return 'named'
    return 'unknown' if left else 'none'
