"""A spring that hardens or softens with the displacement."""

from math import asin, asinh, inf, sin, sinh, sqrt

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.blocks.base import Between, Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit


@jit
def bent(v: float, cubic: float) -> float:
    """Return the x nearest to 0 with ``x + cubic x^3 = v``; held at the fold of a soft spring."""
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


@jit
def carry(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, state: FloatArray,
    moved: FloatArray, p: FloatArray, wanted: IntArray, dt: float, points: int,
) -> None:  # fmt: skip
    """Carry derivatives along, see `Block.carry`; beyond the fold nothing moves with the input."""
    m = dx.shape[0]
    folds = inf if p[0] >= 0.0 else 2.0 / 3.0 / sqrt(-3.0 * p[0])
    for k in range(x.size):
        y[k] = bent(x[k], p[0])
        slope = 1.0 / (1.0 + 3.0 * p[0] * y[k] * y[k]) if abs(x[k]) < folds else 0.0
        for j in range(m):
            dy[j, k] = slope * dx[j, k]
        for j in range(m, dy.shape[0]):
            dy[j, k] = -(y[k] ** 3) * slope if slope > 0.0 else -0.5 * y[k] / p[0]


BLOCK = Block(
    name='stiffness',
    carry=carry,
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
    state_size=0,
    between=Between.INSTANT,
    description='Static balance x + cubic_stiffness x^3 = v of a spring with a cubic term.',
    source='Duffing spring, quasi-static',
)

EFFECTS = (
    Effect(
        name='stiffness',
        variant='stiffness',
        block=BLOCK,
        neutral={'cubic_stiffness': 0.0},
        start={'cubic_stiffness': 1e6},
        alternatives=({'cubic_stiffness': -1e6},),
        physics=(
            'The guidance or the load is a spring whose stiffness changes with the displacement, '
            'alike in both directions.'
        ),
        experiment='An amplitude ladder: its third harmonic grows with the cube of the amplitude.',
        told_by=(Coverage.LADDER,),
        mistaken_for=('hysteresis_exponent', 'saturation', 'sensor_nonlinearity', 'odd_harmonic'),
    ),
)
