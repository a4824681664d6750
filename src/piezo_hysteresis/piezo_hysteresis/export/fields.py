"""Settable fields of a C struct, with units and ranges of the parameter tables."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.compensation.inverses import hysteresis_inverse as hysteresis
from piezo_hysteresis.compensation.inverses.extended_inverse import NAMES as EXTENDED
from piezo_hysteresis.compensation.inverses.extended_inverse import ExtendedInverse
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.inverses.physical import (
    BOUC_WEN,
    FIRST,
    K1,
    K2,
    LEAD,
    MINIMUM,
    PLAYS,
    PhysicalInverse,
    monotonic_bouc_wen,
    monotonic_plays,
    saturation,
)
from piezo_hysteresis.compensation.inverses.structure_inverse import mode_coefficients
from piezo_hysteresis.jit import leaf, scratch
from piezo_hysteresis.models.chain import Model

# Return values of `set` and `init`; a rejected field is returned as REFUSED - its index.
OK, UNINITIALISED, IMPOSSIBLE, REFUSED = 0, -2, -3, -100


@dataclass(frozen=True)
class Field:
    """One field of a struct."""

    name: str  # its C name
    unit: str  # SI unit, ``1`` if there is none
    value: float  # value at export
    low: float
    high: float
    text: str  # one sentence
    above: bool = False  # whether `low` itself is out of range
    fixed: bool = False  # whether it is a constant in the code, which only a new export changes


def of_table(table: ParameterTable, name: str, value: float, c_name: str = '') -> Field:
    """Return the field of a node's parameter."""
    spec = next(spec for spec in table.specs if spec.name == name)
    above = spec.above > spec.low
    low = spec.above if above else spec.low
    return Field(
        c_name or c_identifier(name),
        spec.unit,
        float(value),
        low,
        spec.high,
        spec.description,
        above,
    )


def of_model(model: Model, packed: FloatArray, live: Sequence[int]) -> list[Field]:
    """Return the fields of a model's parameters; those that are not `live` are fixed."""
    return [
        Field(
            c_identifier(q.name), q.unit, float(value), min(q.low, float(value)),
            max(q.high, float(value)), q.description, fixed=place not in live,
        )
        for place, (q, value) in enumerate(
            zip(replace(model, held={}).parameters, packed, strict=True)
        )
    ]  # fmt: skip


def c_identifier(name: str) -> str:
    """Return a name as a C identifier."""
    return re.sub(r'\W', '_', name)


def checking(fields: Sequence[Field]) -> Callable[[FloatArray], int]:
    """Return the kernel ``check(values)``: 0, or the first rejected field."""
    count = len(fields)
    low = np.array([f.value if f.fixed else f.low for f in fields] or [0.0])
    high = np.array([f.value if f.fixed else f.high for f in fields] or [0.0])
    above = np.array([f.above and not f.fixed for f in fields] or [False])

    @leaf
    def check(values: FloatArray) -> int:
        for k in range(count):
            value = values[k]
            if not (math.isfinite(value) and value >= low[k] and value <= high[k]):
                return REFUSED - k
            if above[k] and value == low[k]:
                return REFUSED - k
        return OK

    return check


class Component(NamedTuple):
    """A state, its functions and its fields."""

    step: Callable[..., int]
    begin: Callable[[FloatArray, FloatArray], int]
    change: Callable[[FloatArray, FloatArray], int]
    reset: Callable[[FloatArray], int]  # ``reset(s)``
    size: int  # size of the state
    fields: tuple[Field, ...]  # settable fields
    rows: tuple[tuple[str, int], ...]  # sections of the state and their sizes


#: ``repack(values, p, own, first)``: fills the packed values `p` from the parameters of the model
#: and converts the memory `own` unless `first`; returns 0 or the reason of a rejection.
Repack = Callable[[FloatArray, FloatArray, FloatArray, bool], int]

_MODE, _MASS, _RIGID = range(3)


class Numbers(NamedTuple):
    """Packed values of an inverse as a function of parameters."""

    repack: Repack  # see `Repack`
    live: tuple[str, ...]  # parameters that can change; the others are constants in the code


def numbers_of(link: InverseLink, names: Sequence[str], dt: float) -> Numbers:
    """Return the packed values of `link` as a function of parameters in the order of `names`."""
    place = {name: k for k, name in enumerate(names)}
    if isinstance(link, PhysicalInverse) and link.law != 'gain':
        return _physical(link.law, place, dt)
    if isinstance(link, ExtendedInverse):
        return _extended(place)
    return Numbers(_nothing, ())


@leaf
def _nothing(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
    return OK


def _physical(law: str, place: Mapping[str, int], dt: float) -> Numbers:
    plays = law == 'plays'
    known = tuple(name for name in (PLAYS if plays else BOUC_WEN) if name in place)
    at = tuple(place.get(name, -1) for name in (PLAYS if plays else BOUC_WEN))
    delay = place.get('delay', -1)
    if 'mass' in place:
        kind, structure = _MASS, tuple(place[n] for n in ('mass', 'damping', 'stiffness'))
    elif 'natural_frequency' in place:
        kind, structure = _MODE, (place['natural_frequency'], place['damping_ratio'], 0)
    else:
        kind, structure = _RIGID, (0, 0, 0)
    count, solved, slope = len(at), law != 'delayed', 1 if plays else 0

    @leaf
    def repack(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
        new, k1, k2 = scratch(count), 0.0, 0.0
        for k in range(count):
            new[k] = values[at[k]] if at[k] >= 0 else 0.0
        if kind == _MODE:
            k1, k2 = mode_coefficients(values[structure[0]], values[structure[1]])
        elif kind == _MASS:
            stiffness = values[structure[2]]
            k1, k2 = values[structure[1]] / stiffness, values[structure[0]] / stiffness
        if not (k1 >= 0.0 and k2 >= 0.0):
            return IMPOSSIBLE
        if plays and not monotonic_plays(new):
            return IMPOSSIBLE
        if not first and new[slope] * p[FIRST + slope] < 0.0:
            return IMPOSSIBLE
        inner, shift = (new[1], new[2]) if solved else (0.0, 0.0)
        if not plays and not monotonic_bouc_wen(new[0], inner, shift):
            return IMPOSSIBLE
        if not (plays or first):
            own[hysteresis.H] *= saturation(new) / max(saturation(p[FIRST:]), 1e-300)
        lead = 0.5 * dt if k2 > 0.0 else 0.0
        p[MINIMUM] = 0.1 * abs(new[slope])
        p[K1], p[K2] = k1, k2
        p[LEAD] = lead + (values[delay] if delay >= 0 else 0.0)
        for k in range(count):
            p[FIRST + k] = new[k]
        return OK

    names = (
        'natural_frequency',
        'damping_ratio',
        'mass',
        'damping',
        'stiffness',
        'delay',
        'offset',
    )
    return Numbers(repack, (*known, *(name for name in names if name in place)))


def _extended(place: Mapping[str, int]) -> Numbers:
    at = tuple(place.get(name, -1) for name in EXTENDED)
    count = len(EXTENDED)

    @leaf
    def repack(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
        new = scratch(count)
        for k in range(count):
            new[k] = values[at[k]] if at[k] >= 0 else 0.0
        if new[0] == 0.0 or (not first and new[0] * p[0] < 0.0):
            return IMPOSSIBLE
        if not first:
            own[hysteresis.H] *= saturation(new) / max(saturation(p), 1e-300)
        for k in range(count):
            p[k] = new[k]
        p[count] = 0.1 * abs(new[0])
        return OK

    return Numbers(repack, tuple(name for name in (*EXTENDED, 'offset') if name in place))
