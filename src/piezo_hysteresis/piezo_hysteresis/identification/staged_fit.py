"""Output-error fit in stages: a chain with added tones is never worse than without them.

A harmonic or a mains hum can be fitted to an error that the rest of the chain should explain, and
the recursion of a harmonic without input has no effect. The chain is therefore fitted without the
additions first, then with the linear parameters of the additions, then with all parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.identification.inverse_fit import law_of, output_error_of_inverse
from piezo_hysteresis.identification.linear_fit import linear_parameters
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
    """Fit a chain by `output_error`, and one with additions in stages."""
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
    # the first stage may be biased by the error that the additions explain
    begin = {**found.values, SAMPLING_OFFSET: found.sampling_offset}
    return output_error(chain, records, start=start, guesses=(begin,), **options)


def _added(model: Model) -> tuple[str, ...]:
    """Return the unknowns of the blocks that add a signal to the output of the chain."""
    names = {q.name for b in model.blocks if b.slot is Slot.ADDED for q in b.parameters}
    return tuple(name for name in model.free_names if name in names)
