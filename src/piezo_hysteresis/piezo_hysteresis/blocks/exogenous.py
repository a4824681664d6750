"""Third and fifth harmonic of the papers: a recursion driven by sines locked to the drive."""

from collections.abc import Mapping

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._harmonics import add_recursion
from piezo_hysteresis.blocks.autoregressive import unstable
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.jit import jit


@jit
def kernel3(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Add y3; see `add_recursion` for the state."""
    add_recursion(x, y, state, p, dt, frequency, 3)


@jit
def kernel5(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Add y5; see `add_recursion` for the state."""
    add_recursion(x, y, state, p, dt, frequency, 5)


def check3(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the recursion is unstable."""
    return unstable(values['c3'], values['c4'], 'c3, c4')


def check5(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the recursion is unstable."""
    return unstable(values['c5'], values['c6'], 'c5, c6')


def _parameters(order: int, names: tuple[str, str, str, str]) -> tuple[Parameter, ...]:
    ca, cb, sine, cosine = names
    return (
        Parameter(ca, '1', -0.1, -3.0, 3.0, f'Weight of y{order} two samples ago.', 0.5),
        Parameter(cb, '1', -0.1, -2.0, 1.0, f'Weight of y{order} three samples ago.', 0.5),
        Parameter(
            sine, 'm', 0.0, -1.0, 1.0, f'Sine input at {order} times the drive frequency.', 1e-6
        ),
        Parameter(
            cosine,
            'm',
            0.0,
            -1.0,
            1.0,
            f'Cosine input at {order} times the drive frequency.',
            1e-6,
        ),
    )


BLOCKS = (
    Block(
        name='exogenous3',
        slot=Slot.ADDED,
        parameters=_parameters(3, ('c3', 'c4', 'al1', 'al2')),
        kernel=kernel3,
        state_size=5,
        description=(
            'Third harmonic by the printed recursion; in steady state one record determines two '
            'of its four parameters.'
        ),
        source='Fujii 2018 (4), (6)',
        check=check3,
    ),
    Block(
        name='exogenous5',
        slot=Slot.ADDED,
        parameters=_parameters(5, ('c5', 'c6', 'al3', 'al4')),
        kernel=kernel5,
        state_size=5,
        description=(
            'Fifth harmonic by the printed recursion; in steady state one record determines two '
            'of its four parameters.'
        ),
        source='Fujii 2018 (5), (7)',
        check=check5,
    ),
)
