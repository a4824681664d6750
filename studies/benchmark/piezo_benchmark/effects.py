"""The list of possible effects: names, equations, units, sizes that are drawn, starts of a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from piezo_benchmark.worlds import Scale

Parameters = dict[str, float]


@dataclass(frozen=True)
class Effect:
    """One effect of the list.

    Attributes
    ----------
    equation : str
        In plain text; U is the range [V], Y the stroke [m], T the duration of a record [s].
    units : dict of str to str
        Unit of each parameter.
    size : str
        The parameter to which the effect is about proportional.
    draw : callable
        Draws the parameters, with a size of middle strength.
    most : float
        Largest size.
    starts : callable
        Parameters from which a fit can begin.
    """

    equation: str
    units: dict[str, str]
    size: str
    draw: Callable[[Generator, Scale], Parameters]
    most: Callable[[Scale], float]
    starts: Callable[[Scale], list[Parameters]]


def between(random: Generator, low: float, high: float) -> float:
    """Return a number between two, equal in the logarithm."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _sensor(random: Generator) -> Parameters:
    even = random.random() < 0.5
    return {'even': 0.05 if even else 0.0, 'odd': 0.0 if even else 0.05}


def _tone(random: Generator, scale: Scale) -> Parameters:
    phase = random.uniform(0, 2 * np.pi)
    frequency = between(random, 12.0, 0.2 / scale.dt)
    return {'sine': 0.01 * np.cos(phase), 'cosine': 0.01 * np.sin(phase), 'frequency': frequency}


def _grid(low: float, high: float, count: int) -> list[float]:
    return [float(x) for x in np.geomspace(low, high, count)]


EFFECTS: dict[str, Effect] = {
    'transport_delay': Effect(
        'y(t) = x(t - delay)',
        {'delay': 's'},
        'delay',
        lambda r, s: {'delay': int(r.integers(3, 13)) * s.dt},
        lambda s: 12 * s.dt,
        lambda s: [{'delay': k * s.dt} for k in (3, 6, 10)],
    ),
    'amplifier_lag': Effect(
        "lag_time v' + v = u; v drives the hysteresis in place of u",
        {'lag_time': 's'},
        'lag_time',
        lambda r, s: {'lag_time': 3 * s.dt},
        lambda s: 12 * s.dt,
        lambda s: [{'lag_time': k * s.dt} for k in (1.0, 3.0, 8.0)],
    ),
    'creep': Effect(
        "y = x + c; time c' + c = share x",
        {'share': '1', 'time': 's'},
        'share',
        lambda r, s: {'share': 0.05, 'time': between(r, 0.05, 0.5) * s.span},
        lambda s: 0.5,
        lambda s: [{'share': 0.05, 'time': k * s.span} for k in (0.04, 0.12, 0.35)],
    ),
    'mode': Effect(
        "y = (1 - share) x + share z; z''/w^2 + 2 damping z'/w + z = x; w = 2 pi frequency",
        {'share': '1', 'frequency': 'Hz', 'damping': '1'},
        'share',
        lambda r, s: {
            'share': 0.1,
            'frequency': between(r, 0.06, 0.25) / s.dt,
            'damping': between(r, 0.01, 0.05),
        },
        lambda s: 0.6,
        lambda s: [
            {'share': 0.1, 'frequency': f / s.dt, 'damping': 0.03} for f in _grid(0.05, 0.3, 14)
        ],
    ),
    'square_law': Effect(
        'y = x + square Y (u/U)^2, in parallel with the hysteresis',
        {'square': '1'},
        'square',
        lambda r, s: {'square': 0.05 * float(r.choice([-1, 1]))},
        lambda s: 0.5,
        lambda s: [{'square': 0.03}],
    ),
    'saturation': Effect(
        'v = U tanh(bend u/U)/bend; v drives the hysteresis in place of u',
        {'bend': '1'},
        'bend',
        lambda r, s: {'bend': 0.4},
        lambda s: 1.5,
        lambda s: [{'bend': 0.3}, {'bend': 0.8}],
    ),
    'sensor_curve': Effect(
        'y = x + (even x^2 + odd x |x|)/Y',
        {'even': '1', 'odd': '1'},
        '',
        lambda r, s: _sensor(r),
        lambda s: 0.5,
        lambda s: [{'even': 0.03, 'odd': 0.0}, {'even': 0.0, 'odd': 0.03}],
    ),
    'tone': Effect(
        'y = x + Y (sine sin(2 pi frequency t) + cosine cos(2 pi frequency t))',
        {'sine': '1', 'cosine': '1', 'frequency': 'Hz'},
        '',
        _tone,
        lambda s: 0.2,
        lambda s: [],
    ),
    'drift': Effect(
        'y = x + drift Y t/T, t from the beginning of each record',
        {'drift': '1'},
        'drift',
        lambda r, s: {'drift': 0.05 * float(r.choice([-1, 1]))},
        lambda s: 1.0,
        lambda s: [{'drift': 0.05}],
    ),
    'falling_gain': Effect(
        'y = x (1 - loss t/T), t from the beginning of each record',
        {'loss': '1'},
        'loss',
        lambda r, s: {'loss': 0.05},
        lambda s: 0.6,
        lambda s: [{'loss': 0.05}],
    ),
    'friction': Effect(
        'y = play of x with the half-width width Y, before a mode',
        {'width': '1'},
        'width',
        lambda r, s: {'width': 0.02},
        lambda s: 0.2,
        lambda s: [{'width': 0.005}, {'width': 0.03}],
    ),
}

#: Effects that are not on the list: the right answer is `unknown`.
OUTSIDE: dict[str, tuple[str, Callable[[Generator, Scale], Parameters], float]] = {
    'dead_band': ('width', lambda r, s: {'width': 0.05}, 0.3),
    'heating': ('share', lambda r, s: {'share': 0.1, 'time': between(r, 0.1, 0.4) * s.span}, 0.6),
    'sensor_steps': ('height', lambda r, s: {'height': 0.01, 'every': s.span / 5.7}, 0.2),
    'slew_limit': ('rate', lambda r, s: {'rate': 0.03 / s.dt}, 1e9),
}


def scaled(name: str, parameters: Parameters, factor: float) -> Parameters:
    """Return the parameters of an effect that is so many times as strong."""
    changed = dict(parameters)
    own = EFFECTS[name].size if name in EFFECTS else OUTSIDE[name][0]
    twice = {'sensor_curve': ('even', 'odd'), 'tone': ('sine', 'cosine')}
    sizes: tuple[str, ...] = twice.get(name, (own,))
    for size in sizes:
        changed[size] *= 1.0 / factor if name == 'slew_limit' else factor
    return changed


def strength(name: str, parameters: Parameters) -> float:
    """Return the size of an effect, in the unit of its largest one."""
    if name == 'sensor_curve':
        return abs(parameters['even']) + abs(parameters['odd'])
    if name == 'tone':
        return float(np.hypot(parameters['sine'], parameters['cosine']))
    return abs(parameters[EFFECTS[name].size if name in EFFECTS else OUTSIDE[name][0]])
