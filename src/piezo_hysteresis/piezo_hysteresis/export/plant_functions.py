"""The free run of a model as functions of the library."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.export.compensator import NOT_FINITE
from piezo_hysteresis.export.fields import OK, UNINITIALISED, Component, Field, checking, of_model
from piezo_hysteresis.export.pieces import in_series, piece_of
from piezo_hysteresis.jit import leaf, scratch
from piezo_hysteresis.models.chain import Model

# Indices in the memory: mark of initialisation, last voltage; parameters and state
# follow.
_MARK, _VOLTAGE = range(2)
HEAD = 2

_FREQUENCY = Field(
    'drive_frequency', 'Hz', 0.0, 0.0, 1e9,
    'Fundamental of the drive, for blocks that depend on it; 0 where there is none.',
)  # fmt: skip


def plant_of(model: Model, packed: FloatArray, dt: float, mark: float) -> Component:
    """Return the free run of `model` at one sampling interval [s].

    Its ``step(s, voltage, displacement)`` returns 0, or 16 if the voltage is not finite and the
    last one is held.
    """
    whole = in_series([piece_of(stage, packed, dt) for stage in model.stages])
    fields = (_FREQUENCY, *of_model(model, packed, whole.live))
    values, states = len(fields), whole.start.size
    first = HEAD + values
    return Component(
        _stepping(whole.run, first, states, mark),
        *_changing(fields, whole.start, first, mark),
        first + states,
        fields,
        (('head', HEAD), ('parameters', values), ('memory', states)),
    )


def _stepping(
    run: Any, first: int, states: int, mark: float
) -> Callable[[FloatArray, float, FloatArray], int]:
    @leaf
    def step(s: FloatArray, voltage: float, displacement: FloatArray) -> int:
        if s[_MARK] != mark:
            displacement[0] = 0.0
            return UNINITIALISED
        code = OK
        if not np.isfinite(voltage):
            voltage, code = s[_VOLTAGE], NOT_FINITE
        s[_VOLTAGE] = voltage
        x = scratch(1)
        x[0] = voltage
        run(x, displacement, s[first : first + states], s[HEAD + 1 : first], s[HEAD])
        return code

    return step


def _changing(
    fields: tuple[Field, ...], start: FloatArray, first: int, mark: float
) -> tuple[Any, Any, Any]:
    """Return the kernels that initialise, change and reset a state."""
    check, count = checking(fields), len(fields)
    states = start.size
    rest = start if states else np.zeros(1)

    @leaf
    def change(s: FloatArray, values: FloatArray) -> int:
        if s[_MARK] != mark:
            return UNINITIALISED
        code = check(values)
        if code == OK:
            for k in range(count):
                s[HEAD + k] = values[k]
        return code

    @leaf
    def reset(s: FloatArray) -> int:
        if s[_MARK] != mark:
            return UNINITIALISED
        s[_VOLTAGE] = 0.0
        for k in range(states):
            s[first + k] = rest[k]
        return OK

    @leaf
    def begin(s: FloatArray, values: FloatArray) -> int:
        s[_MARK] = mark
        reset(s)
        code = change(s, values)
        if code != OK:
            s[_MARK] = 0.0
        return code

    return begin, change, reset
