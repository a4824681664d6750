"""The numbers that a user may set, with units and ranges of the suite's tables, and of what."""

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

# Answers of `set` and `init`; a number that is refused is returned as REFUSED - its place.
OK, UNINITIALISED, IMPOSSIBLE, REFUSED = 0, -2, -3, -100


@dataclass(frozen=True)
class Field:
    """One number of a struct.

    Attributes
    ----------
    name : str
        Its C name.
    unit : str
        SI, ``1`` where there is none.
    value : float
        What it is set to at export.
    low, high : float
        Range; infinite where there is no bound.
    text : str
        One sentence.
    above : bool
        Whether `low` itself is out of range.
    fixed : bool
        Whether it is worked into the code, so that only a new export changes it.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    text: str
    above: bool = False
    fixed: bool = False


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
    """Return a name as C takes it."""
    return re.sub(r'\W', '_', name)


def checking(fields: Sequence[Field]) -> Callable[[FloatArray], int]:
    """Return the kernel ``check(values)``: 0, or which number is refused first."""
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
    """A state, its functions and its fields.

    Attributes
    ----------
    step : callable
        One tick: ``step(s, x, voltage)`` of a loop, ``step(s, voltage, displacement)`` of a plant;
        answers bits, see the module that makes it.
    begin, change : callable
        ``begin(s, values)`` and ``change(s, values)``: 0, or why not.
    reset : callable
        ``reset(s)``.
    size : int
        Numbers in the state.
    fields : tuple of Field
        What may be set.
    rows : tuple of (str, int)
        Sections of the state and their sizes.
    """

    step: Callable[..., int]
    begin: Callable[[FloatArray, FloatArray], int]
    change: Callable[[FloatArray, FloatArray], int]
    reset: Callable[[FloatArray], int]
    size: int
    fields: tuple[Field, ...]
    rows: tuple[tuple[str, int], ...]
