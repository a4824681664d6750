"""Limits of the voltage for one model: the only place where defaults are chosen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

from piezo_hysteresis.common.wording import enumerated
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile

# Rate without a model or a request [Hz].
_RATE = 1000.0
# Time in which the ramp to the safe voltage passes the whole range [s].
_RAMP = 2.4
# Ends of the names of parameters that are frequencies of modes.
_MODES = ('natural_frequency', 'resonance_frequency')
# What a plant that knows its limits calls them.
_OF_PLANT = {'low': 'low_v', 'high': 'high_v', 'slew': 'slew_v_per_s'}
#: Beginning of every refusal and warning about it.
UNSTATED = 'the model file does not say at which voltages it was identified'


@dataclass(frozen=True)
class OperatingLimits:
    """What bounds the voltage of a chain, and why."""

    limits: Limits  # range and slew rate
    rest: float  # voltage at rest, to which the chain returns without a reference [V]
    warnings: tuple[str, ...] = ()  # what the user should know about the limits, in sentences
    assumed: tuple[str, ...] = ()  # names of the limits that nothing states

    def require_known(self) -> None:
        """Refuse limits that nothing states, where the model chooses the voltages itself."""
        if self.assumed:
            raise CompensationError(
                f'{UNSTATED}: identify again, or give {enumerated(self.assumed)}'
            )

    @property
    def safe_ramp(self) -> float:
        """Slew rate of the way back to rest [V/s]."""
        return (self.limits.high - self.limits.low) / _RAMP


def operating_limits(
    model: ModelFile | None,
    *,
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    plant: Mapping[str, Any] | None = None,
) -> OperatingLimits:
    """Return the limits of the voltage for a model.

    A value of the user has priority, then that of a plant that knows its own, then what the
    records of the model covered. Without any of them the limits are those of `Limits`, for a
    small actuator.
    """
    known = plant or {}
    given = {'low': low, 'high': high, 'slew': slew}
    covered = model.provenance.voltage if model is not None else None
    found: dict[str, float] = {}
    unknown = []
    for name, value in given.items():
        if value is not None:
            found[name] = value
        elif _OF_PLANT[name] in known:
            found[name] = float(known[_OF_PLANT[name]])
        elif covered is not None:
            found[name] = getattr(covered, name)
        else:
            found[name] = getattr(Limits, name)
            unknown.append(name)
    limits = Limits(**found)
    rest = covered.rest if covered is not None else 0.0
    rest = min(max(rest, limits.low), limits.high)
    return OperatingLimits(limits, rest, _unknown(limits, unknown, model), tuple(unknown))


def _unknown(limits: Limits, names: list[str], model: ModelFile | None) -> tuple[str, ...]:
    if not names or model is None:
        return ()
    numbers = []
    if 'low' in names or 'high' in names:
        numbers.append(f'{limits.low:g} to {limits.high:g} V')
    if 'slew' in names:
        numbers.append(f'{limits.slew:g} V/s')
    sentence = (
        f'{UNSTATED}: the limits are {" and ".join(numbers)}; identify again, or give '
        f'{", ".join(names)}'
    )
    return (sentence,)


def rate_of(model: ModelFile | None, rate: float | None = None) -> float:
    """Return the rate that was asked for, that of the records of a model, or 1000 Hz."""
    known = model.provenance.rate if model is not None else None
    given = rate if rate is not None else known or _RATE
    if not (isinstance(given, Real) and math.isfinite(given) and given > 0):
        raise CompensationError(f'the rate must be positive [Hz], got {given!r}')
    return float(given)


def limited(limits: Limits) -> dict[str, str]:
    """Return what each counter of the limiter means, in words, by its name."""
    return {
        'out_of_range': f'the voltage is cut at {limits.low:g} and {limits.high:g} V',
        'slew_limited': f'the voltage is slowed down to {limits.slew:g} V/s',
        'energy_limited': 'the voltage is slowed down to keep energy_limit',
        'not_finite': 'what came in is not a number: the voltage is held',
    }


def limited_samples(limits: Limits, counts: Mapping[str, int], samples: int) -> tuple[str, ...]:
    """Return how many of so many samples the limiter changed, in sentences."""
    return tuple(
        f'{what} ({counts[key]} of {samples} samples)'
        for key, what in limited(limits).items()
        if counts[key]
    )


def above_nyquist(model: ModelFile | None, dt: float) -> tuple[str, ...]:
    """Return a sentence for each mode that a loop of ticks of `dt` [s] cannot sample."""
    if model is None:
        return ()
    nyquist = 0.5 / dt
    return tuple(
        f'the mode at {mode:g} Hz is not below half the rate of the loop, {nyquist:g} Hz: it '
        'cannot be compensated, and steps of the voltage excite it; raise the rate or use a '
        'slower reference'
        for mode in _modes(model)
        if mode >= nyquist
    )


def _modes(model: ModelFile) -> list[float]:
    """Return the natural frequencies of a model [Hz]."""
    values = model.values
    found = [values[name] for name in values if name.endswith(_MODES)]
    if 'mass' in values:
        found.append(math.sqrt(values['stiffness'] / values['mass']) / (2.0 * math.pi))
    return found
