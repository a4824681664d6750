"""Whether two numbers are a range of voltages: one judgement for all that take limits."""

from __future__ import annotations

from math import isfinite


def range_refusal(low: float | None, high: float | None) -> str:
    """Return '' if `low` .. `high` [V] is a range or neither is given, else the error."""
    if low is None and high is None:
        return ''
    if low is None or high is None:
        missing = 'lowest' if low is None else 'highest'
        return f'the {missing} voltage is not given: give both voltage limits, or neither'
    if not (isfinite(low) and isfinite(high)):
        return f'the voltage limits {low:g} .. {high:g} V are not finite: give two numbers in V'
    if not low < high:
        return (
            f'the voltage limits are empty: low = {low:g} V is not below high = {high:g} V; '
            'exchange or widen them'
        )
    return ''
