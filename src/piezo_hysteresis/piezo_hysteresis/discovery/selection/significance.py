"""How sure a comparison of models is: by resampling blocks of whole periods.

Errors of one record are alike, so samples must not be counted as if they were independent; blocks
of whole periods nearly are. Blocks are drawn within their record, so that an effect that shows in
one record alone is judged by how steadily it shows there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit

BlockEdges = Sequence[Sequence[int]]


@dataclass(frozen=True)
class Improvement:
    """By how much one model is better than another.

    Attributes
    ----------
    square : float
        Decrease of the sum of squares [m^2].
    ratio : float
        Mean decrease of the logarithm of the mean square over its standard error from block to
        block.
    p_value : float
        Probability of such a ratio if there were no improvement, times the number of models that
        were tried: the tail of Student's distribution, the deviation being known from as many
        blocks as there are.
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


def improvement(
    before: CandidateFit, after: CandidateFit, edges: BlockEdges, tried: int
) -> Improvement:
    """Compare two fits on the same views; `tried` models were looked at to find `after`.

    What is averaged is the logarithm of each block's mean square, the noise of its record added:
    an effect that is a hundred times larger in one record than in the others is no less sure.
    """
    old, new = block_squares(before.errors, edges), block_squares(after.errors, edges)
    total, variance, blocks = 0.0, 0.0, 0
    for a, b, marks, floor in zip(old, new, edges, before.noises, strict=True):
        noise = np.diff(marks) * floor**2
        change = np.diff(marks) * np.log((a + noise) / (b + noise))
        total += float(change.sum())
        spread = np.var(change, ddof=1) if change.size > 1 else change[0] ** 2
        variance += float(change.size * spread)
        blocks += change.size
    ratio = total / float(np.sqrt(variance)) if variance > 0.0 else 0.0
    freedom = max(blocks - len(edges), 1)
    p_value = min(1.0, float(student.sf(ratio, freedom)) * max(tried, 1))
    return Improvement(sum(float(a.sum() - b.sum()) for a, b in zip(old, new, strict=True)),
                       ratio, p_value)  # fmt: skip


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
