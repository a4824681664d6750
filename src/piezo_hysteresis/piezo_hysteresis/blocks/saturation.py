"""Saturation of the amplifier voltage."""

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect, Residual
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the voltage within the range of the amplifier; no state."""
    for k in range(x.size):
        y[k] = min(max(x[k], -p[1]), p[0])


# Tested limits as shares of the largest voltage; the last one has almost no effect.
_LEVELS = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99, 0.997)

BLOCK = Block(
    name='saturation',
    slot=Slot.INPUT,
    parameters=(
        Parameter('saturation_high', 'V', 1e5, 0.0, 1e5, 'Largest voltage at the actuator.', 1.0),
        Parameter(
            'saturation_low', 'V', 1e5, 0.0, 1e5, 'Largest negative voltage at the actuator.', 1.0
        ),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Hard limits of the voltage.',
    source='output range of the amplifier',
)


def guess(seen: Residual) -> dict[str, float]:
    """Return the limit on each side beyond which the residual follows the excess voltage."""
    found = {}
    for name, side in (('saturation_high', 1.0), ('saturation_low', -1.0)):
        reached = float((side * seen.voltage).max())
        found[name] = _limit(side * seen.voltage, -side * seen.residual, reached)
    return found


def _limit(voltage: FloatArray, missing: FloatArray, reached: float) -> float:
    """Return the level whose excess explains most of the missing displacement."""
    if reached <= 0.0:
        return 1e5
    best, level = 0.0, _LEVELS[-1]
    for each in _LEVELS:
        beyond = np.maximum(voltage - each * reached, 0.0)
        inside = voltage > 0.5 * reached
        # relative to the rest of the tip, so that a refitted gain does not hide the saturation
        shape = beyond[inside] - beyond[inside].mean()
        size = float(shape @ shape)
        share = float(shape @ (missing[inside] - missing[inside].mean()))
        if size > 0.0 and share > 0.0 and share * share / size > best:
            best, level = share * share / size, each
    return level * reached


EFFECTS = (
    Effect(
        name='saturation',
        block=BLOCK,
        neutral={'saturation_high': 1e5, 'saturation_low': 1e5},
        starts=(
            {'saturation_high': 0.9, 'saturation_low': 0.9},
            {'saturation_high': 0.7, 'saturation_low': 0.7},
            {'saturation_low': 1e5},
            {'saturation_high': 1e5},
        ),
        guess=guess,
        physics='The amplifier cannot deliver more than its rails; the tips of the drive are cut.',
        experiment='An amplitude ladder: no change below a threshold, flat tips above it.',
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('stiffness', 'slew_limit', 'odd_harmonic'),
    ),
)
