"""A good model without asking: effects are added one by one and kept where held-out data agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.errors import free_run
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.output_error import output_error
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.models import Model, add_effect, described, named
from piezo_hysteresis.records import Record

Progress = Callable[[float, str], None]

#: Effects that are tried, in the order in which they usually matter; `mode` is structural.
LADDER = ('mode', 'creep', 'nonlocal_memory', 'amplifier_lag', 'electrostriction')

TRAINED = 0.7  # share of each record that is fitted; the rest decides
_GAIN = 0.98  # an effect must lower the error below this share of what it was
_TRIAL, _POLISH = 15, 100  # evaluations of each start, and of the best of them
_TOLERATED = 1.01  # and may never raise the held-out error above this share


@dataclass(frozen=True)
class Step:
    """One model that was tried.

    Attributes
    ----------
    name : str
        What was added; ``hysteresis`` for the first model.
    parameters : int
        Number of free parameters.
    trained_rms, held_out_rms : float
        Free-run error on the fitted and on the held-out part of the records [m].
    kept : bool
        Whether the next model was built on it.
    """

    name: str
    parameters: int
    trained_rms: float
    held_out_rms: float
    kept: bool


@dataclass(frozen=True)
class Choice:
    """The chosen model, where a fit of it starts, and how it was found.

    Attributes
    ----------
    model : Model
        The chain.
    start : dict of str to float
        Values fitted to the first part of the records.
    steps : tuple of Step
        Every model that was tried, in order.
    """

    model: Model
    start: dict[str, float]
    steps: tuple[Step, ...]


def choose_model(
    records: Sequence[Record], progress: Progress = lambda fraction, words: None
) -> Choice:
    """Choose a chain for records of which nothing is known.

    It begins with an off-centre Bouc-Wen hysteresis, 000 (1). Each further effect of `LADDER` is
    fitted to the first 70 % of every record together with all others. It stays where it lowers
    the free-run error there, or on the rest of the records, by 2 % and does not raise the latter.

    Parameters
    ----------
    records : sequence of Record
        What was measured.
    progress : callable
        Told ``(fraction, words)``.

    Raises
    ------
    IdentificationError
        If the records cannot identify anything.
    """
    require_usable(records)
    cuts = [max(round(TRAINED * len(record)), 2) for record in records]
    training = [r.section(0, cut) for r, cut in zip(records, cuts, strict=True)]
    progress(0.0, 'hysteresis')
    best = output_error(named('modified'), training, count=2)
    model, errors = named('modified'), _errors(best, records, cuts)
    steps = [Step('hysteresis', len(best.free), *errors, True)]
    for k, effect in enumerate(LADDER, start=1):
        progress(k / (len(LADDER) + 1), effect)
        larger, result = _larger(model, best, effect, training)
        trained, held_out = _errors(result, records, cuts)
        kept = held_out <= _TOLERATED * errors[1] and (
            held_out <= _GAIN * errors[1] or trained <= _GAIN * errors[0]
        )
        steps.append(Step(effect, len(result.free), trained, held_out, kept))
        if kept:
            model, best, errors = larger, result, (trained, held_out)
    start = {name: best.values[name] for name in model.free_names}
    return Choice(model, start, tuple(steps))


def _larger(
    model: Model, best: FitResult, effect: str, training: Sequence[Record]
) -> tuple[Model, FitResult]:
    """Return `model` with an effect, in its reference scale, and a fit of it."""
    if effect == 'mode':
        larger = named('bouc_wen_mode').free('A0')
        known = {name: best.values[name] for name in larger.free_names if name in best.values}
        return larger, output_error(larger, training, start=known, count=3)
    description = described(effect)[0]
    voltage = max(float(np.max(np.abs(r.voltage))) for r in training)
    span = max(float(np.ptp(r.displacement)) for r in training)
    # best.model is scaled to the records already, and so must be what is added to it
    candidate = add_effect(best.model, description, voltage, span / 2)
    starts = [candidate.values(best.values, each) for each in candidate.starts]
    tried = [fit(candidate.model, training, s, max_evaluations=_TRIAL) for s in starts]
    first = min(tried, key=lambda each: each.cost)
    result = fit(candidate.model, training, first.values, max_evaluations=_POLISH)
    return add_effect(model, description).model, result


def _errors(fit: FitResult, records: Sequence[Record], cuts: Sequence[int]) -> tuple[float, float]:
    """Return the free-run error [m] before and behind the cuts, over all records."""
    parts: tuple[list[float], list[float]] = ([], [])
    sizes = [0, 0]
    for record, cut in zip(records, cuts, strict=True):
        with np.errstate(over='ignore', invalid='ignore'):
            simulated = free_run(fit.model, fit.values, record, fit.sampling_offset)
            error = record.displacement - simulated
            for k, part in enumerate((error[record.warm_up_samples : cut], error[cut:])):
                parts[k].append(float(part @ part))
                sizes[k] += part.size
    trained, held_out = (
        float(np.sqrt(sum(squares) / max(size, 1)))
        for squares, size in zip(parts, sizes, strict=True)
    )
    return trained, held_out
