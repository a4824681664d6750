"""Cross-talk: which axis moves with the voltage of another one, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.frequency_response import response
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.numerics.linalg import failing_as

# Lines below this part of the first resonance are static.
_STATIC = 0.1
_FEWEST_LINES = 4
# Chance of any false pair in records without cross-talk.
FALSE_PAIRS = 0.005


@dataclass(frozen=True)
class CrossTalk:
    """The static cross-talk of one pair.

    Attributes
    ----------
    voltage, displacement : int
        Axis whose voltage acts, and axis that moves; from 1 on.
    size : float
        Motion of the axis, as a part of that which its own voltage makes.
    std : float
        Standard deviation of the size.
    """

    voltage: int
    displacement: int
    size: float
    std: float

    def __str__(self) -> str:
        return (
            f'cross_talk: axis {self.displacement} moves {100.0 * self.size:.2g} ± '
            f'{100.0 * self.std:.1g} % with the voltage of axis {self.voltage}'
        )


def cross_talk(records: Sequence[AxesRecord], below: float | None = None) -> list[CrossTalk]:
    """Return the pairs of axes with static cross-talk, the largest first.

    Parameters
    ----------
    records : sequence of AxesRecord
        Periodic records that drive the axes independently, as many as there are inputs or more.
    below : float, optional
        Highest frequency that counts as static [Hz]; by default a tenth of the first resonance.

    Raises
    ------
    RecordError
        If inputs and outputs are no pairs, or too few lines are static.
    """
    inputs, outputs = records[0].voltage.shape[1], records[0].displacement.shape[1]
    if inputs != outputs:
        raise RecordError(
            f'cross-talk is a matter of pairs, and the records have {inputs} voltages and '
            f'{outputs} displacements: choose columns with --voltage and --displacement'
        )
    unusable = RecordError('the records do not determine the response of all axes')
    with failing_as(unusable):
        found = response(records)
    size = np.linalg.norm(found.matrix, axis=(1, 2))
    if below is None:
        low = np.median(size[: max(1, size.size // 50)])
        resonant = np.flatnonzero(size > 2.0 * low)
        below = _STATIC * float(found.frequency[resonant[0] if resonant.size else -1])
    lines = found.frequency <= below
    if lines.sum() < _FEWEST_LINES:
        raise RecordError(
            f'{lines.sum()} lines below {below:.3g} Hz cannot show static cross-talk; record '
            'longer periods'
        )
    gain = found.matrix[lines].real
    mean, spread = gain.mean(0), gain.std(0, ddof=1) / np.sqrt(lines.sum())
    bound = norm.isf(0.5 * FALSE_PAIRS / max(inputs * (inputs - 1), 1))
    pairs = []
    for j, i in zip(*np.nonzero(np.abs(mean) > bound * spread), strict=True):
        if i != j:
            own = float(mean[j, j])
            part, std = float(mean[j, i]) / own, float(spread[j, i]) / abs(own)
            pairs.append(CrossTalk(int(i) + 1, int(j) + 1, part, std))
    return sorted(pairs, key=lambda pair: -abs(pair.size))
