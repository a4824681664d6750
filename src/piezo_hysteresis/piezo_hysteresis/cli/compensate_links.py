"""Arguments that select controllers, converted to settings of the voltage chain."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, get_type_hints

from piezo_hysteresis.cli.shared_options import add_options
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
    add_options(parser.add_argument_group('feedforward'), f"""
        --law {'|'.join(INVERSES)} = auto  inverse of the model: by structure (auto, exact,
            numeric, gain) or by a paper
    """)  # fmt: skip
    add_options(parser.add_argument_group('attenuation of harmonics'), f"""
        --attenuation {'|'.join(ATTENUATIONS)} = {DEFAULT.method}  method of the attenuation
        --orders N... = {','.join(map(str, DEFAULT.orders))}  harmonic orders to attenuate
        --resonance HZ = {DEFAULT.resonance}  frequency of a mode [Hz]; orders near it are added
            (afc only)
        --gain-model YAML  model for the plant gain (default: the inverted model)
        --attenuation-set NAME=VALUE...  further settings, such as sign_rule=printed,
            switch_frequency=66, gain=1e4
    """)  # fmt: skip
    add_options(parser.add_argument_group('feedback'), f"""
        --feedback {'|'.join(FEEDBACKS)}  feedback controller (default: pid if --pid is given, else
            none)
        --pid KP KI KD  gains of pid and fuzzy_pid [V/m], [V/(m s)], [V s/m]
        --fuzzy E RATE DKP DKI  large error [m], large error rate [m/s], and largest changes of the
            gains
        --fuzzy-tables YAML  rules of fuzzy_pid; config/fuzzy/symmetric.yaml is an example
        --bandwidth HZ  bandwidth of h_infinity [Hz]
        --h-infinity-set NAME=VALUE...  other weights of h_infinity: steady_error, peak, control,
            delay_ticks
        --transfer-function YAML  plant of h_infinity, from the verb linear (default: that of the
            model)
        --together  add a run with attenuation and feedback
    """)  # fmt: skip


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
