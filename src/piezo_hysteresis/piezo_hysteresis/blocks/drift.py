"""Drift of the displacement: linear in time, or exponential after warming up."""

from math import expm1

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v + rate t``; state is the number of samples so far."""
    count = state[0]
    for k in range(x.size):
        y[k] = x[k] + p[0] * (count * dt)
        count += 1.0
    state[0] = count


@jit
def warming_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v + shift (1 - exp(-t/tau))``; state is the number of samples so far."""
    count = state[0]
    for k in range(x.size):
        y[k] = x[k] - p[0] * expm1(-count * dt / p[1])
        count += 1.0
    state[0] = count


BLOCKS = (
    Block(
        name='drift',
        slot=Slot.SLOW,
        parameters=(
            Parameter(
                'drift_rate',
                'm/s',
                0.0,
                -1e-2,
                1e-2,
                'Slope of the displacement since the start of the record.',
                1e-7,
            ),
        ),
        kernel=kernel,
        state_size=1,
        between=InterSample.CLOCK,
        description='Constant drift, independent of the drive.',
        source='thermal drift, first order in time',
    ),
    Block(
        name='warming',
        slot=Slot.SLOW,
        parameters=(
            Parameter('warming_shift', 'm', 0.0, -1.0, 1.0, 'Final shift.', 1e-6),
            Parameter('warming_time', 's', 30.0, 1e-2, 1e7, 'Time constant of the shift.', 30.0),
        ),
        kernel=warming_kernel,
        state_size=1,
        between=InterSample.CLOCK,
        description='Drift that settles, independent of the drive.',
        source='thermal expansion of the mount',
    ),
)

EFFECTS = tuple(
    Effect(
        name='drift',
        block=block,
        neutral={parameter: 0.0},
        starts=({parameter: 1e-6}, {parameter: -1e-6}),
        physics='Temperature moves the mount or the sensor electronics, independent of the drive.',
        experiment='A record at 0 V: drift continues without drive, creep and asymmetry do not.',
        required_coverage=(Coverage.REST, Coverage.STEP),
        mistaken_for=('creep', 'asymmetry', 'offset', 'gain_decay'),
    )
    for block, parameter in zip(BLOCKS, ('drift_rate', 'warming_shift'), strict=True)
)
