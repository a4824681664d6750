"""Validation of user settings before a computation: values, budgets and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from numbers import Integral, Real

from piezo_hysteresis.common.wording import near
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record


def require_settings(
    *,
    seed: int = 0,
    workers: int = 1,
    max_evaluations: int | None = None,
    forgetting: float | None = None,
) -> None:
    """Raise an error for invalid settings."""
    whole = {'seed': seed, 'number of workers': workers, 'budget': max_evaluations or 1}
    for name, value in whole.items():
        if not isinstance(value, Integral):
            raise IdentificationError(f'the {name} must be a whole number, got {value!r}')
    if seed < 0:
        raise IdentificationError(f'the seed must be 0 or more, got {seed}')
    if workers < 1:
        raise IdentificationError(f'the number of workers must be 1 or more, got {workers}')
    if max_evaluations is not None and max_evaluations < 1:
        raise IdentificationError(
            f'the budget must be at least 1 evaluation, got {max_evaluations}; leave '
            'max-evaluations out for the usual one'
        )
    if forgetting is not None and not isinstance(forgetting, Real):
        raise IdentificationError(f'forgetting must be a number, got {forgetting!r}')
    if forgetting is not None and not 0.0 < forgetting <= 1.0:
        raise IdentificationError(
            f'forgetting must be above 0 and at most 1, got {forgetting:g}; 1 disables forgetting'
        )


def held_at(model: Model, hold: Mapping[str, float], start: Mapping[str, float]) -> Model:
    """Return the model with the given values held; raise an error for invalid ones."""
    known = {q.name: q for q in model.parameters}
    for verb, given in (('hold', hold), ('start from', start)):
        if not isinstance(given, Mapping):
            raise IdentificationError(
                f'values to {verb} are a dictionary of parameters, not of type '
                f'{type(given).__name__}'
            )
        for name, value in given.items():
            if name not in known:
                raise IdentificationError(
                    f'model {model.name} has no parameter {name} to {verb}{near(name, known)}; '
                    f'it has {", ".join(known)}'
                )
            q = known[name]
            if not (isinstance(value, Real) and isfinite(value)):
                raise IdentificationError(f'{name} = {value} is not a number to {verb}')
            # the bounds of a parameter that the model holds coincide at its value
            if name not in model.held and not q.low <= value <= q.high:
                raise IdentificationError(
                    f'{name} = {value:g} {q.unit} is impossible to {verb}: it lies within '
                    f'{q.low:g} .. {q.high:g}'
                )
    for name in start:
        at = hold.get(name, model.held.get(name, start[name]))
        if at != start[name]:
            raise IdentificationError(
                f'{name} is held at {at:g}, so it cannot start from {start[name]:g}; give one of '
                'them'
            )
    return model.hold(**hold)


def warmed(records: Sequence[Record], warm_up: float | None) -> list[Record]:  # warm_up [s]
    """Return records with another warm-up."""
    if warm_up is None:
        return list(records)
    if not (isfinite(warm_up) and warm_up >= 0.0):
        raise IdentificationError(f'the warm-up must be 0 s or more, got {warm_up:g} s')
    short = min(records, key=lambda record: record.duration)
    if warm_up > 0.9 * short.duration:
        raise IdentificationError(
            f'a warm-up of {warm_up:g} s leaves too little of record {short.name}, which lasts '
            f'{short.duration:.4g} s'
        )
    return [replace(r, info=replace(r.info, warm_up=warm_up)) for r in records]


def driven_at(records: Sequence[Record], frequency: float | None) -> list[Record]:
    """Return records with a given drive frequency, for records without their own."""
    if frequency is None:
        return list(records)
    slowest = min(record.rate for record in records)
    if not 0.0 < frequency < 0.5 * slowest:
        raise IdentificationError(
            f'a drive of {frequency:g} Hz cannot be seen in records of {slowest:g} samples/s; it '
            f'lies between 0 and {0.5 * slowest:g} Hz'
        )
    return [
        r if r.info.frequency > 0.0 else replace(r, info=replace(r.info, frequency=frequency))
        for r in records
    ]


def pairs(assignments: Sequence[str]) -> dict[str, float]:
    """Return the values of arguments of the form NAME=VALUE, in SI units."""
    found: dict[str, float] = {}
    for assignment in assignments:
        name, equals, value = assignment.partition('=')
        if name in found:
            raise IdentificationError(f'{name} is given twice; give it once')
        try:
            found[name] = float(value)
        except ValueError:
            equals = ''
        if not equals:
            raise IdentificationError(
                f'{assignment!r} should be NAME=VALUE with a number in SI units'
            )
    return found
