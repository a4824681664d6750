"""Significance of a comparison of models.

Residuals within a record are correlated, so samples are not counted as independent. Whether a
model is better is tested with the spectrum of its residual. Which of several models is the best is
tested by resampling blocks of whole periods, which are nearly independent.
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
    """Improvement of one model over another."""

    square: float  # decrease of the weighted sum of squares [m^2]
    ratio: float  # decrease divided by its standard error
    p_value: float  # probability of such a ratio without any improvement


def block_squares(errors: Sequence[FloatArray], edges: BlockEdges) -> list[FloatArray]:
    """Return the sum of squares of every block, per view."""
    return [
        np.add.reduceat(e**2, np.asarray(marks[:-1], dtype=np.int64))
        for e, marks in zip(errors, edges, strict=True)
    ]


def improvement(before: CandidateFit, after: CandidateFit, tried: int) -> Improvement:
    """Return the improvement between two fits to the same views; `tried` models were compared.

    The difference of the two responses is deterministic; only the residual is random. The decrease
    of the sum of squares is the square of the difference plus twice its product with the residual.
    That product has the variance of a random signal with the spectrum of the residual, with the
    noise as a lower bound at each frequency, because a fit may have removed random components from
    a line. A short effect is thus as significant as a permanent one, and a residual that both
    models share is no evidence, however often it repeats (Vuong 1989, for errors with a spectrum).
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
    """Return the share of block-bootstrap resamples (Efron 1979) in which each fit is the best."""
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
