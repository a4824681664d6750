"""The laws that the parameters of a link describe: attenuation of harmonics, and feedback."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol

from piezo_hysteresis.compensation.controllers import GUESS, Controllers, Feedback, Polynomials
from piezo_hysteresis.compensation.feedback.feedback_link import HInfinityWeights, PidGains
from piezo_hysteresis.compensation.feedback.pid import FuzzyRules, Pid, read_tables
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    HarmonicAttenuation,
    ScheduledAttenuation,
)
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.inverses.inverse_choice import ScheduledInverse
from piezo_hysteresis.compensation.inverses.inverse_link import HISTORY, InverseLink
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import Limits, Link, ReferencePoint
from piezo_hysteresis.errors import CompensationError, PiezoError
from piezo_hysteresis.models import ModelFile


@dataclass
class Inversion:
    """The inverse of the loaded model, while models come and go."""

    settings: Controllers  # of the feedforward; its model is the one in force
    _inverse: InverseLink | ScheduledInverse | None = None
    _past: deque[ReferencePoint] = field(default_factory=lambda: deque(maxlen=HISTORY))

    @property
    def loaded(self) -> ModelFile | None:
        """The model in force."""
        return self.settings.model

    def take(self, loaded: ModelFile) -> bool:
        """Invert `loaded` from now on; return whether the output may jump by that.

        Parameters of the same chain go over smoothly by themselves.
        """
        before, jumps = self._inverse, False
        if loaded.schedule is not None and isinstance(before, ScheduledInverse):
            before.update(loaded)
        elif (
            loaded.schedule is None
            and _chain(loaded) == _chain(self.loaded)
            and isinstance(before, InverseLink)
        ):
            before.set_parameters(loaded.values)
        else:
            self._inverse, jumps = self._inverted(loaded), True
        self.settings = replace(self.settings, model=loaded)
        return jumps

    def change(self, settings: Controllers, *, rebuild: bool) -> None:
        """Take other settings over with the model in force; where rebuilt the output may jump."""
        self.settings = replace(settings, model=self.loaded)
        if rebuild and self.loaded is not None:
            self._inverse = self._inverted(self.loaded)

    def refusal(self, law: str, loaded: ModelFile | None = None) -> str:
        """Return '' or why a model, without one that in force, cannot be inverted by a law."""
        loaded = loaded or self.loaded
        if loaded is not None:
            try:
                replace(self.settings, law=law).inverse(loaded)
            except PiezoError as error:
                return str(error)
        return ''

    def voltage(self, point: ReferencePoint) -> float | None:
        """Return the voltage for this tick [V], None where there is no model."""
        self._past.append(point)
        return None if self._inverse is None else self._inverse.step(point, 0.0, None)

    def restart(self) -> None:
        """Start again from rest."""
        self._past.clear()
        if self._inverse is not None:
            self._inverse.reset()

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far, by name."""
        return {} if self._inverse is None else self._inverse.counters()

    def _inverted(self, loaded: ModelFile) -> InverseLink | ScheduledInverse:
        inverse = self.settings.inverse(loaded)
        inverse.step(ReferencePoint(0, 0.0, 0.0, 0.0, 0.0, 0.0))  # compiled before the first tick
        inverse.reset()
        if self._past:
            inverse.follow(self._past)
        return inverse


def _chain(loaded: ModelFile | None) -> list[str]:
    return [] if loaded is None else [block.name for block in loaded.model.blocks]


# The settings of the attenuation are parameters under the same names.
_SETTINGS = tuple(field.name for field in fields(AttenuationSettings))
# Groups of parameters that shape the law of each method.
_GROUPS: dict[str, tuple[str, ...]] = {
    'none': (),
    'pid': ('pid.', 'limits.'),
    'fuzzy_pid': ('pid.', 'fuzzy.', 'limits.'),
    'h_infinity': ('h_infinity.', 'plant.', 'limits.'),
}


def forward_settings(
    values: Mapping[str, Any], dt: float, model: ModelFile | None = None
) -> Controllers:
    """Return the chain that the parameters of the feedforward describe."""
    return Controllers(
        dt, _limits(values), model, law=values['law'], start=values['start'],
        transition=values['transition'],
    )  # fmt: skip


def harmonic_settings(
    values: Mapping[str, Any], dt: float, model: ModelFile | None = None
) -> Controllers:
    """Return the chain that the parameters of the attenuation describe, enabled or not.

    The plant is that of ``plant.*`` or, where ``plant.gain`` is 0, of the loaded `model`.
    """
    given = {name: values[name] for name in _SETTINGS}
    settings = AttenuationSettings(**{**given, 'orders': tuple(given['orders'])})
    plant = _plant(values, dt)
    return Controllers(
        dt, _limits(values), model, transition=values['transition'], attenuation=settings,
        plant=plant,
    )  # fmt: skip


def feedback_settings(
    values: Mapping[str, Any], dt: float, model: ModelFile | None = None
) -> Controllers:
    """Return the chain that the parameters of the feedback describe, see `harmonic_settings`."""
    method, limits = values['method'], _limits(values)
    if method == 'none':
        return Controllers(dt, limits, model)
    scales = _group(values, 'fuzzy.')
    path = scales.pop('tables')
    rules = None
    if method == 'fuzzy_pid':
        rules = FuzzyRules(**scales, **read_tables(path)) if path else FuzzyRules(**scales)
    asked = Feedback(
        method,
        PidGains(**_group(values, 'pid.')),
        rules,
        HInfinityWeights(**_group(values, 'h_infinity.')),
        _polynomials(values) if method == 'h_infinity' else None,
        _plant(values, dt),
    )
    return Controllers(dt, limits, model, feedback=asked)


def chain_settings(
    values: Mapping[str, Mapping[str, Any]], dt: float, model: ModelFile
) -> Controllers:
    """Return the chain that the parameters of all its nodes describe, by node."""
    own = values['attenuation']
    harmonic, path = harmonic_settings(own, dt), own['model_file']
    return replace(
        forward_settings(values['feedforward'], dt, model),
        attenuation=harmonic.attenuation if own['enabled'] else None,
        feedback=feedback_settings(values['feedback'], dt).feedback,
        gain_model=ModelFile.load(path) if path else None,
        plant=harmonic.plant,
    )


def _limits(values: Mapping[str, Any]) -> Limits:
    return Limits(**_group(values, 'limits.'))


def _plant(values: Mapping[str, Any], dt: float) -> ModeGain | None:
    gain, frequency = values['plant.gain'], values['plant.natural_frequency']
    return ModeGain(gain, frequency, values['plant.damping_ratio'], dt) if gain != 0.0 else None


def _polynomials(values: Mapping[str, Any]) -> Polynomials | None:
    numerator, denominator = values['plant.numerator'], values['plant.denominator']
    if any(numerator) != any(denominator):
        raise CompensationError(
            'plant.numerator and plant.denominator belong together; set both in one atomic call'
        )
    return (tuple(numerator), tuple(denominator)) if any(numerator) else None


def _group(values: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    return {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}


class LawMaker(Protocol):
    """Makes the law that the parameters of a node describe."""

    def build(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> Link | None:
        """Return the law of the parameters `values` at ticks of `dt` [s]; None for none.

        The plant is that of `plant.*` or, where ``plant.gain`` is 0, of the loaded `model`.
        """

    def plant(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> ModeGain | None:
        """Return the plant that the law expects, None for any; see `SensorSign.expect`."""

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether the parameter `name` shapes the law of `values` at all."""

    def adjust(
        self,
        law: Link | None,
        values: Mapping[str, Any],
        changed: Collection[str],
        model: ModelFile | None = None,
    ) -> bool:
        """Change `law` to the `changed` of `values`; return False where it takes a new one."""


class HarmonicLaws:
    """Makes attenuations of harmonics, see `LawMaker`."""

    def build(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> Link | None:
        """Return the law with the settings of `values`; None where it is not enabled."""
        law = harmonic_settings(values, dt, model).attenuate()
        return law if values['enabled'] else None

    def plant(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> ModeGain | None:
        """Return the plant; without one its gain is estimated, whatever its sign."""
        return harmonic_settings(values, dt, model).mode()

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether `name` is a setting of the law."""
        return name in _SETTINGS or name == 'enabled' or name.startswith('plant.')

    def adjust(
        self,
        law: Link | None,
        values: Mapping[str, Any],
        changed: Collection[str],
        model: ModelFile | None = None,
    ) -> bool:
        """Take a new model of the plant gain without forgetting the correction."""
        if not all(name.startswith('plant.') for name in changed):
            return False
        if not isinstance(law, HarmonicAttenuation):
            return True
        settings = harmonic_settings(values, law.dt, model)
        scheduled = settings.scheduled_plant
        if (scheduled is not None) != isinstance(law, ScheduledAttenuation):
            return False
        if scheduled is not None and isinstance(law, ScheduledAttenuation):
            law.update(scheduled)
        else:
            law.set_gain(settings.gain() or ModeGain(GUESS, dt=law.dt))
        return True


class FeedbackLaws:
    """Makes laws on the tracking error, see `LawMaker`."""

    def build(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> Link | None:
        """Return the law of `values`; None for ``none``."""
        settings = feedback_settings(values, dt, model)
        return None if settings.feedback is None else settings.feed_back()

    def plant(
        self, values: Mapping[str, Any], dt: float, model: ModelFile | None = None
    ) -> ModeGain | None:
        """Return the plant; the gains of a PID are those for a plant that rises."""
        settings = feedback_settings(values, dt, model)
        given = None if settings.feedback is None else settings.feedback.plant
        if given is not None:
            last, divisor = given[0][-1], given[1][-1]
            return ModeGain(last / divisor, dt=dt) if divisor else None
        plant = settings.mode(of_feedback=True)
        if values['method'] == 'h_infinity':
            return plant
        if plant is None:
            return ModeGain(math.inf, dt=dt)
        return plant._replace(gain=abs(plant.gain))

    def shapes(self, values: Mapping[str, Any], name: str) -> bool:
        """Return whether `name` matters for the method in force."""
        return name == 'method' or name.startswith(_GROUPS[values['method']])

    def adjust(
        self,
        law: Link | None,
        values: Mapping[str, Any],
        changed: Collection[str],
        model: ModelFile | None = None,
    ) -> bool:
        """Change the gains of a PID in place: its integral carries on."""
        if not isinstance(law, Pid) or not all(name.startswith('pid.') for name in changed):
            return False
        law.set_gains(PidGains(**_group(values, 'pid.')))
        return True
