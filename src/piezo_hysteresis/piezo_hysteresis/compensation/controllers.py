"""Builds the controllers of a chain from one settings object: for nodes, studies and C code."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from piezo_hysteresis.compensation.feedback.feedback_link import HInfinityWeights, PidGains
from piezo_hysteresis.compensation.feedback.pid import FuzzyPid, FuzzyRules, Pid
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    HarmonicAttenuation,
    ScheduledAttenuation,
)
from piezo_hysteresis.compensation.harmonics.lines import METHODS, AttenuationSettings
from piezo_hysteresis.compensation.inverses.inverse_choice import (
    ScheduledInverse,
    inverse_for,
    mode_of,
    model_gain,
)
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.linear_gain import LinearGain, ModeGain, PulseGain
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile

if TYPE_CHECKING:
    from piezo_hysteresis.compensation.feedback.hinf import HInfinityDesign

ATTENUATIONS = (*METHODS, 'none')
_NAMES = {'pid': 'PID', 'fuzzy_pid': 'fuzzy PID', 'h_infinity': 'H-infinity'}
#: Assumed quasi-static gain of an unknown plant [m/V].
GUESS = 1e-4
# Largest first step for an unknown plant: near a mode its gain may be 30 times the guess, and the
# error then at most doubles.
UNKNOWN_PLANT = 0.05
#: Numerator and denominator of a transfer function in s, the highest power first.
Polynomials = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class Feedback:
    """A law on the error: its kind, and what belongs to it."""

    kind: str  # one of `FEEDBACKS` but ``none``
    gains: PidGains = field(default_factory=PidGains)  # of PID and fuzzy PID
    rules: FuzzyRules | None = None  # of fuzzy PID
    weights: HInfinityWeights = field(default_factory=HInfinityWeights)
    plant: Polynomials | None = None
    mode: ModeGain | None = None  # the plant as gain and mode, instead of those of the model

    @property
    def name(self) -> str:
        """What people call it."""
        return _NAMES[self.kind]


@dataclass(frozen=True)
class Controllers:
    """Settings of a whole chain, which build its links."""

    dt: float  # sampling interval [s]
    limits: Limits = field(default_factory=Limits)  # of the voltage
    model: ModelFile | None = None  # model to invert
    law: str = 'auto'  # name of the inverse, see `inverse_for`
    start: float = 0.5  # durations of the initial fade-in of the reference [s]
    transition: float = 0.2  # of transitions [s]
    attenuation: AttenuationSettings | None = None  # attenuation of harmonics
    feedback: Feedback | None = None  # law on the error
    gain_model: ModelFile | None = None  # model of the plant gain for the attenuation
    plant: ModeGain | None = None  # gain and mode that steer the attenuation, instead of a model's

    @property
    def amplitude(self) -> float:
        """Half the range of the voltage [V]."""
        return 0.5 * (self.limits.high - self.limits.low)

    def gain(self) -> LinearGain | None:
        """Return the gain for small tones, None for an unknown plant."""
        given = self.gain_model or self.model
        return self.plant or (None if given is None else self._gain_of(given))

    @property
    def scheduled_plant(self) -> ModelFile | None:
        """The model whose entries state the gain of the plant by drive, None if there is none."""
        given = None if self.plant is not None else self.gain_model or self.model
        return given if given is not None and given.schedule is not None else None

    def mode(self, *, of_feedback: bool = False) -> ModeGain | None:
        """Return the plant as a gain, a mode and a delay: that of the attenuation or feedback."""
        given, plant = self.gain_model or self.model, self.plant
        if of_feedback:
            given, plant = self.model, None if self.feedback is None else self.feedback.mode
        if plant is not None or given is None:
            return plant
        gain = self._gain_of(given)(0.0).real
        return mode_of(given.model.unpack(given.packed), gain, self.dt)

    def _gain_of(self, given: ModelFile) -> PulseGain:
        return model_gain(given.model, given.values, self.dt, self.amplitude)

    def straight(self) -> Link:
        """Return no compensation: the reference divided by the gain."""
        assert self.model is not None
        return replace(self, law='gain').inverse(replace(self.model, schedule=None))

    def inverse(self, model: ModelFile | None = None) -> InverseLink | ScheduledInverse:
        """Return the feedforward of another model or that of the chain, by entry of a schedule."""
        loaded = model or self.model
        assert loaded is not None
        if loaded.schedule is not None:
            return ScheduledInverse(
                loaded, self._inverse_of_one, self.dt, self.limits, self.transition
            )
        return self._inverse_of_one(loaded)

    def _inverse_of_one(self, loaded: ModelFile) -> InverseLink:
        return inverse_for(
            loaded.model, loaded.values, self.dt, limits=self.limits, start=self.start,
            transition=self.transition, scale=self.amplitude, law=self.law,
        )  # fmt: skip

    def attenuate(self, gain: LinearGain | None = None) -> Link:
        """Return the attenuation of harmonics, steered by `gain` or by that of the plant."""
        settings = self.attenuation
        assert settings is not None
        scheduled = self.scheduled_plant
        if gain is None and scheduled is not None:
            return ScheduledAttenuation(
                settings, scheduled, self._gain_of, self.dt, self.limits, self._decay(),
                self.transition,
            )  # fmt: skip
        gain = gain or self.gain()
        if gain is None:
            gain = ModeGain(GUESS, dt=self.dt)
            settings = replace(settings, first_step=min(settings.first_step, UNKNOWN_PLANT))
        return HarmonicAttenuation(settings, gain, self.dt, self.limits, self._decay())

    def _decay(self) -> float:
        """Return the time constant of the mode [s], infinite for an unknown plant."""
        mode = self.mode()
        if mode is None:
            return math.inf
        if mode.natural_frequency == 0.0:
            return 0.0
        return 1.0 / (2.0 * math.pi * mode.natural_frequency * mode.damping_ratio)

    def feed_back(self) -> Link:
        """Return the law on the error."""
        asked = self.feedback
        assert asked is not None
        if asked.kind == 'h_infinity':
            # SciPy takes long to import, and only this law needs it.
            from piezo_hysteresis.compensation.feedback.hinf import HInfinity

            found = _designed(asked.weights, asked.plant or self._polynomials(), self.dt)
            return HInfinity(found.controller, self.dt, limits=self.limits, words=found.words())
        if asked.rules is not None:
            return FuzzyPid(asked.gains, asked.rules, self.dt, limits=self.limits)
        return Pid(asked.gains, self.dt, limits=self.limits)

    def _polynomials(self) -> Polynomials:
        """Return gain and mode of the plant as a transfer function."""
        mode = self.mode(of_feedback=True)
        if mode is None or mode.natural_frequency == 0.0:
            given = (
                '' if self.model is None else f', and model {self.model.model.name} has no mode'
            )
            raise CompensationError(
                f'h_infinity needs a plant that falls off{given}; identify a model with +mode, or '
                'give a transfer function (nodes: plant.gain and plant.natural_frequency, or '
                'plant.numerator and plant.denominator)'
            )
        omega = 2.0 * math.pi * mode.natural_frequency
        return (mode.gain * omega**2,), (1.0, 2.0 * mode.damping_ratio * omega, omega**2)

    def links(self, *, by_mode: bool = False) -> list[Link]:
        """Return the whole chain at rest, first to last."""
        links: list[Link] = [self.inverse()]
        if self.attenuation is not None:
            links.append(self.attenuate(self.mode() if by_mode else None))
        if self.feedback is not None:
            links.append(self.feed_back())
        return links


@functools.lru_cache(maxsize=8)
def _designed(weights: HInfinityWeights, plant: Polynomials, dt: float) -> HInfinityDesign:
    from piezo_hysteresis.compensation.feedback import hinf

    try:
        system = hinf.transfer_function(*plant)
    except (ValueError, IndexError):
        raise CompensationError(
            'plant.numerator / plant.denominator is no proper transfer function'
        ) from None
    return hinf.design(system, weights, dt).require_usable()
