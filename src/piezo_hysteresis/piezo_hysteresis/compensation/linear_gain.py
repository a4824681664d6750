"""The plant as a harmonic sees it: complex gain from the voltage to the displacement."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import jit

# Kinds of packed gains, by their first number.
_MODE, _PULSE = range(2)


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


class PulseGain:
    """A gain that is known by the response to a pulse, [m/V] per tick."""

    def __init__(self, pulse: FloatArray, dt: float) -> None:  # pulse (n,); dt [s]
        self.packed = np.concatenate([(_PULSE, dt), pulse])

    def __call__(self, frequency: float) -> complex:
        """Return the gain [m/V] at `frequency` [Hz]."""
        return complex(gain_at(float(frequency), self.packed))

    def scaled(self, factor: float) -> PulseGain:
        """Return a multiple of this gain."""
        return PulseGain(self.packed[2:] * factor, self.packed[1])


#: The gain [m/V] at a frequency [Hz]; negative frequencies give the conjugate.
LinearGain: TypeAlias = ModeGain | PulseGain


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
    # Horner's rule: a sine and a cosine per number would take as long as many ticks.
    dt, pulse = packed[1], packed[2:]
    turn = 2.0 * math.pi * frequency * dt
    z = complex(math.cos(turn), -math.sin(turn))
    total = complex(0.0, 0.0)
    for k in range(pulse.size - 1, -1, -1):
        total = total * z + pulse[k]
    return total
