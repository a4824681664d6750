"""The C functions of a library: arrays as pointers, defaults as constants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import carray

from piezo_hysteresis.export.compensator import INPUT_SIZE
from piezo_hysteresis.export.fields import Component, Field
from piezo_hysteresis.export.native import Entry
from piezo_hysteresis.jit import leaf


def compensator_doors(name: str, chain: Component) -> list[Entry]:
    """Return the functions of a chain under the name of the library."""
    run, size = chain.step, chain.size

    @leaf
    def step(s: Any, x: Any, voltage: Any) -> int:
        return run(carray(s, (size,)), carray(x, (INPUT_SIZE,)), carray(voltage, (1,)))

    return [Entry(f'{name}_step', step, 'ppp'), *_common(name, chain)]


def plant_doors(name: str, plant: Component) -> list[Entry]:
    """Return the functions of a free run under the name of the library."""
    run, size = plant.step, plant.size

    @leaf
    def step(s: Any, voltage: float, displacement: Any) -> int:
        return run(carray(s, (size,)), voltage, carray(displacement, (1,)))

    return [Entry(f'{name}_step', step, 'pdp'), *_common(name, plant)]


def _common(name: str, part: Component) -> list[Entry]:
    begin, change, reset_state, size = part.begin, part.change, part.reset, part.size
    count = len(part.fields)

    @leaf
    def init(s: Any, values: Any) -> int:
        return begin(carray(s, (size,)), carray(values, (count,)))

    @leaf
    def take(s: Any, values: Any) -> int:
        return change(carray(s, (size,)), carray(values, (count,)))

    @leaf
    def reset(s: Any) -> int:
        return reset_state(carray(s, (size,)))

    return [
        Entry(f'{name}_defaults', _defaults(part.fields), 'p'),
        Entry(f'{name}_init', init, 'pp'),
        Entry(f'{name}_set', take, 'pp'),
        Entry(f'{name}_reset', reset, 'p'),
    ]


def _defaults(fields: Sequence[Field]) -> Any:
    known = np.array([field.value for field in fields])
    count = known.size

    @leaf
    def defaults(values: Any) -> int:
        place = carray(values, (count,))
        for k in range(count):
            place[k] = known[k]
        return 0

    return defaults
