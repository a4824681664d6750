"""Prandtl-Ishlinskii hysteresis: a weighted bank of play operators."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._plays import COUNT, bank
from piezo_hysteresis.blocks.base import Between, Block, Parameter, Slot
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer ``w0 u + sum w_j play_j(u)``; state is the outputs of the plays [V]."""
    spacing = p[0] / (COUNT + 1)
    weights = p[2:]
    for k in range(x.size):
        y[k] = p[1] * x[k] + bank(x[k], state, weights, spacing)


RANGE = Parameter(
    'pi_range',
    'V',
    1.0,
    1e-9,
    1e5,
    'Input amplitude to which the thresholds 0.1 .. 0.9 refer.',
    1.0,
    follows_range=True,
)

BLOCK = Block(
    name='prandtl_ishlinskii',
    slot=Slot.HYSTERESIS,
    parameters=(
        RANGE,
        Parameter('w0', 'm/V', 1e-4, -1e-2, 1e-2, 'Weight without threshold.', 1e-4),
        *(
            Parameter(
                f'w{j}',
                'm/V',
                4e-6,
                -1e-2,
                1e-2,
                f'Weight of the play of half width {j / (COUNT + 1):g} pi_range.',
                5e-6,
            )
            for j in range(1, COUNT + 1)
        ),
    ),
    kernel=kernel,
    state_size=COUNT,
    between=Between.PATH,
    description='Bank of play operators: rate-independent hysteresis with nonlocal memory.',
    source='reference model; 001 and 004 name it as the alternative',
)
