"""What a second channel shows: whether a curve is of the sensor or of the actuator.

An actuator moves both channels, so that one stays a straight line over the other; a curve of the
sensor of the displacement bends that line. One amplitude, at which a curve is mostly a gain, is
enough for that.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.special import chdtrc

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.base import InterSample, Slot
from piezo_hysteresis.blocks.effect import Coverage
from piezo_hysteresis.identification.uncertainty import inflation
from piezo_hysteresis.models import PARAMETER_SHIFT
from piezo_hysteresis.numerics.linalg import solve_square
from piezo_hysteresis.records import Record

# Largest power of a curve; bends beyond it are none of a sensor that is usable.
_POWER = 5
# Standard deviations from which a bend is seen. Derived: of the noise alone one in 20 million
# exceeds it, for four powers.
_SEEN = 3.0
# Least bend of a curve of the sensor, relative to all that it changes. Derived: of a cubic curve
# driven by a sine, 0.32 is none of a gain; of z abs(z), 0.2; half of that is left for others.
_BEND = 0.1
_FEWEST = 100  # samples of all records together that have a second channel

#: Names of the effects that are a curve of the sensor, and of those that resemble one.
CURVES = frozenset(
    effect.name
    for effect in EFFECTS
    if effect.block is not None
    and effect.block.slot is Slot.SENSOR
    and effect.block.between is InterSample.INSTANT
    and len(effect.block.parameters) > 1
)
RIVALS = (
    frozenset(
        {PARAMETER_SHIFT.name}
        | {name for effect in EFFECTS if effect.name in CURVES for name in effect.mistaken_for}
        | {effect.name for effect in EFFECTS if CURVES & set(effect.mistaken_for)}
        | {effect.name for effect in EFFECTS if Coverage.LADDER in effect.required_coverage}
    )
    - CURVES
)


@dataclass(frozen=True)
class SensorCurve:
    """Bend of the displacement over a second channel, beyond a straight line."""

    rms: float  # over the records [m]
    std: float  # standard deviation of `rms` [m]
    known: bool = False  # whether the bend of a reference was subtracted

    @property
    def seen(self) -> bool:
        """Whether the bend is more than chance."""
        return self.rms > _SEEN * self.std

    def chance(self, effect: str) -> float:
        """Return the probability of such a bend without the effect; 1 for other effects."""
        if effect not in CURVES:
            return 1.0
        return float(chdtrc(_POWER - 1, (_POWER - 1) * ((self.rms / self.std) ** 2 + 1.0)))

    def excludes(self, effect: str, names: Collection[str], gap: float) -> bool:
        """Return whether an effect does not explain a gap [m], with effects `names` in the model.

        With a bend of the size of the gap, none of those that resemble a curve of the sensor comes
        before it. Without one, no curve of the sensor explains a gap of which it would bend more.
        """
        if self.rms + 2.0 * self.std < _BEND * gap:
            return effect in CURVES
        if not self.seen or self.rms > gap:  # a larger bend was there before
            return False
        return effect in RIVALS and not CURVES & set(names)

    def sentence(self) -> str:
        """Return what the second channel shows."""
        size = f'{1e6 * self.rms:.2g} ± {1e6 * self.std:.1g} µm rms'
        than = 'than over that of the reference' if self.known else 'than a straight line'
        if self.seen:
            return (
                f'The displacement over the second channel is bent by {size} more {than}: the '
                'sensor of the displacement has a curve, and the actuator does not cause it.'
            )
        return (
            f'The displacement over the second channel is bent by less than '
            f'{1e6 * (self.rms + 2.0 * self.std):.2g} µm rms more {than}.'
        )


def sensor_curve(
    records: Sequence[Record], reference: Sequence[Record] = ()
) -> SensorCurve | None:
    """Return the bend of the displacement over the second channel of records; None without one.

    Each record has its own zero and a drift, which a summed current has. Without a `reference`
    with the same channel the second one is proportional to the displacement.
    """
    new = [each for each in records if _follows(each)]
    if sum(map(len, new)) < _FEWEST:
        return None
    low = min(float(each.second.min()) for each in new if each.second is not None)
    high = max(float(each.second.max()) for each in new if each.second is not None)
    bend, spread, span = _bend(new, low, high)
    old = [each for each in reference if _follows(each)]
    if old:
        before, more, _ = _bend(old, low, high)
        bend, spread = bend - before, spread + more
    # of the noise alone the mean square of the bend is the trace of its covariance
    square = float(bend @ span @ bend)
    noise = float(np.trace(span @ spread))
    std = float(np.sqrt(max(noise, 1e-300)))
    return SensorCurve(float(np.sqrt(max(square - noise, 0.0))), std, bool(old))


def _follows(record: Record) -> bool:
    return record.second is not None and bool(np.ptp(record.second) > 0.0)


def _bend(
    records: Sequence[Record], low: float, high: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return coefficients of a bend, their covariance [m^2], and the metric of its rms.

    The powers are those of the second channel, whose noise is independent of that of the first.
    """
    count, blocks, measured = len(records), [], []
    for k, record in enumerate(records):
        first = record.warm_up_samples
        assert record.second is not None
        z = 2.0 * (record.second[first:] - low) / (high - low) - 1.0
        own = np.zeros((z.size, 2 * count))
        own[:, 2 * k] = 1.0
        own[:, 2 * k + 1] = np.linspace(-1.0, 1.0, z.size)
        blocks.append(np.hstack([own, legendre.legvander(z, _POWER)[:, 1:]]))
        measured.append(record.displacement[first:])
    rows, y = np.vstack(blocks), np.concatenate(measured)
    line, powers = rows[:, : 2 * count + 1], rows[:, 2 * count + 1 :]
    bare = powers - line @ _solved(line, powers)
    straight = y - line @ _solved(line, y)
    coefficients = _solved(bare, straight)
    left = straight - bare @ coefficients
    edges = np.cumsum([each.size for each in measured])[:-1]
    factor = inflation(np.split(left, edges)) * float(left @ left) / max(y.size - rows.shape[1], 1)
    gram = bare.T @ bare
    inverse = np.asarray(solve_square(gram, np.eye(len(gram))).values)
    return coefficients, factor * inverse, gram / y.size


def _solved(rows: FloatArray, y: FloatArray) -> FloatArray:
    """Return the least squares solution by the normal equations of scaled columns."""
    scale = np.sqrt(np.maximum(np.einsum('ij,ij->j', rows, rows), 1e-300))
    scaled = rows / scale
    found = np.asarray(solve_square(scaled.T @ scaled, scaled.T @ y).values)
    return np.asarray(found / (scale if y.ndim == 1 else scale[:, None]))
