"""Options of each method, in addition to records, model, seed and workers."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from functools import cache

from piezo_hysteresis.common.wording import near
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.methods import base_of
from piezo_hysteresis.identification.output_error import output_error
from piezo_hysteresis.identification.swarm import identify_by_search

_COMMON = {'model', 'records', 'method', 'seed', 'workers', 'progress'}
_ONLINE = {
    'rls': ('forgetting', 'variant', 'offset', 'unit', 'p0', 'start', 'sampling_offset'),
    'rls_ud': ('forgetting', 'start', 'sampling_offset'),
    'pi_bank': ('forgetting', 'start', 'sampling_offset'),
}


@cache
def options_of(method: str) -> tuple[str, ...]:
    """Return the names of the options of a method."""
    base = base_of(method)
    if base in _ONLINE:
        return _ONLINE[base]
    function = output_error if base == 'output_error' else identify_by_search
    return tuple(name for name in inspect.signature(function).parameters if name not in _COMMON)


def require_options(method: str, names: Iterable[str]) -> None:
    """Raise an error for options that a method does not have."""
    known = options_of(method)
    for name in names:
        if name not in known:
            raise IdentificationError(
                f'{method} has no option {name}{near(name, known)}; it has {", ".join(known)}'
            )
