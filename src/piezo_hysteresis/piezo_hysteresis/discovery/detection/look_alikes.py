"""Which effects these records cannot tell from one that was found, at the size that it has.

The effect changes the response by x. A rival l of any size, together with what a fit adjusts,
comes within

    d_l = min over b |(I - P_J)(x - b x_l)|

standard deviations of chance of it. Below 7 (`limits.APART`) the two are one class: the records
hold too little that is not common to both. The distance needs no fit of the rival.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.discovery.detection.limits import APART, Records, distance, one_sided
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.elimination import Step
from piezo_hysteresis.discovery.selection.evaluator import Evaluator


@dataclass(frozen=True)
class LookAlike:
    """An effect that these records do not tell from another.

    Attributes
    ----------
    name : str
        Its name.
    distance : float
        How far apart the two are, in standard deviations of chance.
    """

    name: str
    distance: float


def look_alikes(evaluator: Evaluator, step: Step, start: CandidateFit) -> tuple[LookAlike, ...]:
    """Return the effects that look like the one found in a step, the nearest first.

    Parameters
    ----------
    evaluator : Evaluator
        By which the search was judged.
    step : Step
        In which the effect was found, the others being known.
    start : CandidateFit
        The baseline.
    """
    records = Records(evaluator, step.round.before, start, residual=step.fit)
    found = records.left(step.fit)
    if found is None:
        return ()
    nearest: dict[str, float] = {}
    for candidate in records.candidates():
        name = candidate.effect.name
        if name == step.fit.effect:
            continue
        for values in candidate.starts:
            rival = records.signature(candidate, values)
            if rival is None:
                continue
            away = records.all_samples * distance(found, rival, one_sided(candidate))
            nearest[name] = min(away, nearest.get(name, np.inf))
    alike = [LookAlike(name, away) for name, away in nearest.items() if away < APART]
    return tuple(sorted(alike, key=lambda each: each.distance))
