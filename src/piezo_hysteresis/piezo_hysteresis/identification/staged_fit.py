"""Output error in stages: a chain is never worse than what is left of it without its additions.

A harmonic or a hum that is added to a chain can be fitted in the place of what the chain should
explain, and the recursion of a harmonic that has no input yet does nothing at all. So the chain is
fitted without its additions first, then with what is added linearly, then with everything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.identification.inverse_fit import law_of, output_error_of_inverse
from piezo_hysteresis.identification.linear import linear_parameters
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.output_error import output_error, suited
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record


def output_error_in_stages(
    model: Model,
    records: Sequence[Record],
    *,
    start: Mapping[str, float] | None = None,
    **options: Any,
) -> FitResult:
    """Fit a chain by `output_error`, and one with additions in stages.

    Parameters
    ----------
    model, records, start, **options
        See `output_error`; a start for an addition is taken as it is, without stages.

    Returns
    -------
    FitResult
        Of the last stage, with all unknowns of the chain.
    """
    if law_of(model):
        return output_error_of_inverse(model, records, start=start, **options)
    added = _added(model)
    known = set(start or {})
    without = tuple(name for name in model.free_names if name not in added)
    if not added or known & set(added) or not without:
        return output_error(model, records, start=start, **options)
    chain = suited(model, records)
    reach = max(float(abs(record.voltage).max()) for record in records)
    linear = set(linear_parameters(chain, added, reach))
    found = output_error(chain, records, start=start, free=without, **options)
    begin = {**found.values, SAMPLING_OFFSET: found.sampling_offset}
    names = tuple(n for n in model.free_names if n not in set(added) - linear)
    found = output_error(chain, records, start=begin, free=names, count=1, **options)
    # what the additions leave unexplained at first may have led the first stage astray
    begin = {**found.values, SAMPLING_OFFSET: found.sampling_offset}
    return output_error(chain, records, start=start, guesses=(begin,), **options)


def _added(model: Model) -> tuple[str, ...]:
    """Return the unknowns of the blocks that add to what the chain answers."""
    names = {q.name for b in model.blocks if b.slot is Slot.ADDED for q in b.parameters}
    return tuple(name for name in model.free_names if name in names)
