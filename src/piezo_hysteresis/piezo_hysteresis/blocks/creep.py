"""Creep: displacement that continues to grow at constant voltage."""

from __future__ import annotations

from math import expm1, sqrt
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot, System
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import inline_jit, jit

ELEMENTS = 14  # Kelvin-Voigt elements of the logarithmic law
PER_DECADE = 2
# Time constants of the spectrum [s]: one per decade, so that their shares form any creep curve.
SPECTRUM = (0.01, 0.1, 1.0, 10.0)
_FIRST = 1.7811  # exp(Euler's constant): the bank then follows log10(1 + t/onset)


@jit
def over_onset(i: int) -> float:
    """Return the time constant of element `i` of the logarithmic law over its onset."""
    spacing: float = 10.0 ** (1.0 / PER_DECADE)
    return float(_FIRST * sqrt(spacing) * spacing**i)


# Smallest ratio of two time constants: closer elements are equivalent to one, where a fit stalls.
_APART = 3.0


@inline_jit
def element(
    x: FloatArray,
    y: FloatArray,
    state: FloatArray,
    place: int,
    share: float,
    tau: float,
    dt: float,
) -> None:
    """Add c of ``tau c' = share v - c`` to `y`, which the first element sets to v."""
    rest = -expm1(-dt / tau)
    crept = state[place]
    for k in range(x.size):
        crept += rest * (share * x[k] - crept)
        y[k] = (x[k] if place == 0 else y[k]) + crept
    state[place] = crept


def _system(shares: FloatArray, times: FloatArray) -> System:
    rates = 1.0 / times
    return System(np.diag(-rates), rates * shares, np.ones(rates.size), 1.0)


def _bank(count: int, law: Any) -> dict[str, Any]:
    """Return kernel and system of some elements; ``law(p, i)`` is share and time of each."""

    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Return ``v`` plus all elements at the end of the tick; state is their outputs [m]."""
        for i in range(count):
            share, tau = law(p, i)
            element(x, y, state, i, share, tau, dt)

    def system(p: FloatArray) -> System:
        return _system(*np.array([law(p, i) for i in range(count)]).T)

    return {'kernel': kernel, 'system': system, 'between': InterSample.LINEAR}


@inline_jit
def _single(p: FloatArray, i: int) -> tuple[float, float]:
    return p[0], p[1]


@inline_jit
def _pair(p: FloatArray, i: int) -> tuple[float, float]:
    if i == 0:
        return p[0], p[1]
    return p[2], p[1] * p[3]


@inline_jit
def _logarithmic(p: FloatArray, i: int) -> tuple[float, float]:
    return p[0] / PER_DECADE, p[1] * over_onset(i)


@jit
def spectrum_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``v`` with one element per decade; its times have no derivative."""
    for i in range(p.size):
        element(x, y, state, i, p[i], SPECTRUM[i], dt)


_ELEMENT = (
    Parameter(
        'creep_share',
        '1',
        0.0,
        -0.9,
        5.0,
        'Creep after a very long time over the displacement.',
        0.05,
    ),
    Parameter('creep_time', 's', 3.0, 1e-4, 1e6, 'Time constant of the creep.', 3.0),
)

BLOCKS = (
    Block(
        name='creep',
        slot=Slot.SLOW,
        parameters=_ELEMENT,
        **_bank(1, _single),
        description='One Kelvin-Voigt element in series.',
        source='Kelvin-Voigt creep',
    ),
    Block(
        name='creep_pair',
        slot=Slot.SLOW,
        parameters=(
            *_ELEMENT,
            Parameter(
                'slow_creep_share',
                '1',
                0.0,
                -0.9,
                5.0,
                'Creep of the second element after a very long time over the displacement.',
                0.05,
            ),
            Parameter(
                'slow_creep_ratio',
                '1',
                10.0,
                _APART,
                1e6,
                'Its time constant over creep_time.',
                10.0,
            ),
        ),
        **_bank(2, _pair),
        description='Two Kelvin-Voigt elements in series, both driven by the displacement.',
        source='Kelvin-Voigt creep',
    ),
    Block(
        name='creep_spectrum',
        slot=Slot.SLOW,
        parameters=tuple(
            Parameter(
                f'creep_share_{i}',
                '1',
                0.0,
                -0.5,
                2.0,
                f'Creep within about {tau:g} s, after a very long time over the displacement.',
                0.02,
            )
            for i, tau in enumerate(SPECTRUM)
        ),
        kernel=spectrum_kernel,
        between=InterSample.LINEAR,
        system=lambda p: _system(p, np.asarray(SPECTRUM)),
        description='Kelvin-Voigt elements, one per decade, with independent shares.',
        source='generalised Kelvin-Voigt creep: a spectrum of retardation',
    ),
    Block(
        name='logarithmic_creep',
        slot=Slot.SLOW,
        parameters=(
            Parameter(
                'creep_per_decade',
                '1',
                0.0,
                -0.1,
                1.0,
                'Creep per decade of time over the displacement.',
                0.02,
            ),
            Parameter('creep_onset', 's', 0.1, 1e-4, 1e3, 'Time at which creep sets in.', 0.1),
        ),
        **_bank(ELEMENTS, _logarithmic),
        description=(
            'Creep by creep_per_decade log10(1 + t/creep_onset) after a step, as a bank of '
            'Kelvin-Voigt elements over seven decades from the onset.'
        ),
        source='logarithmic creep law of piezoceramics',
    ),
)

EFFECTS = tuple(
    Effect(
        name='creep',
        repeatable=True,
        block=block,
        neutral=dict.fromkeys(shares, 0.0),
        starts=(dict.fromkeys(shares, 0.02), *alternatives),
        physics=(
            'Domains continue to switch under a constant field, so the displacement keeps growing '
            'after the voltage has stopped, fast at first, then more slowly.'
        ),
        experiment='Step and hold for a minute: creep is a line over the logarithm of time.',
        required_coverage=(Coverage.WIDE, Coverage.STEP),
        mistaken_for=('drift', 'amplifier_lag', 'transport_delay', 'rate_dependence'),
    )
    for block, shares, alternatives in (
        (BLOCKS[0], ('creep_share',), ({'creep_time': 0.3}, {'creep_time': 30.0})),
        (
            BLOCKS[1],
            ('creep_share', 'slow_creep_share'),
            (
                {'creep_time': 0.1, 'slow_creep_ratio': 20.0},
                {'creep_time': 1.0, 'slow_creep_ratio': 10.0},
            ),
        ),
        (BLOCKS[3], ('creep_per_decade',), ({'creep_onset': 0.01}, {'creep_onset': 1.0})),
    )
)
