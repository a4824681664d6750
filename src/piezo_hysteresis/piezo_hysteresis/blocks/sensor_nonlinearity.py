"""Nonlinear sensor: polynomial of third order."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v + s2 v^2 + s3 v^3``; no state."""
    for k in range(x.size):
        y[k] = x[k] + (p[0] + p[1] * x[k]) * x[k] * x[k]


BLOCK = Block(
    name='sensor_nonlinearity',
    slot=Slot.SENSOR,
    parameters=(
        Parameter(
            'sensor_quadratic', '1/m', 0.0, -1e7, 1e7, 'Quadratic error of the reading.', 100.0
        ),
        Parameter('sensor_cubic', '1/m^2', 0.0, -1e13, 1e13, 'Cubic error of the reading.', 1e6),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Polynomial of third order in the displacement, before the offset.',
    source='calibration curve of the sensor',
)

EFFECTS = (
    Effect(
        name='sensor_nonlinearity',
        block=BLOCK,
        neutral={'sensor_quadratic': 0.0, 'sensor_cubic': 0.0},
        starts=(
            {'sensor_quadratic': 50.0, 'sensor_cubic': 0.0},
            {'sensor_quadratic': -50.0},
            {'sensor_quadratic': 0.0, 'sensor_cubic': 1e6},
            {'sensor_quadratic': 0.0, 'sensor_cubic': -1e6},
        ),
        physics=(
            'The reading is a nonlinear function of the true displacement: its harmonics '
            'follow the measured amplitude, also at resonance, and do not excite the '
            'structure.'
        ),
        experiment=(
            'Calibrate against a second sensor; or drive at half the resonance frequency, '
            'where a square law before the mode excites it and one of the sensor does not.'
        ),
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('electrostriction', 'stiffness', 'asymmetry'),
    ),
)
