"""The feedback that the parameters of its node describe: PID, fuzzy PID or H-infinity."""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Mapping
from typing import Any

from piezo_hysteresis.compensation.feedback.feedback_settings import HInfinityWeights, PidGains
from piezo_hysteresis.compensation.feedback.fuzzy_pid import FuzzyPid, FuzzyRules
from piezo_hysteresis.compensation.feedback.fuzzy_tables import read_tables
from piezo_hysteresis.compensation.feedback.pid import Pid
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.runtime.known_plant import known_mode
from piezo_hysteresis.runtime.laws import Law

# Groups of parameters that shape the law of each method.
_GROUPS: dict[str, tuple[str, ...]] = {
    'none': (),
    'pid': ('pid.', 'limits.'),
    'fuzzy_pid': ('pid.', 'fuzzy.', 'limits.'),
    'h_infinity': ('h_infinity.', 'plant.', 'limits.'),
}


class FeedbackLaws:
    """Makes laws on the tracking error, see `LawMaker`."""

    def build(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> Law | None:
        """Return the law of `values`; None for ``none``."""
        limits = Limits(values['limits.low'], values['limits.high'], values['limits.slew'])
        method = values['method']
        if method == 'none':
            return None
        if method == 'h_infinity':
            return _h_infinity(
                _group(values, 'h_infinity.'), _plant(values, dt, model), dt, limits
            )
        gains = PidGains(**_group(values, 'pid.'))
        if method == 'pid':
            return Pid(gains, dt, limits=limits)
        scales = _group(values, 'fuzzy.')
        path = scales.pop('tables')
        rules = FuzzyRules(**scales, **read_tables(path)) if path else FuzzyRules(**scales)
        return FuzzyPid(gains, rules, dt, limits=limits)

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether `name` matters for the method in force."""
        return name == 'method' or name.startswith(_GROUPS[values['method']])

    def adjust(
        self,
        law: Law | None,
        values: Mapping[str, Any],
        changed: Collection[str],
        model: ModelFile | None = None,
    ) -> bool:
        """Change the gains of a PID in place: its integral carries on."""
        if not isinstance(law, Pid) or not all(name.startswith('pid.') for name in changed):
            return False
        law.set_gains(PidGains(**_group(values, 'pid.')))
        return True


def _group(values: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    return {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}


Polynomials = tuple[tuple[float, ...], tuple[float, ...]]


def _plant(values: Mapping[str, Any], dt: float, model: ModelFile | None) -> Polynomials:
    """Return numerator and denominator of the plant in s."""
    numerator, denominator = values['plant.numerator'], values['plant.denominator']
    if any(numerator) and any(denominator):
        return tuple(numerator), tuple(denominator)
    if any(numerator) or any(denominator):
        raise CompensationError(
            'plant.numerator and plant.denominator belong together; set both in one atomic call'
        )
    mode = known_mode(values, dt, model)
    if mode is None or mode.natural_frequency == 0.0:
        raise CompensationError(
            'h_infinity needs a plant that falls off: give a model_file with a mode, plant.gain '
            'and plant.natural_frequency, or a numerator and denominator'
        )
    omega = 2.0 * math.pi * mode.natural_frequency
    return (mode.gain * omega**2,), (1.0, 2.0 * mode.damping_ratio * omega, omega**2)


def _h_infinity(weights: dict[str, Any], plant: Polynomials, dt: float, limits: Limits) -> Law:
    # SciPy takes long to import, and only this method needs it.
    from piezo_hysteresis.compensation.feedback.hinf import HInfinity

    found = _designed(tuple(weights.items()), plant, dt)
    return HInfinity(found.controller, dt, limits=limits, words=found.words())


@functools.lru_cache(maxsize=8)
def _designed(weights: tuple[tuple[str, Any], ...], plant: Polynomials, dt: float) -> Any:
    from piezo_hysteresis.compensation.feedback import hinf

    try:
        system = hinf.transfer_function(*plant)
    except (ValueError, IndexError):
        raise CompensationError(
            'plant.numerator / plant.denominator is no proper transfer function'
        ) from None
    return hinf.design(system, HInfinityWeights(**dict(weights)), dt).require_usable()
