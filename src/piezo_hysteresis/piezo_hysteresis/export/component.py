"""What the library needs of anything that takes steps: the loop, and the model as a plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.export.fields import Field


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
