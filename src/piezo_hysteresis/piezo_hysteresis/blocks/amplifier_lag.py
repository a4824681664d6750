"""Amplifier or sensor of limited bandwidth: a first-order lag."""

from math import exp

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot, System
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import jit

_SHORTEST = 1e-18  # s; equivalent to no lag if it is one of several poles


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the low-pass filtered held input at the end of each tick; state is the output."""
    kept = exp(-dt / p[0]) if p[0] > 0.0 else 0.0
    lagging = state[0]
    for k in range(x.size):
        lagging = x[k] + (lagging - x[k]) * kept
        y[k] = lagging
    state[0] = lagging


def system(p: FloatArray) -> System:
    """Return the low pass as a linear system."""
    rate = np.array([1.0 / max(p[0], _SHORTEST)])
    return System(-rate[:, None], rate, np.ones(1), 0.0)


def _block(name: str, parameter: str, slot: Slot, what: str, description: str) -> Block:
    return Block(
        name=name,
        slot=slot,
        parameters=(
            Parameter(
                parameter,
                's',
                0.0,
                0.0,
                10.0,
                f'Time constant; 1/(2 pi {parameter}) is {what}.',
                1e-3,
            ),
        ),
        kernel=kernel,
        description=description,
        source='first-order low pass',
        between=InterSample.LINEAR,
        system=system,
    )


BLOCKS = (
    _block(
        'amplifier_lag',
        'lag_time',
        Slot.INPUT,
        'the bandwidth',
        'Low pass of first order between the command and the actuator: output resistance into '
        'the capacitance.',
    ),
    _block(
        'sensor_lag',
        'sensor_lag_time',
        Slot.SENSOR,
        'the bandwidth of the sensor',
        'Low pass of first order between the displacement and the reading.',
    ),
)

_AMPLIFIER = 'The amplifier with the capacitance of the actuator is a low pass.'
_SENSOR = 'The electronics of the sensor are a low pass: the reading lags, the actuator does not.'

EFFECTS = tuple(
    Effect(
        name='amplifier_lag',
        block=block,
        neutral={block.parameters[0].name: 0.0},
        starts=({block.parameters[0].name: 5e-4}, {block.parameters[0].name: 5e-3}),
        physics=physics,
        experiment=(
            'Drives above 100 Hz, where a lag takes amplitude and a delay only phase; or measure '
            'the high voltage and the command.'
        ),
        required_coverage=(Coverage.FAST,),
        mistaken_for=('transport_delay', 'resonance', 'creep', 'rate_dependence'),
    )
    for block, physics in zip(BLOCKS, (_AMPLIFIER, _SENSOR), strict=True)
)
