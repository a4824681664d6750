"""Get and set the parameters of running nodes, as ros2 param does.

param list; param list /attenuation; param get /excitation frequency; param set /attenuation
enabled false; param load /feedforward out/model/params.yaml
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from piezo_hysteresis.cli.shared_options import ros_needed
from piezo_hysteresis.errors import PiezoError

EXAMPLE = 'param set /attenuation enabled false'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('what', choices=('list', 'get', 'set', 'load'), help='action')
    parser.add_argument('node', nargs='?', metavar='/NODE', help='node with its namespace')
    parser.add_argument('name', nargs='?', help='name of the parameter; for load, the file')
    parser.add_argument('value', nargs='?', help='value as YAML: 14, false, [0, 1, 3], {seed: 3}')
    parser.add_argument(
        '--timeout', type=float, default=5.0, metavar='S', help='time to wait for an answer [s]'
    )


def run(arguments: argparse.Namespace) -> int:
    """Call the parameter services and print the results."""
    needed = {'list': 0, 'get': 2, 'set': 3, 'load': 2}[arguments.what]
    texts = [arguments.node, arguments.name, arguments.value]
    given = [each for each in texts if each is not None]
    if len(given) < needed or (arguments.what != 'set' and arguments.value is not None):
        forms = {'get': '/NODE NAME', 'set': '/NODE NAME VALUE', 'load': '/NODE FILE'}
        form = forms.get(arguments.what, '[/NODE]')
        raise PiezoError(f'write `param {arguments.what} {form}`')
    with ros_needed():
        from piezo_hysteresis.nodes.parameter_client import ParameterClient
    with ParameterClient(arguments.timeout) as running:
        done: dict[str, Callable[..., list[str]]] = {
            'list': running.listed,
            'get': running.value,
            'set': running.change,
            'load': running.load,
        }
        lines = done[arguments.what](*given)
    for line in lines:
        print(line)
    return 0
