"""Effects that the records cannot distinguish from a found one, at its identified size.

The effect changes the response by x. A candidate l of any size, together with the parameters of a
fit, approximates this change up to

    d_l = min over b |(I - P_J)(x - b x_l)|

standard deviations of the random residual. Below 7 (`limits.APART`), and below half of the change
itself, the two effects form one class, because the records contain too little information that
distinguishes them. A small change is near every effect of size b = 0; this is no similarity. The
distance requires no fit of the candidate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.discovery.detection.limits import (
    APART,
    Records,
    nearest_multiple,
    one_sided,
    scaled,
)
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.elimination import Step
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.numerics.qr import inner

# Largest distance of a similar effect, relative to the change: it explains 75 % of its power.
SIMILAR = 0.5


@dataclass(frozen=True)
class LookAlike:
    """An effect that these records cannot distinguish from another.

    Attributes
    ----------
    name : str
        Name of the effect.
    distance : float
        Distance of the two effects, in standard deviations of the random residual.
    """

    name: str
    distance: float


def look_alikes(
    evaluator: Evaluator, step: Step, start: CandidateFit
) -> tuple[tuple[LookAlike, ModelSpec], ...]:
    """Return the effects that cannot be distinguished from that of a step, nearest first.

    Each with the model that has it instead, at the size of the smallest distance; the parameters
    of the baseline keep their values.
    """
    records = Records(evaluator, step.round.before, start, residual=step.fit)
    found = records.left(step.fit)
    if found is None:
        return ()
    pairs = [
        (candidate, values)
        for candidate in records.candidates()
        if candidate.effect.name != step.fit.effect
        for values in candidate.starts
    ]
    size = float(np.sqrt(inner(found, found)))
    nearest: dict[str, tuple[LookAlike, ModelSpec]] = {}
    for (candidate, _), other in zip(pairs, records.signatures(pairs), strict=True):
        if other is None:
            continue
        name = candidate.effect.name
        share, away = nearest_multiple(found, other.whitened, one_sided(candidate))
        closest = nearest[name][0].distance if name in nearest else np.inf
        if away < min(APART, SIMILAR * size, closest):
            values = scaled(candidate, other.values, share)
            spec = step.round.before.with_candidate(candidate, values)
            nearest[name] = LookAlike(name, away), spec
    return tuple(sorted(nearest.values(), key=lambda each: each[0].distance))
