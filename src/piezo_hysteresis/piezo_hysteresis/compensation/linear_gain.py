"""The plant as a harmonic sees it: complex gain from the voltage to the displacement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit

# Kinds of packed gains, by their first number.
_MODE, _RECURSION, _PULSE = range(3)


class LinearGain(Protocol):
    """Answers the gain [m/V] at a frequency [Hz]; negative frequencies give the conjugate.

    Attributes
    ----------
    packed : ndarray
        The same as numbers for `gain_at`.
    """

    @property
    def packed(self) -> FloatArray:
        """Numbers that `gain_at` reads."""

    def __call__(self, frequency: float) -> complex:
        """Return the gain [m/V] at `frequency` [Hz]."""


class ModeGain(NamedTuple):
    """A gain, one lightly damped mode, a zero-order hold and a delay.

    Attributes
    ----------
    gain : float
        Quasi-static displacement per volt, averaged over the loop [m/V]; A1 - A + ... of the
        hysteresis, about stroke / voltage range.
    natural_frequency : float
        Of the mode [Hz]; 0 for none.
    damping_ratio : float
        Damping ratio of the mode.
    dt : float
        Sampling interval [s]; the hold delays by half of it.
    delay : float
        Further delay [s].
    """

    gain: float
    natural_frequency: float = 0.0
    damping_ratio: float = 1.0
    dt: float = 0.0
    delay: float = 0.0

    @property
    def packed(self) -> FloatArray:
        """Numbers that `gain_at` reads."""
        return np.array([_MODE, *self])

    def __call__(self, frequency: float) -> complex:
        """Return the gain [m/V] at `frequency` [Hz]."""
        return complex(gain_at(float(frequency), self.packed))


class ArGain(NamedTuple):
    """The linear part of the extended model, Fujii 2018 (3): third-order all-pole recursion."""

    gain: float  # A1 - A, the slope where h is 0 [m/V]
    c1: float
    c2: float
    dt: float  # sampling interval [s]

    @property
    def packed(self) -> FloatArray:
        """Numbers that `gain_at` reads."""
        return np.array([_RECURSION, *self])

    def __call__(self, frequency: float) -> complex:
        """Return the gain [m/V] at `frequency` [Hz]."""
        return complex(gain_at(float(frequency), self.packed))


class ScaledGain(NamedTuple):
    """A multiple of another gain."""

    gain: LinearGain  # the other one
    factor: float  # what it is multiplied by

    @property
    def packed(self) -> FloatArray:
        """Numbers that `gain_at` reads."""
        numbers = np.array(self.gain.packed)
        sizes = slice(2, None) if numbers[0] == _PULSE else slice(1, 2)
        numbers[sizes] *= self.factor
        return numbers

    def __call__(self, frequency: float) -> complex:
        """Return the gain [m/V] at `frequency` [Hz]."""
        return self.factor * self.gain(frequency)


@jit
def gain_at(frequency: float, packed: FloatArray) -> complex:
    """Return the gain [m/V] at `frequency` [Hz] from the numbers of a `LinearGain`."""
    kind = int(packed[0])
    if kind == _MODE:
        mode = ModeGain(packed[1], packed[2], packed[3], packed[4], packed[5])
        answer = complex(mode.gain, 0.0)
        if mode.natural_frequency > 0.0:
            ratio = frequency / mode.natural_frequency
            answer /= complex(1.0 - ratio * ratio, 2.0 * mode.damping_ratio * ratio)
        lag = 2.0 * math.pi * frequency * (0.5 * mode.dt + mode.delay)
        return answer * complex(math.cos(lag), -math.sin(lag))
    if kind == _RECURSION:
        row = ArGain(packed[1], packed[2], packed[3], packed[4])
        turn = 2.0 * math.pi * frequency * row.dt
        z = complex(math.cos(turn), -math.sin(turn))
        return complex(row.gain / (1.0 - z - row.c1 * z * z - row.c2 * z * z * z))
    # Horner's rule: a sine and a cosine per number would take as long as many ticks.
    dt, pulse = packed[1], packed[2:]
    turn = 2.0 * math.pi * frequency * dt
    z = complex(math.cos(turn), -math.sin(turn))
    total = complex(0.0, 0.0)
    for k in range(pulse.size - 1, -1, -1):
        total = total * z + pulse[k]
    return total


def packed_pulse(pulse: FloatArray, dt: float) -> FloatArray:
    """Return the numbers of a gain that is known by its response to a pulse, [m/V] per tick."""
    return np.concatenate([(_PULSE, dt), pulse])


def linear_gain(parameters: Mapping[str, float], dt: float) -> LinearGain:  # dt [s]
    """Return the gain that named parameters describe."""
    gain = parameters['A1'] - parameters.get('A', 0.0)
    if 'c1' in parameters and 'c2' in parameters:
        return ArGain(gain, parameters['c1'], parameters['c2'], dt)
    return ModeGain(
        gain,
        parameters.get('natural_frequency', 0.0),
        parameters.get('damping_ratio', 1.0),
        dt,
        parameters.get('delay', 0.0),
    )
