"""Drift of the sensor gain with time, about the zero of the sensor."""

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import solve_least_squares


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v - rate t (v - c)``; state is the number of samples so far."""
    count = state[0]
    for k in range(x.size):
        y[k] = x[k] - p[0] * count * dt * (x[k] - p[1])
        count += 1.0
    state[0] = count


def guess(seen: Residual) -> dict[str, float]:
    """Return rate and zero by regression of the residual on time and time times displacement."""
    n = seen.residual.size
    t = seen.dt * np.arange(n)
    size = max(float(np.max(np.abs(seen.simulated))), 1e-300)
    columns = np.column_stack([t * seen.simulated / size, t, np.ones(n)])
    slope, level, _ = solve_least_squares(columns, seen.residual).values
    rate = -float(slope) / size
    return {'gain_rate': rate, 'gain_centre': float(level) / rate if rate else 0.0}


BLOCK = Block(
    name='sensor_gain_drift',
    slot=Slot.SENSOR,
    parameters=(
        Parameter('gain_rate', '1/s', 0.0, -1e3, 1e3, 'Share of the gain lost per second.', 1e-3),
        Parameter('gain_centre', 'm', 0.0, -1.0, 1.0, 'Displacement that does not change.', 1e-5),
    ),
    kernel=kernel,
    state_size=1,
    between=InterSample.CLOCK,
    description='Gain that changes steadily since the start of the record, before the offset.',
    source='drift of the electronics of a sensor',
)

EFFECTS = (
    Effect(
        name='gain_decay',
        block=BLOCK,
        neutral={'gain_rate': 0.0},
        starts=({'gain_rate': 1e-3},),
        zeros=('gain_centre',),
        guess=guess,
        physics=(
            'The gain of the sensor, or of the actuator about a bias, falls or rises steadily: '
            'the amplitude changes, and one position does not.'
        ),
        experiment=(
            'Repeat the first record at the end: the amplitude has changed, the mean has not.'
        ),
        mistaken_for=('drift', 'creep'),
    ),
)
