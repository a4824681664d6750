"""Whitened response changes, with the directions of nuisance parameters projected out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.numerics.qr import inner, orthonormal, projected_out

# Bins of the periodogram over which the spectrum of a residual is averaged.
_SMOOTHED = 15
# Relative norm of a projected direction below which it is linearly dependent on the others.
_DEPENDENT = 1e-7


class Whitening:
    """Divides each view by the spectrum of its residual, so that the residual has unit variance.

    The noise spectrum is a lower bound, because a fit may have removed random components from a
    line.
    """

    def __init__(
        self, errors: Sequence[FloatArray], noises: Sequence[float], weights: Sequence[float]
    ) -> None:  # errors [m] (n_i,); noises [m]
        self.sizes = [error.size for error in errors]
        self._roots = [
            np.sqrt(np.maximum(_smooth(np.abs(np.fft.rfft(e)) ** 2 / e.size), noise**2) / weight)
            for e, noise, weight in zip(errors, noises, weights, strict=True)
        ]

    def __call__(self, changes: Sequence[FloatArray]) -> FloatArray:
        """Return the concatenated changes of all views [m], in standard deviations."""
        pairs = zip(changes, self._roots, strict=True)
        return np.concatenate([np.fft.irfft(np.fft.rfft(c) / root, c.size) for c, root in pairs])

    def inverse(self, whitened: FloatArray) -> list[FloatArray]:
        """Return the changes of each view [m] from whitened ones."""
        parts = np.split(whitened, np.cumsum(self.sizes)[:-1])
        pairs = zip(parts, self._roots, strict=True)
        return [np.fft.irfft(np.fft.rfft(part) * root, part.size) for part, root in pairs]


def _smooth(power: FloatArray) -> FloatArray:
    """Return the running mean of a periodogram, shape (bins,)."""
    width = min(_SMOOTHED, power.size)
    counts = np.convolve(np.ones(power.size), np.ones(width), 'same')
    return np.asarray(np.convolve(power, np.ones(width), 'same') / counts)


class NuisanceDirections:
    """Whitened response directions of the parameters that a fit adjusts."""

    def __init__(
        self,
        free: Sequence[FloatArray],  # (n,)
        bounded: FloatArray,  # (n,)
        bounds: tuple[float, float],  # [s]
        uncertain: Sequence[FloatArray] = (),  # (n,)
    ) -> None:
        # a prior counts as one more measurement per uncertain parameter
        self._priors = len(uncertain)
        rows = np.zeros((len(free) + self._priors, bounded.size + self._priors))
        for row, direction in zip(rows, (*free, *uncertain), strict=True):
            row[: bounded.size] = direction
        rows[len(free) :, bounded.size :] = np.eye(self._priors)
        basis = orthonormal(rows, _DEPENDENT)
        self._basis = basis[np.any(basis != 0.0, axis=1)]
        self._bounded = projected_out(self._with_priors(bounded), self._basis)[1]
        self._square = inner(self._bounded, self._bounded)
        self._bounds = bounds

    def remove(self, change: FloatArray) -> FloatArray:
        """Return the part of a change that no nuisance parameter explains.

        Shape (n + u,): the changes of the u uncertain parameters follow, in standard deviations.
        """
        left = projected_out(self._with_priors(change), self._basis)[1]
        if self._square > 0.0:
            share = inner(self._bounded, left) / self._square
            left = left - float(np.clip(share, *self._bounds)) * self._bounded
        return left

    def _with_priors(self, change: FloatArray) -> FloatArray:
        return np.concatenate([change, np.zeros(self._priors)])
