"""The verdict as data: what `verdict.json` holds."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

from piezo_hysteresis.discovery.detection.limits import DetectionLimit
from piezo_hysteresis.discovery.detection.look_alikes import LookAlike


@dataclass(frozen=True)
class Number:
    """A fitted parameter of an effect."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True)
class Alternative:
    """Another effect that the data do not exclude."""

    name: str
    probability: float


@dataclass(frozen=True)
class NamedEffect:
    """One effect that the model missed.

    Attributes
    ----------
    name, variant : str
        Its word, and the way in which it enters.
    probability : float
        That it is this effect, given that something is missing: the share of resamples of the
        training data in which it explains them best.
    p_value : float
        Probability of such an improvement by chance, for all candidates that were tried.
    gap_before_rms_m, gap_after_rms_m : float
        Gap on the training records without and with it [m].
    parameters : dict of str to Number
        Its parameters.
    alternatives : tuple of Alternative
        What else it may be.
    evidence : tuple of str
        Sentences.
    drives : tuple of dict
        For a mode, the drives that have an odd harmonic on it: ``frequency_hz``, ``order`` and
        ``amplitude_m``, what was measured of that harmonic.
    look_alikes : tuple of LookAlike
        Effects that these records do not tell from it at its size.
    """

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


@dataclass(frozen=True)
class HeldOut:
    """Gap on held-out records before and after."""

    gap_before_rms_m: float
    gap_after_rms_m: float
    before_in_floors: float
    after_in_floors: float


@dataclass(frozen=True)
class Unexplained:
    """The residual that no effect explains."""

    significant: bool
    description: str


@dataclass(frozen=True)
class Verdict:
    """Everything that `verdict.json` holds; the names are its fields."""

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

    def to_dict(self) -> dict[str, Any]:
        """Return plain types, ready for JSON; numbers that are not finite become None."""
        plain: dict[str, Any] = _finite(asdict(self))
        return plain


def _finite(value: Any) -> Any:
    """Return `value` with None for numbers that JSON cannot represent."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
