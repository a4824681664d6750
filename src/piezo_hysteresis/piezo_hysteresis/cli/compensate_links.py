"""The controllers of a study: the links of the chain, from the arguments of the verb."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, get_type_hints

from piezo_hysteresis.compensation.feedback.feedback_settings import HInfinityWeights, PidGains
from piezo_hysteresis.compensation.feedback.fuzzy_pid import FuzzyPid, FuzzyRules
from piezo_hysteresis.compensation.feedback.fuzzy_tables import read_tables
from piezo_hysteresis.compensation.feedback.pid import Pid
from piezo_hysteresis.compensation.harmonics.attenuation_settings import (
    METHODS,
    AttenuationSettings,
)
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import HarmonicAttenuation
from piezo_hysteresis.compensation.harmonics.repetitive import OddRepetitive, RepetitiveSettings
from piezo_hysteresis.compensation.inverses.frequency_switch import FrequencySwitch
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for, mode_of, model_gain
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.inverses.physical import structure_coefficients
from piezo_hysteresis.compensation.linear_gain import LinearGain, ModeGain
from piezo_hysteresis.compensation.link import INVERSES, Limits, Link
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.identification.arx import TransferFunction
from piezo_hysteresis.models.modelfile import ModelFile

REPETITIVE = 'repetitive'
ATTENUATIONS = (*METHODS, REPETITIVE, 'none')
DEFAULT = AttenuationSettings()
FEEDBACKS = ('none', 'pid', 'fuzzy_pid', 'h_infinity')
_NAMES = {'pid': 'PID', 'fuzzy_pid': 'fuzzy PID', 'h_infinity': 'H-infinity'}


@dataclass(frozen=True)
class Feedback:
    """A law on the error: its kind, and what belongs to it.

    Attributes
    ----------
    kind : str
        One of `FEEDBACKS` but ``none``.
    gains : PidGains or None
        Of PID and fuzzy PID.
    rules : FuzzyRules or None
        Of fuzzy PID.
    weights : mapping
        Of H-infinity, as `HInfinityWeights` takes them.
    plant : TransferFunction or None
        What H-infinity is designed for; the mode of the model where not given.
    """

    kind: str
    gains: PidGains | None = None
    rules: FuzzyRules | None = None
    weights: Mapping[str, Any] | None = None
    plant: TransferFunction | None = None

    @property
    def name(self) -> str:
        """What people call it."""
        return _NAMES[self.kind]


@dataclass(frozen=True)
class Repetition:
    """What a user chooses of repetitive control, see `RepetitiveSettings`."""

    learning: float = RepetitiveSettings.learning
    lead_ticks: float = RepetitiveSettings.lead_ticks
    lowest_frequency: float = RepetitiveSettings.lowest_frequency


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that select controllers."""
    forward = parser.add_argument_group('feedforward')
    forward.add_argument(
        '--law', choices=INVERSES, default='auto', help='how the model is inverted; laws of papers'
    )
    forward.add_argument('--slow-model', metavar='YAML', help='another model for slow drives')
    forward.add_argument(
        '--switch',
        type=float,
        default=1.0,
        metavar='HZ',
        help='highest frequency of slow drives (1)',
    )
    harmonics = parser.add_argument_group('attenuation of harmonics')
    add = harmonics.add_argument
    add('--attenuation', choices=ATTENUATIONS, default=DEFAULT.method, help='its method')
    orders = list(DEFAULT.orders)
    shown = ' '.join(map(str, orders))
    add('--orders', type=int, nargs='+', default=orders, help=f'harmonics to attenuate ({shown})')
    add(
        '--resonance',
        type=float,
        default=DEFAULT.resonance,
        help='add the orders that it amplifies [Hz]; afc only',
    )
    add(
        '--gain-model',
        metavar='YAML',
        help='model for the plant gain (default: the inverted model)',
    )
    add(
        '--attenuation-set',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='further settings: sign_rule=printed, switch_frequency=66, fit=sines, gain=1e4, ...',
    )
    feedback = parser.add_argument_group('feedback')
    add = feedback.add_argument
    add('--feedback', choices=FEEDBACKS, help='feedback law; pid with --pid')
    add(
        '--pid',
        type=float,
        nargs=3,
        metavar=('KP', 'KI', 'KD'),
        help='gains of pid and fuzzy_pid [V/m], [V/(m s)], [V s/m]',
    )
    add(
        '--fuzzy',
        type=float,
        nargs=4,
        metavar=('E', 'RATE', 'DKP', 'DKI'),
        help='error [m] and rate [m/s] that are big, largest changes of the gains',
    )
    add('--fuzzy-tables', metavar='YAML', help='its rules, like config/fuzzy/symmetric.yaml')
    add('--bandwidth', type=float, metavar='HZ', help='of h_infinity')
    add(
        '--h-infinity-set',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='its other weights: steady_error, peak, control, delay_ticks',
    )
    add(
        '--transfer-function',
        metavar='YAML',
        help='its plant, from the verb linear (default: that of the model)',
    )
    add('--together', action='store_true', help='one more run, with attenuation and feedback')


def attenuation_of(arguments: argparse.Namespace) -> AttenuationSettings | Repetition | None:
    """Return the settings of the attenuation, None where there shall be none.

    Raises
    ------
    CompensationError
        If one is unknown or impossible.
    """
    if arguments.attenuation == 'none':
        return None
    if arguments.attenuation == REPETITIVE:
        return _repetition(arguments)
    kinds = get_type_hints(AttenuationSettings)
    known = [f.name for f in fields(AttenuationSettings)]
    more = _settings(arguments.attenuation_set, known[3:], 'the attenuation')
    return AttenuationSettings(
        method=arguments.attenuation,
        orders=tuple(arguments.orders),
        resonance=arguments.resonance,
        **{name: _number(name, v) if kinds[name] is float else v for name, v in more.items()},  # type: ignore[arg-type]
    )


def _repetition(arguments: argparse.Namespace) -> Repetition:
    if arguments.resonance:
        raise CompensationError('--resonance belongs to --attenuation afc')
    if list(arguments.orders) != list(DEFAULT.orders):
        raise CompensationError(
            '--attenuation repetitive takes every odd order; leave --orders out'
        )
    known = [each.name for each in fields(Repetition)]
    more = _settings(arguments.attenuation_set, known, 'repetitive control')
    return Repetition(**{name: _number(name, value) for name, value in more.items()})


def feedback_of(arguments: argparse.Namespace) -> Feedback | None:
    """Return the feedback, None where there shall be none.

    Raises
    ------
    CompensationError
        If something is missing, superfluous or impossible.
    """
    kind = arguments.feedback or ('none' if arguments.pid is None else 'pid')
    belongs = {
        'pid': ('pid', 'fuzzy_pid'),
        'fuzzy': ('fuzzy_pid',),
        'fuzzy_tables': ('fuzzy_pid',),
        'bandwidth': ('h_infinity',),
        'h_infinity_set': ('h_infinity',),
        'transfer_function': ('h_infinity',),
    }
    for option, kinds in belongs.items():
        if getattr(arguments, option) and kind not in kinds:
            raise CompensationError(
                f'--{option.replace("_", "-")} belongs to --feedback {" or ".join(kinds)}'
            )
    needed = {'pid': ('pid',), 'fuzzy_pid': ('pid', 'fuzzy'), 'h_infinity': ('bandwidth',)}
    for option in needed.get(kind, ()):
        if getattr(arguments, option) is None:
            raise CompensationError(f'--feedback {kind} needs --{option}')
    if kind == 'none':
        return None
    if kind == 'h_infinity':
        weights = _settings(
            arguments.h_infinity_set, ('steady_error', 'peak', 'control', 'delay_ticks'),
            'h_infinity',
        )  # fmt: skip
        numbers = {name: _number(name, value) for name, value in weights.items()}
        path = arguments.transfer_function
        return Feedback(
            kind,
            weights={'bandwidth': arguments.bandwidth, **numbers},
            plant=TransferFunction.load(path) if path else None,
        )
    gains = PidGains(*arguments.pid)
    if kind == 'pid':
        return Feedback(kind, gains)
    scales = arguments.fuzzy
    path = arguments.fuzzy_tables
    rules = FuzzyRules(*scales, **read_tables(path)) if path else FuzzyRules(*scales)
    return Feedback(kind, gains, rules)


def _settings(assignments: Sequence[str], known: Sequence[str], what: str) -> dict[str, str]:
    found = {}
    for assignment in assignments:
        name, equals, value = assignment.partition('=')
        if not equals or name not in known:
            raise CompensationError(
                f'{assignment!r} is no setting of {what}; write NAME=VALUE with {", ".join(known)}'
            )
        found[name] = value
    return found


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CompensationError(f'{name} must be a number, got {text!r}')
    return value


@dataclass(frozen=True)
class Builder:
    """Builds links for one model, rate and range.

    Attributes
    ----------
    model, slow : ModelFile, ModelFile or None
        What is inverted; for slow drives another one, where given.
    law : str
        By which, see `inverse_for`.
    switch : float
        Up to which frequency drives are slow [Hz].
    dt : float
        Sampling interval [s].
    limits : Limits
        Of the voltage.
    gain_model : ModelFile or None
        Whose gain steers the attenuation; `model` where not given.
    """

    model: ModelFile
    slow: ModelFile | None
    law: str
    switch: float
    dt: float
    limits: Limits
    gain_model: ModelFile | None = None

    @property
    def amplitude(self) -> float:
        """Half the range of the voltage [V]."""
        return 0.5 * (self.limits.high - self.limits.low)

    def gain(self) -> LinearGain:
        """Return the gain for small tones that steers the attenuation."""
        return self._gain_of(self.gain_model or self.model)

    def _gain_of(self, given: ModelFile) -> LinearGain:
        return model_gain(given.model, given.values, self.dt, self.amplitude)

    def mode_gain(self) -> ModeGain:
        """Return it as the nodes have it: a mode and a delay."""
        given = self.gain_model or self.model
        values = given.model.unpack(given.packed)
        return mode_of(values, abs(self.gain()(0.0)), self.dt)

    def straight(self) -> Link:
        """Return no compensation: the reference divided by the gain."""
        return self._inverse(self.model, 'gain')

    def inverse(self) -> Link:
        """Return the feedforward."""
        fast = self._inverse(self.model, self.law)
        if self.slow is None:
            return fast
        slow = self._inverse(self.slow, self.law)
        return FrequencySwitch(slow, fast, self.switch, self.dt, limits=self.limits)

    def _inverse(self, loaded: ModelFile, law: str) -> InverseLink:
        return inverse_for(
            loaded.model,
            loaded.values,
            self.dt,
            limits=self.limits,
            scale=self.amplitude,
            law=law,
        )

    def attenuation(
        self, settings: AttenuationSettings | Repetition, gain: LinearGain | None = None
    ) -> Link:
        """Return the attenuation of harmonics, steered by `gain` or by that of the model."""
        if isinstance(settings, Repetition):
            return self._repetitive(settings)
        return HarmonicAttenuation(settings, gain or self.gain(), self.dt)

    def _repetitive(self, settings: Repetition) -> Link:
        """Return repetitive control with the gain and the mode of the model."""
        mode = self.mode_gain()
        plant = (mode.gain, mode.natural_frequency, mode.damping_ratio)
        return OddRepetitive(RepetitiveSettings(*plant, **vars(settings)), self.dt)

    def feedback(self, asked: Feedback) -> Link:
        """Return the law on the error.

        Raises
        ------
        CompensationError
            If an H-infinity controller does less than was asked for.
        """
        if asked.kind == 'h_infinity':
            return self._h_infinity(asked.weights or {}, asked.plant)
        assert asked.gains is not None
        if asked.rules is not None:
            return FuzzyPid(asked.gains, asked.rules, self.dt, limits=self.limits)
        return Pid(asked.gains, self.dt, limits=self.limits)

    def _h_infinity(self, weights: Mapping[str, Any], given: TransferFunction | None) -> Link:
        from piezo_hysteresis.compensation.feedback import hinf

        k1, k2 = structure_coefficients(self.model.model.unpack(self.model.packed))
        if given is not None:
            plant = hinf.transfer_function(given.numerator, given.denominator)
        elif k2 == 0.0:
            raise CompensationError(
                f'h_infinity needs a plant that falls off, and model {self.model.model.name} has '
                'no mode; identify it with +mode, or give --transfer-function'
            )
        else:
            plant = hinf.transfer_function([abs(self._gain_of(self.model)(0.0))], [k2, k1, 1.0])
        found = hinf.design(plant, HInfinityWeights(**weights), self.dt).require_usable()
        return hinf.HInfinity(found.controller, self.dt, limits=self.limits, words=found.words())
