"""Decision rules of the search as functions of plain numbers, independent of models and records.

The excess is the mean square above that of the noise, in units of the noise mean square. The
thresholds are those of `SelectionPolicy`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from piezo_hysteresis.discovery.selection.policy import SelectionPolicy


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
