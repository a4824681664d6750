"""Parameters of the nodes of the voltage chain on the command line, and the chain of them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from yaml import YAMLError

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import near
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.identification.arx import TransferFunction
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.parameters.links import ATTENUATION, COUPLED, FEEDBACK, FEEDFORWARD
from piezo_hysteresis.runtime.laws import FeedbackLaws, HarmonicLaws, chain_settings

_TABLES = {
    'feedforward': FEEDFORWARD, 'attenuation': ATTENUATION, 'feedback': FEEDBACK,
    'coupled': COUPLED,
}  # fmt: skip
ONE_AXIS = ('feedforward', 'attenuation', 'feedback')
# Options of earlier versions, and the parameter that each is now.
_MOVED = {
    '--law': 'feedforward.law', '--attenuation': 'attenuation.method',
    '--orders': 'attenuation.orders', '--gain-model': 'attenuation.model_file',
    '--resonance': 'attenuation.resonance',
    '--attenuation-set': 'attenuation.PARAMETER', '--feedback': 'feedback.method',
    '--pid': 'feedback.pid.PARAMETER', '--fuzzy': 'feedback.fuzzy.PARAMETER',
    '--fuzzy-tables': 'feedback.fuzzy.tables', '--bandwidth': 'feedback.h_infinity.bandwidth',
    '--h-infinity-set': 'feedback.h_infinity.PARAMETER',
}  # fmt: skip
_FORWARD = ('law', 'start', 'transition')
_COUPLED = ('enabled', 'orders', 'step', 'largest_correction')


class _Moved(argparse.Action):
    """Refuses an option that is a parameter of a node now."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """End with what to write instead."""
        option = self.option_strings[0]
        parser.error(f'{option} is now --set {_MOVED[option]}=VALUE')


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that select controllers."""
    add = parser.add_argument_group('controllers').add_argument
    add(
        '--set',
        nargs='+',
        action='extend',
        default=[],
        metavar='NODE.PARAMETER=VALUE',
        help='parameters of the nodes feedforward, attenuation and feedback (several axes: '
        'coupled), such as feedforward.law=exact attenuation.orders=[1,3] feedback.method=pid '
        'feedback.pid.integral=3e3; attenuation.enabled=false is none',
    )
    add(
        '--transfer-function',
        metavar='YAML',
        help='plant of h_infinity, from the verb linear (default: that of the model)',
    )
    for option in _MOVED:
        add(option, nargs='*', action=_Moved, help=argparse.SUPPRESS)
    add('--together', action='store_true', help='add a run with attenuation and feedback')


def stated(assignments: Sequence[str], nodes: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return every parameter of the nodes, with what was set."""
    changes: dict[str, dict[str, Any]] = {node: {} for node in nodes}
    for assignment in assignments:
        name, equals, text = assignment.partition('=')
        node, _, parameter = name.partition('.')
        spec = _TABLES[node].spec(parameter) if node in nodes else None
        if not equals or spec is None:
            known = [f'{each}.{s.name}' for each in nodes for s in _TABLES[each].specs]
            raise CompensationError(
                f'{assignment!r} sets no parameter of {", ".join(nodes)}; write '
                f'NODE.PARAMETER=VALUE{near(name, known)}'
            )
        if parameter in changes[node]:
            raise CompensationError(f'{name} is given twice')
        value = spec.coerce(_entered(assignment, text))
        if value == []:
            raise CompensationError(f'{name} is empty; give values, or {node}.enabled=false')
        changes[node][parameter] = value
    values = {}
    for node, own in changes.items():
        if reason := _TABLES[node].judge(_TABLES[node].defaults(), own):
            raise CompensationError(f'{node}: {reason}')
        values[node] = {**_TABLES[node].defaults(), **own}
        for parameter in own:
            if not _acts(node, parameter, values[node]):
                raise CompensationError(
                    f'{node}.{parameter} changes nothing here with these parameters; leave it out'
                )
    return values


def _entered(assignment: str, text: str) -> Any:
    """Return the value of an entered text; a list with spaces arrives in parts."""
    try:
        return plain_yaml.load(text)
    except YAMLError:
        raise CompensationError(
            f'{assignment!r} is no value; write a list without spaces, or in quotes: '
            "'attenuation.orders=[1, 3]'"
        ) from None


def _acts(node: str, parameter: str, values: dict[str, Any]) -> bool:
    """Return whether a parameter shapes the chain of a study or a library."""
    if node == 'feedforward':
        return parameter in _FORWARD
    if node == 'coupled':
        return parameter in _COUPLED
    if node == 'attenuation':
        return parameter == 'model_file' or HarmonicLaws().shapes(values, parameter)
    is_limit = parameter.startswith('limits.')
    return not is_limit and FeedbackLaws().shapes(values, parameter)


def controllers_of(arguments: argparse.Namespace, model: ModelFile, dt: float) -> Controllers:
    """Return the settings of the voltage chain from the arguments."""
    values, path = stated(arguments.set, ONE_AXIS), arguments.transfer_function
    if path is not None:
        if values['feedback']['method'] != 'h_infinity':
            raise CompensationError('--transfer-function belongs to feedback.method=h_infinity')
        plant = TransferFunction.load(path)
        values['feedback'] |= {
            'plant.numerator': plant.numerator, 'plant.denominator': plant.denominator,
        }  # fmt: skip
    return chain_settings(values, dt, model)
