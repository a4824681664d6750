"""The plant as a harmonic sees it: complex gain from the voltage to the displacement."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

LinearGain = Callable[[float], complex]
"""Answers the gain [m/V] at a frequency [Hz]; negative frequencies give the conjugate."""


@dataclass(frozen=True)
class ModeGain:
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

    def __call__(self, frequency: float) -> complex:
        """Answer the gain [m/V] at `frequency` [Hz]."""
        answer = complex(self.gain)
        if self.natural_frequency > 0:
            ratio = frequency / self.natural_frequency
            answer /= 1.0 - ratio**2 + 2j * self.damping_ratio * ratio
        lag = 2j * math.pi * frequency * (0.5 * self.dt + self.delay)
        return answer * cmath.exp(-lag)


@dataclass(frozen=True)
class ArGain:
    """The linear part of the extended model, Fujii 2018 (3): third-order all-pole recursion.

    Attributes
    ----------
    gain : float
        A1 - A, the slope where h is 0 [m/V].
    c1, c2 : float
        Coefficients of the recursion; the first one is 1.
    dt : float
        Sampling interval [s].
    """

    gain: float
    c1: float
    c2: float
    dt: float

    def __call__(self, frequency: float) -> complex:
        """Answer the gain [m/V] at `frequency` [Hz]."""
        z = cmath.exp(-2j * math.pi * frequency * self.dt)
        return self.gain / (1.0 - z - self.c1 * z**2 - self.c2 * z**3)


def linear_gain(parameters: Mapping[str, float], dt: float) -> LinearGain:
    """Return the gain that named parameters describe.

    Parameters
    ----------
    parameters : mapping of str to float
        ``A1``, ``A`` [m/V] with ``c1, c2`` (extended model), or with ``natural_frequency`` [Hz]
        and ``damping_ratio``, or alone; ``delay`` [s] where there is one.
    dt : float
        Sampling interval [s].
    """
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
