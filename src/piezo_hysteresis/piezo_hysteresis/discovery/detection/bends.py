"""Bends and gains that leave the same residual, and the amplitudes that separate them.

At one amplitude a curve of odd order is mostly a gain: of a cubic one 0.32 of its change is none,
of z abs(z) 0.2, and a bank of plays takes a part of that. Other members of the family are fitted
to the end, too, and the response of each is compared with that of the named one. The unit is the
power that noise and known discrepancy have in each harmonic. Below 7 (see `limits`) the names form
one class.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.base import InterSample
from piezo_hysteresis.discovery.data.second_channel import CURVES, RIVALS
from piezo_hysteresis.discovery.detection.limits import (
    APART,
    SIMILAR,
    LookAlike,
    Whitening,
    look_alikes,
)
from piezo_hysteresis.discovery.detection.statements import at_rest_before
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec, errors_of
from piezo_hysteresis.discovery.selection.elimination import Step
from piezo_hysteresis.discovery.selection.evaluator import Evaluator
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import (
    FixedBaselineEvaluator,
    drives_of,
    expectations,
)
from piezo_hysteresis.discovery.selection.rounds import fits_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.models import PARAMETER_SHIFT

#: Names of the curves without a memory that resemble one of the sensor, with it and a gain.
BENDS = frozenset(
    {PARAMETER_SHIFT.name}
    | {
        effect.name
        for effect in EFFECTS
        if effect.name in CURVES | RIVALS
        and effect.block is not None
        and effect.block.between is InterSample.INSTANT
    }
)
# Amplitudes that are calculated, relative to the largest one of the records. Chosen.
_LADDER = (0.25, 0.35, 0.5, 0.7)
#: Names of a class; more say nothing. Chosen.
LARGEST_CLASS = 3
# Of a ladder, steps below its top.
_STEPS = 2


@dataclass(frozen=True)
class Ladder:
    """Amplitudes at which the members of a class differ.

    Attributes
    ----------
    amplitudes : tuple of float
        Of one drive, largest first [V].
    frequency : float
        Of the drive [Hz].
    distances : dict of str to float
        Predicted distance of each member from the named effect over all amplitudes, in standard
        deviations of noise and discrepancy.
    differences_rms_m : dict of str to float
        Predicted rms difference at the amplitude where it is clearest [m].
    """

    amplitudes: tuple[float, ...]
    frequency: float
    distances: dict[str, float]
    differences_rms_m: dict[str, float]

    def sentences(self, name: str, unit: str) -> list[str]:
        """Return what the amplitudes show, and what they do not."""
        apart = {k: d for k, d in self.distances.items() if d >= APART}
        left = [k for k in self.distances if k not in apart]
        found = []
        steps = ', '.join(f'{a:.3g}' for a in self.amplitudes)
        if apart:
            sizes = ', '.join(
                f'{1e6 * self.differences_rms_m[k]:.2g} µm rms from {k}, '
                f'{d:.3g} standard deviations'
                for k, d in apart.items()
            )
            found.append(
                f'To distinguish {", ".join([name, *apart])}: record the drive of '
                f'{self.frequency:.3g} Hz at three amplitudes, {steps} {unit}; there {name} '
                f'differs by {sizes} ({APART:g} are enough).'
            )
        if left:
            nearest = max(self.distances[k] for k in left)
            found.append(
                f'To distinguish {", ".join([name, *left])}: record a second channel, another '
                f'sensor, charge or current. The best amplitudes up to that of these records, '
                f'{steps} {unit}, separate them by {nearest:.2g} of {APART:g} standard deviations '
                'of what the model is known to miss there.'
            )
        return found


@dataclass(frozen=True)
class Similar:
    """Effects that the records cannot distinguish from a found one, nearest first."""

    names: tuple[LookAlike, ...] = ()
    models: tuple[ModelSpec, ...] = ()  # that have them instead
    bends: tuple[str, ...] = ()  # those of them that were fitted instead of the found one
    ladder: Ladder | None = None  # amplitudes that separate `bends`


def similar_effects(evaluator: Evaluator, step: Step, start: CandidateFit) -> Similar:
    """Return what the records cannot distinguish from the effect of a step.

    A fitted baseline absorbs a gain, and finalists were fitted with it; with a fixed one, bends
    and gains are fitted instead of the effect.
    """
    pairs: list[tuple[LookAlike, ModelSpec]] = [*look_alikes(evaluator, step, start)]
    if not isinstance(evaluator, FixedBaselineEvaluator):
        nearest: dict[str, tuple[LookAlike, ModelSpec]] = {}
        pairs += near_finalists(evaluator, step)
        for pair in sorted(pairs, key=lambda pair: pair[0].distance):
            nearest.setdefault(pair[0].name, pair)
        pairs = [*nearest.values()]
    if step.fit.effect not in BENDS or not isinstance(evaluator, FixedBaselineEvaluator):
        return Similar(tuple(a for a, _ in pairs), tuple(m for _, m in pairs))
    bends = same_bends(evaluator, step)
    pairs = [*bends, *(pair for pair in pairs if pair[0].name not in BENDS)]
    rivals = [fit for _, fit in bends[: LARGEST_CLASS - 1]]
    ladder = ladder_of(evaluator, step.fit, rivals)
    names = tuple(a for a, _ in pairs)
    return Similar(names, tuple(m for _, m in pairs), tuple(a.name for a, _ in bends), ladder)


def near_finalists(evaluator: Evaluator, step: Step) -> list[tuple[LookAlike, CandidateFit]]:
    """Return the finalists of other effects whose response is that of the effect of a step.

    To first order two effects may differ that leave the same residual once they are fitted.
    """
    found = step.fit
    whitening = Whitening(found.errors, found.noises, [1.0] * len(found.errors))

    def away(fit: CandidateFit) -> float:
        if [error.size for error in fit.errors] != whitening.sizes:
            return float('inf')
        change = [b - a for a, b in zip(found.errors, fit.errors, strict=True)]
        return float(np.linalg.norm(whitening(change)))

    limit = min(APART, SIMILAR * away(step.round.before))
    others = [
        (LookAlike(fit.effect, away(fit)), fit)
        for fit in step.round.finalists
        if fit.effect != found.effect and not evaluator.is_another_change(fit)
    ]
    return [pair for pair in others if pair[0].distance < limit]


def same_bends(
    evaluator: FixedBaselineEvaluator, step: Step
) -> tuple[tuple[LookAlike, CandidateFit], ...]:
    """Return the bends that leave the residual of the effect of a step, nearest first.

    Each is fitted instead of it, with the other effects in the model.
    """
    before = step.round.before
    rivals = {each for each in BENDS if not evaluator.excludes(each, before)} - {step.fit.effect}
    fitted = {fit.effect: fit for fit in reversed(step.round.finalists) if fit.effect in rivals}
    for fit in fits_of(evaluator, before, rivals.difference(fitted)):
        fitted[fit.effect] = fit
    pairs = [(LookAlike(k, evaluator.distance(step.fit, fit)), fit) for k, fit in fitted.items()]
    near = (pair for pair in pairs if pair[0].distance < APART)
    return tuple(sorted(near, key=lambda pair: (pair[0].distance, pair[0].name)))


def ladder_of(
    evaluator: FixedBaselineEvaluator, named: CandidateFit, others: Sequence[CandidateFit]
) -> Ladder | None:
    """Return the amplitudes at which a named effect differs most from the others of its class.

    The drive is that of the records with the largest amplitude. None without a drive, or where a
    model diverges.
    """
    drives = drives_of(evaluator.data)
    driven = [view for view in evaluator.views if drives.get(view.name, view.frequency) > 0.0]
    if not others or not driven:
        return None
    top = max(driven, key=_amplitude)
    top = replace(top, frequency=drives.get(top.name, top.frequency))
    shares = (*_LADDER, 1.0)
    views = [_scaled(top, share) for share in shares]
    try:
        own, *rest = (errors_of(fit, views) for fit in (named, *others))
    except PiezoError:
        return None
    views = [replace(v, measured=v.measured - e) for v, e in zip(views, own, strict=True)]
    expected = expectations(evaluator.data, views, evaluator.known, evaluator.policy)
    distances, sizes = np.zeros((len(others), len(shares))), np.zeros((len(others), len(shares)))
    for row, errors in enumerate(rest):
        for k, (a, b, x) in enumerate(zip(own, errors, expected, strict=True)):
            change = a - b
            distances[row, k] = np.sqrt(np.sum(x.whitened(change) ** 2))
            sizes[row, k] = np.std(change)
    if not np.all(np.isfinite(distances)):
        return None
    apart = _least(distances)
    chosen = sorted(np.argsort(apart[:-1])[-_STEPS:])
    kept = [len(shares) - 1, *reversed(chosen)]
    names = [fit.effect for fit in others]
    together = np.sqrt(np.sum(distances[:, kept] ** 2, axis=1))
    clearest = np.take_along_axis(
        sizes[:, kept], np.argmax(distances[:, kept], axis=1)[:, None], axis=1
    )[:, 0]
    return Ladder(
        tuple(_amplitude(top) * shares[k] for k in kept),
        top.frequency,
        dict(zip(names, map(float, together), strict=True)),
        dict(zip(names, map(float, clearest), strict=True)),
    )


def _least(distances: FloatArray) -> FloatArray:
    """Return the least distance at each amplitude, of those that any amplitude separates."""
    separable = distances[np.max(distances, axis=1) >= APART]
    return np.asarray(np.min(separable if len(separable) else distances, axis=0))


def _amplitude(view: FitData) -> float:
    return 0.5 * float(np.ptp(view.voltage[view.origin :]))


def _scaled(view: FitData, share: float) -> FitData:
    """Return the drive of a view about its middle with a share of its amplitude, from rest."""
    driven = view.voltage[view.origin :]
    middle = 0.5 * float(driven.min() + driven.max())
    voltage = middle + share * (driven - middle)
    name = f'{view.name} at {share:g}'
    return at_rest_before(name, voltage, view.dt, view.frequency, view.noise)
