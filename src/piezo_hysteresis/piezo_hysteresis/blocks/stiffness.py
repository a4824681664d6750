"""Nonlinear stiffness: a spring that hardens or softens with the displacement."""

from math import asin, asinh, sin, sinh, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import inline_jit, jit


@inline_jit
def bent(v: float, cubic: float) -> float:
    """Return the x nearest to 0 with ``x + cubic x^3 = v``; constant past a soft spring's fold."""
    if cubic == 0.0:
        return v
    root = sqrt(3.0 * abs(cubic))
    if cubic > 0.0:
        return 2.0 / root * sinh(asinh(1.5 * root * v) / 3.0)
    return 2.0 / root * sin(asin(min(1.0, max(-1.0, 1.5 * root * v))) / 3.0)


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the displacement at which spring and drive balance; no state."""
    for k in range(x.size):
        y[k] = bent(x[k], p[0])


BLOCK = Block(
    name='stiffness',
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter(
            'cubic_stiffness',
            '1/m^2',
            0.0,
            -1e14,
            1e14,
            'Cubic over linear stiffness; positive hardens.',
            1e6,
        ),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Static balance x + cubic_stiffness x^3 = v of a spring with a cubic term.',
    source='Duffing spring, quasi-static',
)

EFFECTS = (
    Effect(
        name='stiffness',
        block=BLOCK,
        neutral={'cubic_stiffness': 0.0},
        starts=({'cubic_stiffness': 1e6}, {'cubic_stiffness': -1e6}),
        physics=(
            'The guidance or the load is a spring whose stiffness changes with the displacement, '
            'equally in both directions.'
        ),
        experiment='An amplitude ladder: its third harmonic grows with the cube of the amplitude.',
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('hysteresis_exponent', 'saturation', 'sensor_nonlinearity', 'odd_harmonic'),
    ),
)
