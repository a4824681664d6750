"""Third and fifth harmonic of the drive: sines locked to it, and the recursion of the papers."""

from collections.abc import Mapping
from math import cos, pi, sin

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.autoregressive import unstable
from piezo_hysteresis.blocks.base import Block, Kernel, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


def _sine(order: int) -> Kernel:
    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Add a harmonic of the drive; state is (time of the first sample [s], cycles since)."""
        sine, cosine = p[0], p[1]
        cycles_before, cycles = state[0] * frequency, state[1]
        step = frequency * dt
        on = 1.0 if step > 0.0 else 0.0
        for k in range(x.size):
            angle = 2.0 * pi * order * (cycles_before + cycles)
            y[k] = x[k] + on * (sine * sin(angle) + cosine * cos(angle))
            cycles += step
            cycles -= int(cycles)
        state[1] = cycles

    return kernel


def _recursion(order: int) -> Kernel:
    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Add ``yn[k] = yn[k-1] + ca yn[k-2] + cb yn[k-3] + al_a sin + al_b cos``.

        State is (time of the first sample [s], cycles since, the last three yn [m]).
        """
        cycles_before, cycles = state[0] * frequency, state[1]
        y1, y2, y3 = state[2], state[3], state[4]
        step = frequency * dt
        on = 1.0 if step > 0.0 else 0.0
        for k in range(x.size):
            angle = 2.0 * pi * order * (cycles_before + cycles)
            new = y1 + p[0] * y2 + p[1] * y3 + on * (p[2] * sin(angle) + p[3] * cos(angle))
            y3 = y2
            y2 = y1
            y1 = new
            y[k] = x[k] + new
            cycles += step
            cycles -= int(cycles)
        state[1] = cycles
        state[2] = y1
        state[3] = y2
        state[4] = y3

    return kernel


def _exogenous(order: int, word: str, names: tuple[str, str, str, str], source: str) -> Block:
    """Return the harmonic of an order by the recursion of the papers."""
    ca, cb, sine, cosine = names
    at = f'input at {order} times the drive frequency.'

    def check(values: Mapping[str, float]) -> str:
        return unstable(values[ca], values[cb], f'{ca}, {cb}')

    return Block(
        name=f'exogenous{order}',
        slot=Slot.ADDED,
        parameters=(
            Parameter(ca, '1', -0.1, -3.0, 3.0, f'Weight of y{order} two samples ago.', 0.5),
            Parameter(cb, '1', -0.1, -2.0, 1.0, f'Weight of y{order} three samples ago.', 0.5),
            Parameter(sine, 'm', 0.0, -1.0, 1.0, f'Sine {at}', 1e-6),
            Parameter(cosine, 'm', 0.0, -1.0, 1.0, f'Cosine {at}', 1e-6),
        ),
        kernel=_recursion(order),
        state_size=5,
        description=(
            f'{word} harmonic by the printed recursion; in steady state one record determines two '
            'of its four parameters.'
        ),
        source=source,
        check=check,
    )


EXOGENOUS = (
    _exogenous(3, 'Third', ('c3', 'c4', 'al1', 'al2'), 'Fujii 2018 (4), (6)'),
    _exogenous(5, 'Fifth', ('c5', 'c6', 'al3', 'al4'), 'Fujii 2018 (5), (7)'),
)

HARMONICS = tuple(
    Block(
        name=f'harmonic{order}',
        slot=Slot.ADDED,
        parameters=tuple(
            Parameter(
                f'{kind}{order}',
                'm',
                0.0,
                -1.0,
                1.0,
                f'{kind.capitalize()} amplitude at {order} times the drive frequency.',
                1e-6,
            )
            for kind in ('sine', 'cosine')
        ),
        kernel=_sine(order),
        state_size=2,
        description=(
            f'Harmonic of order {order} with the phase of the drive; nothing where the drive has '
            'no fundamental frequency.'
        ),
        source=f'Fujii 2018 ({each}) without coefficients undetermined in steady state',
    )
    for order, each in ((3, 6), (5, 7))
)

BLOCKS = (*EXOGENOUS, *HARMONICS)

EFFECTS = tuple(
    Effect(
        name='odd_harmonic',
        block=block,
        neutral={parameter.name: 0.0 for parameter in block.parameters},
        starts=({parameter.name: 1e-6 for parameter in block.parameters},),
        physics=(
            'An oscillation at an odd multiple of the drive that the model does not produce. '
            'The papers describe it by exogenous sines; usually a harmonic excites a mode.'
        ),
        experiment=(
            'Neighbouring drive frequencies and a second amplitude: a mode makes the harmonic '
            'peak where n f meets its frequency, a fixed sine stays.'
        ),
        mistaken_for=('resonance', 'stiffness', 'saturation', 'hysteresis_exponent'),
    )
    for block in HARMONICS
)
