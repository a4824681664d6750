"""Identification methods by name: general methods, and methods as published in the papers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.global_search import METHODS as SEARCHES
from piezo_hysteresis.identification.online import ONLINE_METHODS

GENERAL: tuple[str, ...] = ('output_error', *ONLINE_METHODS, *SEARCHES)


@dataclass(frozen=True)
class PaperMethod:
    """A method of a paper."""

    base: str  # the general method that implements it
    description: str  # one sentence
    options: Mapping[str, Any] = field(default_factory=dict)  # options set by the paper


PAPERS: dict[str, PaperMethod] = {
    'fujii2018': PaperMethod(
        'rls', 'Fujii 2018 (8)-(12), recursive least squares from P0 = I in mm.', {'variant': 'V1'}
    ),
    'tatebatake2017': PaperMethod(
        'rls', 'Tatebatake 2017 (8)-(11), its regressor as printed.', {'variant': 'V2'}
    ),
    'zhou2021': PaperMethod(
        'pso',
        'Zhou 2021: a swarm for the hysteresis at the slowest frequency, then one for the '
        'structure at '
        'the fastest.',
        {'steps': 'two', 'sampling_offset': False},
    ),
    'xiao2014': PaperMethod(
        'pso',
        'Xiao 2014: a swarm for all parameters; of an inverse from displacement to voltage, of '
        'the '
        'selector row by row.',
        {'steps': 'one', 'direct': True},
    ),
    'fang2019': PaperMethod(
        'pso_modified',
        'Fang 2019: a constricted swarm whose inertia falls, for all parameters.',
        {'steps': 'one', 'sampling_offset': False},
    ),
}

METHODS: tuple[str, ...] = (*GENERAL, *PAPERS)


def base_of(method: str) -> str:
    """Return the general method behind a name."""
    if not isinstance(method, str):
        raise IdentificationError(
            f'a method is one of {", ".join(METHODS)}, not of type {type(method).__name__}'
        )
    if method not in METHODS:
        raise IdentificationError(f'method {method!r} is unknown{choices(method, METHODS)}')
    return PAPERS[method].base if method in PAPERS else method


def options_implied_by(method: str) -> Mapping[str, Any]:
    """Return the options that a method name implies."""
    return PAPERS[method].options if method in PAPERS else {}
