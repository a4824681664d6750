"""A good model without asking: effects are added one by one and kept where held-out data agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.errors import free_run
from piezo_hysteresis.identification.output_error import output_error
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.models import Model, add_effect, described, named
from piezo_hysteresis.records import Record

Progress = Callable[[float, str], None]

#: Effects that are tried, in the order in which they usually matter; `mode` is structural.
LADDER = ('mode', 'creep', 'nonlocal_memory', 'amplifier_lag', 'electrostriction')

TRAINED = 0.7  # share of each record that is fitted; the rest decides
_GAIN = 0.98  # an effect must lower the error below this share of what it was
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
    model = named('modified')
    progress(0.0, 'hysteresis')
    best = output_error(model, training, count=2)
    errors = _errors(best, records, cuts)
    steps = [Step('hysteresis', len(best.free), *errors, True)]
    for k, effect in enumerate(LADDER, start=1):
        progress(k / (len(LADDER) + 1), effect)
        tried = _with(model, effect)
        known = {name: best.values[name] for name in tried.free_names if name in best.values}
        result = output_error(tried, training, start=known, count=3 if effect == 'mode' else 1)
        trained, held_out = _errors(result, records, cuts)
        kept = held_out <= _TOLERATED * errors[1] and (
            held_out <= _GAIN * errors[1] or trained <= _GAIN * errors[0]
        )
        steps.append(Step(effect, len(result.free), trained, held_out, kept))
        if kept:
            model, best, errors = tried, result, (trained, held_out)
    start = {name: best.values[name] for name in model.free_names}
    return Choice(model, start, tuple(steps))


def _with(model: Model, effect: str) -> Model:
    if effect == 'mode':
        return named('bouc_wen_mode').free('A0')
    # scaled to the range of the records by output_error, so not here
    return add_effect(model, described(effect)[0]).model


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
