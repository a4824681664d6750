"""What is not known of a measured input."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray


@dataclass(frozen=True)
class InputUncertainty:
    """Error that a measured input still has: harmonics of the drive, and the rest."""

    rms: float  # error of one sample [V or N]
    colour: float = 0.0  # correlation of the rest from one sample to the next
    period: float = 0.0  # samples per period of the drive; 0 if it has none
    orders: tuple[int, ...] = ()  # orders of the harmonics that were estimated
    term: float = 0.0  # rms error of the constant [V or N]

    @property
    def rest(self) -> float:
        """Rms error of one sample without the harmonics [V or N]."""
        terms = 1 + 2 * len(self.orders)
        return sqrt(max(self.rms**2 - terms * self.term**2, 0.0))

    def draw(self, samples: int, repeats: int, generator: np.random.Generator) -> FloatArray:
        """Return such an error in the mean of so many periods, shape (samples,) [V or N]."""
        from scipy.signal import lfilter  # imports more than all the rest together

        white = generator.standard_normal(samples) * sqrt((1.0 - self.colour**2) / repeats)
        error = self.rest * lfilter([1.0], [1.0, -self.colour], white)
        error += self.term * generator.standard_normal()
        for order in self.orders:
            turn = 2.0 * np.pi / self.period * np.arange(samples)
            cosine, sine = sqrt(2.0) * self.term * generator.standard_normal(2)
            error += cosine * np.cos(order * turn) + sine * np.sin(order * turn)
        return np.asarray(error)
