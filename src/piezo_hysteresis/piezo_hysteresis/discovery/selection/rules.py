"""What decides, as functions of plain numbers: nothing here knows a model or a record.

An excess is a mean square above that of the noise, in units of it; see `SelectionPolicy` for the
numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from piezo_hysteresis.discovery.selection.policy import SelectionPolicy


def shows_a_gap(
    excess: float, by_record: Sequence[float], doubts: Sequence[float], doubt: float,
    policy: SelectionPolicy,
) -> bool:  # fmt: skip
    """Return whether a gap is above the noise by more than anybody would accept.

    Parameters
    ----------
    excess : float
        Over all records.
    by_record : sequence of float
        Of each record.
    doubts : sequence of float
        Standard deviation by which each may lie off by chance.
    doubt : float
        Standard deviation of the noise's own mean square [1].
    policy : SelectionPolicy
        What decides.
    """
    if not excess <= policy.negligible + policy.noise_doubts * doubt:
        return True
    return any(
        not each <= policy.negligible_in_record + policy.noise_doubts * chance
        for each, chance in zip(by_record, doubts, strict=True)
    )


def model_discrepancy(inexactness: Sequence[float], excess_at_start: float) -> float:
    """Return the excess that the laws of the effects so far are known to leave.

    Parameters
    ----------
    inexactness : sequence of float
        Share of each effect that its law does not describe; the largest counts.
    excess_at_start : float
        Of the baseline.
    """
    return max(inexactness, default=0.0) ** 2 * max(excess_at_start, 0.0)


def is_worth_a_name(
    before: float, after: float, discrepancy: float, policy: SelectionPolicy
) -> bool:
    """Return whether an effect that takes an excess from `before` to `after` explains enough.

    For what the laws so far are known to miss some effect always finds a use. So that much is
    asked for besides a share of the whole.
    """
    return before - after >= policy.min_share * before + discrepancy


def is_promising(before: float, after: float, discrepancy: float, policy: SelectionPolicy) -> bool:
    """Return whether a first fit explains enough that a longer one may be worth a name."""
    return before - after >= policy.promising * (policy.min_share * before + discrepancy)


def least_promise(excess: float, policy: SelectionPolicy) -> float:
    """Return the share of a squared residual that a candidate must promise to be fitted.

    Parameters
    ----------
    excess : float
        Of the model before.
    policy : SelectionPolicy
        What decides.
    """
    asked = policy.min_share * max(excess, 0.0) / (1.0 + max(excess, 0.0))
    return max(policy.min_promise, policy.promised * asked)


def is_sure(standard_errors: float, score_gain: float, policy: SelectionPolicy) -> bool:
    """Return whether an improvement is none of chance, and worth its parameters."""
    return standard_errors >= policy.min_standard_errors and score_gain > 0.0


def is_as_good(
    simpler: float, richer: float, standard_errors: float, negligible: float,
    policy: SelectionPolicy,
) -> bool:  # fmt: skip
    """Return whether a richer model is no real improvement over a simpler one.

    Parameters
    ----------
    simpler, richer : float
        Excess of both.
    standard_errors : float
        Of the improvement.
    negligible : float
        Excess that nobody would miss.
    policy : SelectionPolicy
        What decides.
    """
    if simpler < negligible or standard_errors < policy.min_standard_errors:
        return True
    return simpler - richer < policy.needless_share * simpler


def is_no_worse(before: float, after: float, policy: SelectionPolicy) -> bool:
    """Return whether an error on held-out records has not grown, chance aside.

    Held-out records can veto an effect, never propose one.
    """
    return after <= (1.0 + policy.worse) * before


def takes_its_share(before: float, after: float, policy: SelectionPolicy) -> bool:
    """Return whether a gap has fallen by enough to be a headline.

    Parameters
    ----------
    before, after : float
        On records that decided nothing, in noise rms.
    policy : SelectionPolicy
        What decides.
    """
    old, new = (max(gap**2 - 1.0, 0.0) ** 0.5 for gap in (before, after))
    return after <= before and old - new >= policy.least_gap * old


def explained(before: float, after: float) -> float:
    """Return the share of an excess that was taken, 0 to 1; both in noise rms."""
    excess = before**2 - 1.0
    if not excess > 0.0:
        return 1.0
    return min(max((before**2 - after**2) / excess, 0.0), 1.0) if after < inf else 0.0


def verdict_word(named: int, left: bool) -> str:
    """Return ``named``, ``none`` or ``unknown``.

    What proves itself is named, also where much is left; ``none`` where nothing is above noise and
    nuisances; ``unknown`` only where something is left and no effect proves itself.
    """
    if named:
        return 'named'
    return 'unknown' if left else 'none'
