"""A bank of plays before the hysteresis: memory of more than the last reversal."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._plays import COUNT, play
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer ``u + sum m_j (play_j(u) - u)``; state is the outputs of the plays [V]."""
    spacing = p[0] / (COUNT + 1)
    for k in range(x.size):
        total = x[k]
        for j in range(COUNT):
            state[j] = play(x[k], state[j], (j + 1) * spacing)
            total += p[j + 1] * (state[j] - x[k])
        y[k] = total


BLOCK = Block(
    name='nonlocal_memory',
    slot=Slot.HYSTERESIS,
    parameters=(
        Parameter(
            'memory_range',
            'V',
            1.0,
            1e-9,
            1e5,
            'Input amplitude to which the thresholds 0.1 .. 0.9 refer.',
            1.0,
            follows_range=True,
        ),
        *(
            Parameter(
                f'memory{j}',
                '1',
                0.0,
                -2.0,
                2.0,
                f'Share of the voltage behind a play of half width {j / (COUNT + 1):g} '
                'memory_range.',
                0.05,
            )
            for j in range(1, COUNT + 1)
        ),
    ),
    kernel=kernel,
    state_size=COUNT,
    description='Bank of play operators in series before the hysteresis of the model.',
    source='Prandtl-Ishlinskii bank as a correction of Bouc-Wen; EQUATIONS F',
)

EFFECTS = (
    Effect(
        name='nonlocal_memory',
        variant='nonlocal_memory',
        block=BLOCK,
        first=True,
        requires=(
            'bouc_wen',
            'bouc_wen_exact',
            'bouc_wen_power',
            'bouc_wen_power_euler',
            'bouc_wen_rate',
            'bouc_wen_rate_euler',
            'bouc_wen_modified',
        ),
        holds={'memory_range': 1.0},
        neutral={f'memory{j}': 0.0 for j in range(1, COUNT + 1)},
        start={f'memory{j}': 0.01 for j in range(1, COUNT + 1)},
        physics=(
            'The ceramic remembers every reversal that a larger one has not wiped out; Bouc-Wen '
            'remembers one number. Inner loops therefore close in the actuator and not in the '
            'model.'
        ),
        experiment=(
            'First-order reversal curves: triangles with decreasing amplitude and nested loops.'
        ),
        mistaken_for=('hysteresis_exponent', 'friction', 'stiffness'),
    ),
)
