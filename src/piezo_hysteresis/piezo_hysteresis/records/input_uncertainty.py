"""What is not known of a measured input."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray


@dataclass(frozen=True)
class InputUncertainty:
    """Error that a measured input still has: harmonics of the drive, and the rest.

    Attributes
    ----------
    rms : float
        Error of one sample [V or N].
    colour : float
        Correlation of the rest from one sample to the next.
    period : float
        Samples per period of the drive; 0 if it has none.
    orders : tuple of int
        Orders of the harmonics that were estimated.
    term : float
        Rms error of the constant, and of each cosine and sine of these orders [V or N].
    """

    rms: float
    colour: float = 0.0
    period: float = 0.0
    orders: tuple[int, ...] = ()
    term: float = 0.0

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
