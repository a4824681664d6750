"""Nonlinear sensor with different curvature on either side of its centre."""

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect, Residual
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import solve_least_squares


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v + e d^2 + o d |d|``, ``d = v - c``, minus its value at ``v = 0``; no state."""
    c = p[2]
    zero = p[0] * c * c - p[1] * c * abs(c)
    for k in range(x.size):
        d = x[k] - c
        y[k] = x[k] + p[0] * d * d + p[1] * d * abs(d) - zero


def guess(seen: Residual) -> list[dict[str, float]]:
    """Return the curve about the middle of the stroke that fits the residual best.

    A record at rest does not determine it.
    """
    middle = 0.5 * float(np.max(seen.simulated) + np.min(seen.simulated))
    d = seen.simulated - middle
    size = float(np.max(np.abs(d)))
    if size**2 <= 0.0:
        return []
    z = d / size
    columns = np.column_stack([z * z, z * np.abs(z), z, np.ones(z.size)])
    even, odd, *_ = solve_least_squares(columns, seen.residual).values
    curve = {
        'side_even': float(even) / size**2,
        'side_odd': float(odd) / size**2,
        'side_centre': middle,
    }
    return [curve]


BLOCK = Block(
    name='sensor_two_sided',
    slot=Slot.SENSOR,
    parameters=(
        Parameter('side_even', '1/m', 0.0, -1e7, 1e7, 'Mean curvature of both sides.', 100.0),
        Parameter(
            'side_odd', '1/m', 0.0, -1e7, 1e7, 'Half the difference of the curvatures.', 100.0
        ),
        Parameter('side_centre', 'm', 0.0, -1.0, 1.0, 'Displacement where both meet.', 1e-5),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='A parabola on each side of its own middle, before the offset.',
    source='calibration curve of the sensor',
)

EFFECTS = (
    Effect(
        name='sensor_nonlinearity',
        block=BLOCK,
        neutral={'side_even': 0.0, 'side_odd': 0.0},
        starts=({'side_even': 50.0, 'side_odd': 0.0}, {'side_even': 0.0, 'side_odd': 50.0}),
        zeros=('side_centre',),
        guess=guess,
        physics=(
            'The gain of the sensor changes in proportion to the distance from the middle '
            'of its range; with a cubic curve it changes mainly near the ends.'
        ),
        experiment=(
            'Calibrate against a second sensor; or shift the sensor relative to the '
            'actuator: a curve of the sensor moves with the sensor.'
        ),
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('electrostriction', 'stiffness', 'asymmetry'),
    ),
)
