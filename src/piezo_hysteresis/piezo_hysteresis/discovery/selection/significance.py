"""How sure a comparison of models is.

Errors of one record are alike, so samples must not be counted as if they were independent. Whether
a model is better is judged by the spectrum of what it leaves, and which of several is the best by
resampling blocks of whole periods, which nearly are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit

BlockEdges = Sequence[Sequence[int]]


@dataclass(frozen=True)
class Improvement:
    """By how much one model is better than another.

    Attributes
    ----------
    square : float
        Decrease of the weighted sum of squares [m^2].
    ratio : float
        That over its standard error.
    p_value : float
        Probability of such a ratio if there were no improvement, times the number of models that
        were tried.
    """

    square: float
    ratio: float
    p_value: float


def block_squares(errors: Sequence[FloatArray], edges: BlockEdges) -> list[FloatArray]:
    """Return the sum of squares of every block, per view."""
    return [
        np.add.reduceat(e**2, np.asarray(marks[:-1], dtype=np.int64))
        for e, marks in zip(errors, edges, strict=True)
    ]


def improvement(before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
    """Compare two fits on the same views; `tried` models were looked at to find `after`.

    By what the models differ is no matter of chance, only what is left is: the decrease of the sum
    of squares is the square of the difference and twice its product with what is left. That
    product has the variance of a random signal with the spectrum of what is left, but nowhere less
    than noise: a fit may have taken from a line what chance had put there. An effect that shows
    for a moment is as sure as one that always shows, and what two models leave alike is no
    evidence, however often it repeats (Vuong 1989, for errors with a spectrum).
    """
    variance = 0.0
    for old, new, precision, noise in zip(
        before.errors, after.errors, after.precisions, after.noises, strict=True
    ):
        left = np.maximum(np.abs(np.fft.rfft(new)) ** 2 / new.size, noise**2)
        moved = np.abs(np.fft.rfft(old - new)) ** 2 / new.size
        both_sides = np.full(left.size, 2.0)
        both_sides[0] = 1.0
        variance += 4.0 * precision**4 * float(both_sides @ (left * moved))
    square = before.square - after.square
    ratio = square / float(np.sqrt(variance)) if variance > 0.0 else 0.0
    p_value = min(1.0, float(ndtr(-ratio)) * max(tried, 1))
    return Improvement(square, ratio, p_value)


def win_shares(
    fits: Sequence[CandidateFit],
    penalties: Sequence[float],
    edges: BlockEdges,
    seed: int,
    draws: int,
) -> FloatArray:
    """Return in which share of resamples of blocks (Efron 1979) each fit is the best.

    Parameters
    ----------
    fits : sequence of CandidateFit
        Competitors, judged on the same views.
    penalties : sequence of float
        Added to the logarithm of each fit's sum of squares: what its parameters cost.
    edges : sequence of sequence of int
        Block edges per view.
    seed, draws : int
        Of the resampling, and how many.
    """
    generator = np.random.default_rng(seed)
    squares = [block_squares(fit.weighted, edges) for fit in fits]
    sums = np.zeros((len(fits), draws))
    for view in range(len(edges)):
        rows = np.array([s[view] for s in squares])
        count = rows.shape[1]
        weights = generator.multinomial(count, np.full(count, 1.0 / count), size=draws)
        sums += rows @ weights.T
    scores = np.log(np.maximum(sums, 1e-300)) + np.asarray(penalties)[:, None]
    winners = np.argmin(scores, axis=0)
    return np.bincount(winners, minlength=len(fits)) / draws
