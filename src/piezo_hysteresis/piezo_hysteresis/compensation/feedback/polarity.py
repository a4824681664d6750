"""Distinguishes a plant with the opposite sign from one that is driven into its limits.

Slow changes of voltage and displacement are correlated. The sign alone is no proof, because
feedback opposes disturbances. Use the result only if the loop has reached a limit.
"""

from __future__ import annotations

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import leaf

# Slower than the swings of an unstable loop about a resonance, faster than drift.
_SMOOTHING = 0.1
_MEMORY = 2.0

# Places in the memory.
_STARTED, _SLOW_V, _SLOW_Y, _FIRST_V, _FIRST_Y, _PRODUCT = range(6)
POLARITY_SIZE = 6


@leaf
def see(voltage: float, displacement: float, memory: FloatArray, dt: float) -> None:
    """Take the voltage [V] and the displacement [m] of one tick."""
    share, decay = min(1.0, dt / _SMOOTHING), min(1.0, dt / _MEMORY)
    if memory[_STARTED] == 0.0:
        memory[_STARTED] = 1.0
        memory[_SLOW_V] = memory[_FIRST_V] = voltage
        memory[_SLOW_Y] = memory[_FIRST_Y] = displacement
    memory[_SLOW_V] += share * (voltage - memory[_SLOW_V])
    memory[_SLOW_Y] += share * (displacement - memory[_SLOW_Y])
    product = (memory[_SLOW_V] - memory[_FIRST_V]) * (memory[_SLOW_Y] - memory[_FIRST_Y])
    memory[_PRODUCT] += decay * (product - memory[_PRODUCT])


@leaf
def inverted(memory: FloatArray) -> bool:
    """Return whether displacement and voltage, relative to the start, are anticorrelated."""
    return bool(memory[_PRODUCT] < 0.0)
