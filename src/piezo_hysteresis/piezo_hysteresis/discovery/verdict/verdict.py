"""Verdict as data, with the content of `verdict.json`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from typing import Any, ClassVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import Guided
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.detection.bends import Ladder
from piezo_hysteresis.discovery.detection.limits import DetectionLimit, LookAlike
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.periods import TwoWayLag


@dataclass(frozen=True)
class ProofRow:
    """Gaps of one view."""

    record: str  # name of the record
    frequency: float  # drive frequency [Hz]
    amplitude: float  # amplitude [V]
    before: float  # rms residual without [m]
    after: float  # with the found effects [m]
    held_out: bool = True  # whether the view is held out from every fit and decision


@dataclass(frozen=True)
class HeldOutComparison:
    """Gaps without and with the found effects.

    Attributes
    ----------
    rows : tuple of ProofRow
        Gaps of the held-out views, sorted by frequency.
    before, after : float
        Rms residual over all held-out views [m].
    before_in_floors, after_in_floors : float
        The same, each residual in multiples of the noise of its record.
    stable : bool
        Whether the free run stays within a few strokes for every held-out drive.
    """

    rows: tuple[ProofRow, ...]
    before: float
    after: float
    before_in_floors: float
    after_in_floors: float
    stable: bool


def compare_held_out(
    data: Dataset, before: CandidateFit, after: CandidateFit
) -> HeldOutComparison:
    """Return the gaps of two models on the held-out views."""
    old, new = before.errors, after.errors
    rows = [_row(v, a, b) for v, a, b in zip(data.held_out, old, new, strict=True)]
    limit = 10.0 * data.span
    stable = all(bool(np.all(np.abs(e) < limit)) for e in new)
    ordered = sorted(rows, key=lambda r: (r.frequency, r.amplitude, r.record))
    return HeldOutComparison(
        tuple(ordered), before.rms, after.rms, before.floors, after.floors, stable
    )


def over_frequency(
    data: Dataset, before: CandidateFit, after: CandidateFit, proof: HeldOutComparison
) -> list[ProofRow]:
    """Return the gaps of all records with a drive frequency, sorted by frequency.

    This is Figure 10 of Fujii 2018 for any model and any effect.
    """
    trained = [
        replace(_row(view, old, new), held_out=False)
        for view, old, new in zip(data.training, before.errors, after.errors, strict=True)
    ]
    rows = [row for row in (*trained, *proof.rows) if row.frequency > 0.0]
    return sorted(rows, key=lambda r: (r.frequency, r.amplitude, r.record, r.held_out))


def _row(view: FitData, before: FloatArray, after: FloatArray) -> ProofRow:
    return ProofRow(
        view.name,
        view.frequency,
        float(np.max(np.abs(view.voltage))),
        float(np.sqrt(np.mean(np.square(before)))),
        float(np.sqrt(np.mean(np.square(after)))),
    )


@dataclass(frozen=True)
class Number:
    """Fitted parameter of an effect."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True)
class Alternative:
    """Another effect that the data do not exclude."""

    name: str
    probability: float


@dataclass(frozen=True)
class NamedEffect(Guided):
    """One effect that the baseline lacks.

    Attributes
    ----------
    name, variant : str
        Name of the effect and of its variant.
    probability : float
        Probability of this effect, given that an effect is missing: the share of resamples of the
        training data that it explains best, or its posterior probability with a fixed baseline;
        both times the certainty that the missing effect is among the candidates.
    p_value : float
        Probability of such an improvement by chance, corrected for the number of candidates.
    gap_before_rms_m, gap_after_rms_m : float
        Gap on the training records without and with it [m].
    parameters : dict of str to Number
        Fitted parameters of the effect.
    alternatives : tuple of Alternative
        Other effects that the data do not exclude.
    evidence : tuple of str
        Evidence in sentences.
    drives : tuple of dict
        For a mode, the drives with an odd harmonic near it: ``frequency_hz``, ``order`` and
        ``amplitude_m``, the measured amplitude of that harmonic.
    look_alikes : tuple of LookAlike
        Effects that these records cannot distinguish from it at its size.
    changes : tuple of str
        Changes of the baseline, most significant first: ``natural_frequency 800 to 650 Hz``.
    one_of : tuple of str
        Names of which these records do not show which, at most three: a bend, a gain. Empty if the
        class is not bounded so.
    ladder : Ladder or None
        Amplitudes that show which.
    """

    _INSTEAD: ClassVar = {'p_value': 'p pvalue', 'probability': 'p_present'}

    name: str
    variant: str
    probability: float
    p_value: float
    gap_before_rms_m: float
    gap_after_rms_m: float
    parameters: dict[str, Number]
    alternatives: tuple[Alternative, ...]
    evidence: tuple[str, ...]
    drives: tuple[dict[str, float], ...] = ()
    look_alikes: tuple[LookAlike, ...] = ()
    changes: tuple[str, ...] = ()
    one_of: tuple[str, ...] = ()
    ladder: Ladder | None = None

    def at_most(self, chance: float) -> NamedEffect:
        """Return the effect with no probability above `chance`."""
        others = (replace(a, probability=min(a.probability, chance)) for a in self.alternatives)
        own = min(self.probability, chance)
        return replace(self, probability=own, alternatives=tuple(others))

    @property
    def only_alike(self) -> tuple[LookAlike, ...]:
        """Look-alikes without a probability of their own."""
        listed = {other.name for other in self.alternatives}
        return tuple(each for each in self.look_alikes if each.name not in listed)

    @property
    def effect_class(self) -> tuple[str, ...]:
        """Names that the records leave: this one, alternatives worth a statement, look-alikes."""
        if self.one_of:
            return self.one_of
        likely = (a.name for a in self.alternatives if a.probability > POLICY.alternative)
        alike = (each.name for each in self.look_alikes)
        return tuple(dict.fromkeys((self.name, *likely, *alike)))


@dataclass(frozen=True)
class HeldOut:
    """Gap on held-out records without and with the found effects."""

    gap_before_rms_m: float
    gap_after_rms_m: float
    before_in_floors: float
    after_in_floors: float


@dataclass(frozen=True)
class Unexplained:
    """Residual that no effect explains."""

    significant: bool
    description: str


@dataclass(frozen=True)
class Verdict(Guided):
    """Content of `verdict.json`; the keys are the names of the fields."""

    _INSTEAD: ClassVar = {
        'verdict': 'name result',
        'effects[0].probability': 'probability',
        'summary': 'text',
    }

    baseline: str
    seed: int
    noise_floor_rms_m: float
    held_out: HeldOut
    effects: tuple[NamedEffect, ...]
    verdict: str
    unexplained: Unexplained
    where: tuple[dict[str, Any], ...]
    next_experiments: tuple[str, ...]
    records: dict[str, list[str]]
    seconds: float
    summary: str = ''
    suspects: tuple[Alternative, ...] = ()
    check: tuple[str, ...] = ()
    proof: tuple[dict[str, Any], ...] = ()
    over_frequency: tuple[dict[str, Any], ...] = ()
    baseline_gaps_rms_m: dict[str, float] = field(default_factory=dict)
    free_run_stable: bool = True
    sampling_offset_s: float = 0.0
    starts: dict[str, dict[str, Any]] = field(default_factory=dict)
    not_tried: tuple[str, ...] = ()
    identified_from: tuple[str, ...] = ()
    held_baseline: bool = False
    detection_limits: tuple[DetectionLimit, ...] = ()
    repeats: dict[str, float] | None = None
    two_way: tuple[TwoWayLag, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain types for JSON; numbers that are not finite become None."""
        plain: dict[str, Any] = plain_types(asdict(self))
        return plain


def plain_types(value: Any) -> Any:
    """Return `value` with None instead of numbers that JSON cannot represent."""
    if isinstance(value, dict):
        return {key: plain_types(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_types(each) for each in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
