"""Settable fields of a C struct, with units and ranges of the parameter tables."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.jit import leaf
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
