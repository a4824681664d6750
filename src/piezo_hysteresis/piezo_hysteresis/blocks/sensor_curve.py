"""Nonlinear sensor with its own centre, independent of the stroke."""

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
    """Return ``v + s2 d^2 + s3 d^3``, ``d = v - c``, minus its value at ``v = 0``; no state."""
    c = p[2]
    zero = (p[0] - p[1] * c) * c * c
    for k in range(x.size):
        d = x[k] - c
        y[k] = x[k] + (p[0] + p[1] * d) * d * d - zero


def guess(seen: Residual) -> list[dict[str, float]]:
    """Return the curve about the middle of the stroke that fits the residual best.

    A record at rest does not determine it.
    """
    middle = 0.5 * float(np.max(seen.simulated) + np.min(seen.simulated))
    d = seen.simulated - middle
    size = float(np.max(np.abs(d)))
    if size**3 <= 0.0:
        return []
    columns = np.column_stack([(d / size) ** 2, (d / size) ** 3, np.ones(d.size)])
    square, cube, _ = solve_least_squares(columns, seen.residual).values
    curve = {
        'curve_quadratic': float(square) / size**2,
        'curve_cubic': float(cube) / size**3,
        'curve_centre': middle,
    }
    return [curve]


BLOCK = Block(
    name='sensor_curve',
    slot=Slot.SENSOR,
    parameters=(
        Parameter(
            'curve_quadratic', '1/m', 0.0, -1e7, 1e7, 'Quadratic error about the middle.', 100.0
        ),
        Parameter('curve_cubic', '1/m^2', 0.0, -1e13, 1e13, 'Cubic error about the middle.', 1e6),
        Parameter(
            'curve_centre', 'm', 0.0, -1.0, 1.0, 'Displacement in the middle of the curve.', 1e-5
        ),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Polynomial of third order about its own middle, before the offset.',
    source='calibration curve of the sensor',
)

EFFECTS = (
    Effect(
        name='sensor_nonlinearity',
        block=BLOCK,
        neutral={'curve_quadratic': 0.0, 'curve_cubic': 0.0},
        starts=({'curve_quadratic': 50.0, 'curve_cubic': 0.0},),
        zeros=('curve_centre',),
        guess=guess,
        physics=(
            'The reading is a nonlinear function of the true displacement about the middle '
            'of the range of the sensor, which need not be the position at rest.'
        ),
        experiment=(
            'Calibrate against a second sensor; or shift the sensor relative to the '
            'actuator: a curve of the sensor moves with the sensor.'
        ),
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('electrostriction', 'stiffness', 'asymmetry'),
    ),
)
