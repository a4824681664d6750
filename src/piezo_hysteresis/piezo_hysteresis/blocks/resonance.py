"""Mode with a share of the quasi-static displacement."""

from collections.abc import Mapping
from math import pi

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold, mode_system
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot, System
from piezo_hysteresis.blocks.effect import Coverage, Effect, Residual
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.blocks.mode import SERIES
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.harmonics import windowed

# A second mode with a share so near to 1 leaves nothing to the first one: it is the first one.
_WHOLE = 0.05

# Start frequencies of fits in samples^-1: seven octaves, six frequencies per octave.
_GRID = tuple(0.45 * 2.0 ** (-k / 6.0) for k in range(1, 43))


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``(1 - share) v + share q`` at the end of the tick; state is (q [m], q' [m/s])."""
    a11, a12, a21, a22 = hold(2.0 * pi * p[0], p[1], dt)
    b1, b2 = 1.0 - a11, -a21
    share = p[2]
    position, velocity = state[0], state[1]
    for k in range(x.size):
        moved = a11 * position + a12 * velocity + b1 * x[k]
        velocity = a21 * position + a22 * velocity + b2 * x[k]
        position = moved
        y[k] = x[k] + share * (position - x[k])
    state[0] = position
    state[1] = velocity


@jit
def pair_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``(1 - share) q1 + share q2``; state is (q1 [m], q1' [m/s], q2, q2')."""
    a11, a12, a21, a22 = hold(2.0 * pi * p[0], p[1], dt)
    b11, b12, b21, b22 = hold(2.0 * pi * p[2], p[3], dt)
    share = p[4]
    q1, v1, q2, v2 = state[0], state[1], state[2], state[3]
    for k in range(x.size):
        y[k] = q1 + share * (q2 - q1)
        away1, away2 = q1 - x[k], q2 - x[k]
        q1 = x[k] + a11 * away1 + a12 * v1
        v1 = a21 * away1 + a22 * v1
        q2 = x[k] + b11 * away2 + b12 * v2
        v2 = b21 * away2 + b22 * v2
    state[0] = q1
    state[1] = v1
    state[2] = q2
    state[3] = v2


def system(p: FloatArray) -> System:
    """Return the mode and its direct feedthrough as a linear system."""
    mode = mode_system(2.0 * pi * p[0], p[1])
    return System(mode.a, mode.b, p[2] * mode.c, 1.0 - float(p[2]))


def pair_system(p: FloatArray) -> System:
    """Return both modes as one linear system."""
    one, two = mode_system(2.0 * pi * p[0], p[1]), mode_system(2.0 * pi * p[2], p[3])
    return System(
        np.block([[one.a, np.zeros((2, 2))], [np.zeros((2, 2)), two.a]]),
        np.concatenate([one.b, two.b]),
        np.concatenate([(1.0 - p[4]) * one.c, p[4] * two.c]),
        0.0,
    )


def guess(seen: Residual) -> list[dict[str, float]]:
    """Return the frequency with the largest ratio of residual to simulation, then a grid.

    Hysteresis causes odd harmonics at all frequencies; a mode amplifies those near it. If no line
    of the drive is near the mode, the residual increases with frequency, and the grid is used. The
    share is linear, so that each frequency of the grid needs one simulation.
    """
    grid = [{'resonance_frequency': each / seen.dt, 'resonance_damping': 0.04} for each in _GRID]
    left, moved = windowed(seen.residual), windowed(seen.simulated)
    ratio = left**2 / (moved + 0.01 * moved.max() + 1e-300)
    ratio[:3] = 0.0
    place = int(np.argmax(ratio))
    if place == 0 or ratio[place] == 0.0:
        return grid
    return [{'resonance_frequency': place / (seen.residual.size * seen.dt)}, *grid]


def poles(seen: Residual) -> list[dict[str, float]]:
    """Return the mode that is equivalent to the autoregression, and faster ones."""
    c1, c2 = seen.values['c1'], seen.values['c2']
    rates = np.log(np.roots([1.0, -1.0, -c1, -c2]).astype(complex)) / seen.dt
    slowest = rates[int(np.argmin(np.abs(rates)))]
    own = float(abs(slowest)) / (2.0 * pi)
    highest = 0.45 / seen.dt
    return [
        {'resonance_frequency': min(factor * own, highest), 'resonance_damping': 0.04}
        for factor in (1.0, 1.5, 3.0)
    ]


def static_gain(values: Mapping[str, float]) -> dict[str, float]:
    """Return the gains of the hysteresis without the autoregression after it."""
    gain = -1.0 / (values['c1'] + values['c2'])
    return {name: gain * values[name] for name in ('A1', 'A', 'A0')}


_FREQUENCY = Parameter(
    'resonance_frequency', 'Hz', 100.0, 1e-2, 1e6, 'Undamped natural frequency.', 100.0
)
_DAMPING = Parameter(
    'resonance_damping',
    '1',
    0.02,
    1e-5,
    0.3,
    'Damping over critical damping; above 0.3 there is no distinct peak.',
    0.02,
)

_SHARE = Parameter(
    'resonance_share',
    '1',
    0.0,
    -2.0,
    2.0,
    'Share of the static displacement that the mode carries; 1 is a mode in series.',
    0.5,
)

_RESONANCE = Block(
    name='resonance',
    slot=Slot.STRUCTURE,
    parameters=(_FREQUENCY, _DAMPING, _SHARE),
    kernel=kernel,
    between=InterSample.LINEAR,
    system=system,
    description='A further mode that carries a share of the static displacement.',
    source='Zhou 2021 (3); Fujii 2018 where 14 and 23 Hz drives hit a mode near 68 Hz',
)

_SERIES = Block(
    name='series_mode',
    slot=Slot.STRUCTURE,
    parameters=(_FREQUENCY, _DAMPING),
    **SERIES,
    description='One mode of unit DC gain that carries the whole displacement.',
    source='Zhou 2021 (3) instead of the autoregression of Fujii 2018 (3)',
)

_PAIR = Block(
    name='mode_pair',
    slot=Slot.STRUCTURE,
    parameters=(*MODE.parameters, _FREQUENCY, _DAMPING, _SHARE),
    kernel=pair_kernel,
    between=InterSample.LINEAR,
    system=pair_system,
    description='Two parallel modes that share the static displacement.',
    source='Zhou 2021 (3), two of them driven by the same force',
)

BLOCKS = (_RESONANCE, _SERIES, _PAIR)

_EXPERIMENT = (
    'A sweep in which n times the drive passes the suspected frequency (n = 1, 3, 5, 7), or a '
    'chirp to above it.'
)
_MISTAKEN = ('odd_harmonic', 'transport_delay', 'amplifier_lag', 'rate_dependence')


def _is_no_mode(values: Mapping[str, float]) -> bool:
    """Return whether the mode does not ring, does not decay, or is the first one of the model.

    Damping on its upper bound is a lag or a delay. On its lower bound it is a tone: from an
    unknown state in each record, a mode without damping is one. A mode within half the bandwidth
    of the first one changes its phase and gain; a mode that carries the whole displacement in
    place of the first one is the first one at another frequency.
    """
    if not 1.01 * _DAMPING.low < values['resonance_damping'] < 0.99 * _DAMPING.high:
        return True
    first = values.get('natural_frequency')
    if first is None:
        return False
    if abs(values['resonance_share'] - 1.0) < _WHOLE:
        return True
    return abs(values['resonance_frequency'] - first) <= values['damping_ratio'] * first


EFFECTS = (
    Effect(
        name='resonance',
        repeatable=True,
        block=_RESONANCE,
        neutral={'resonance_share': 0.0},
        starts=(
            {'resonance_share': 1.0, 'resonance_damping': 0.02},
            *({'resonance_frequency': each} for each in (30.0, 100.0, 200.0, 400.0, 800.0)),
        ),
        guess=guess,
        absent=_is_no_mode,
        physics=(
            'A lightly damped mode of the structure rings where the drive, or one of the odd '
            'harmonics that the hysteresis generates, is near its frequency.'
        ),
        experiment=_EXPERIMENT,
        required_coverage=(Coverage.FAST, Coverage.WIDE),
        mistaken_for=_MISTAKEN,
    ),
    Effect(
        name='resonance',
        block=_SERIES,
        replaces=('autoregressive',),
        convert=static_gain,
        neutral={'resonance_frequency': 1e4, 'resonance_damping': 0.3},
        starts=({'resonance_frequency': 100.0, 'resonance_damping': 0.02},),
        guess=poles,
        absent=_is_no_mode,
        physics=(
            'The whole displacement passes a lightly damped mode. The first coefficient of the '
            'autoregression of the model is fixed, so it approximates the frequency of the mode, '
            'but not its damping and delay.'
        ),
        experiment=_EXPERIMENT,
        required_coverage=(Coverage.FAST, Coverage.WIDE),
        mistaken_for=_MISTAKEN,
    ),
    Effect(
        name='resonance',
        block=_PAIR,
        replaces=('mode',),
        neutral={'resonance_share': 0.0},
        starts=({'resonance_share': 0.1, 'resonance_damping': 0.04},),
        guess=guess,
        absent=_is_no_mode,
        physics=(
            'The same force drives a second mode of the structure in parallel; each '
            'carries a share of the displacement.'
        ),
        experiment=_EXPERIMENT,
        required_coverage=(Coverage.FAST, Coverage.WIDE),
        mistaken_for=_MISTAKEN,
    ),
)
