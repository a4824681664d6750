"""Arguments that select controllers, converted to settings of the voltage chain."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, get_type_hints

from piezo_hysteresis.compensation.controllers import ATTENUATIONS, Controllers, Feedback
from piezo_hysteresis.compensation.feedback.feedback_link import (
    FEEDBACKS,
    HInfinityWeights,
    PidGains,
)
from piezo_hysteresis.compensation.feedback.pid import FuzzyRules, read_tables
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.link import INVERSES, Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.identification.arx import TransferFunction
from piezo_hysteresis.models.modelfile import ModelFile

DEFAULT = AttenuationSettings()


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that select controllers."""
    forward = parser.add_argument_group('feedforward')
    forward.add_argument(
        '--law',
        choices=INVERSES,
        default='auto',
        help='inverse of the model: by structure (auto, exact, numeric, gain) or by a paper',
    )
    harmonics = parser.add_argument_group('attenuation of harmonics')
    add = harmonics.add_argument
    add(
        '--attenuation',
        choices=ATTENUATIONS,
        default=DEFAULT.method,
        help='method of the attenuation',
    )
    orders = list(DEFAULT.orders)
    add('--orders', type=int, nargs='+', default=orders, help='harmonic orders to attenuate')
    add(
        '--resonance',
        type=float,
        default=DEFAULT.resonance,
        help='frequency of a mode [Hz]; orders near it are added (afc only)',
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
        help='further settings, such as sign_rule=printed, switch_frequency=66, gain=1e4',
    )
    feedback = parser.add_argument_group('feedback')
    add = feedback.add_argument
    add(
        '--feedback',
        choices=FEEDBACKS,
        help='feedback controller (default: pid if --pid is given, else none)',
    )
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
        help='large error [m], large error rate [m/s], and largest changes of the gains',
    )
    add(
        '--fuzzy-tables',
        metavar='YAML',
        help='rules of fuzzy_pid; config/fuzzy/symmetric.yaml is an example',
    )
    add('--bandwidth', type=float, metavar='HZ', help='bandwidth of h_infinity [Hz]')
    add(
        '--h-infinity-set',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='other weights of h_infinity: steady_error, peak, control, delay_ticks',
    )
    add(
        '--transfer-function',
        metavar='YAML',
        help='plant of h_infinity, from the verb linear (default: that of the model)',
    )
    add('--together', action='store_true', help='add a run with attenuation and feedback')


def controllers_of(
    arguments: argparse.Namespace, model: ModelFile, dt: float, limits: Limits | None = None
) -> Controllers:
    """Return the settings of the voltage chain from the arguments."""
    path = arguments.gain_model
    steering = None if path is None else ModelFile.load(path)
    return Controllers(
        dt, limits or Limits(), model, arguments.law,
        attenuation=attenuation_of(arguments), feedback=feedback_of(arguments),
        gain_model=steering,
    )  # fmt: skip


def attenuation_of(arguments: argparse.Namespace) -> AttenuationSettings | None:
    """Return the settings of the attenuation, None for no attenuation."""
    if not (math.isfinite(arguments.resonance) and arguments.resonance >= 0):
        raise CompensationError(f'--resonance must be 0 or more, got {arguments.resonance:g} Hz')
    if arguments.attenuation == 'none':
        return None
    kinds = get_type_hints(AttenuationSettings)
    known = [f.name for f in fields(AttenuationSettings)]
    more = _settings(arguments.attenuation_set, known[3:], 'the attenuation')
    return AttenuationSettings(
        method=arguments.attenuation,
        orders=tuple(arguments.orders),
        resonance=arguments.resonance,
        **{name: _number(name, v) if kinds[name] is float else v for name, v in more.items()},  # type: ignore[arg-type]
    )


def feedback_of(arguments: argparse.Namespace) -> Feedback | None:
    """Return the feedback controller, None for no feedback."""
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
        numbers: dict[str, Any] = {name: _number(name, value) for name, value in weights.items()}
        path = arguments.transfer_function
        plant = TransferFunction.load(path) if path else None
        return Feedback(
            kind,
            weights=HInfinityWeights(arguments.bandwidth, **numbers),
            plant=None if plant is None else (plant.numerator, plant.denominator),
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
