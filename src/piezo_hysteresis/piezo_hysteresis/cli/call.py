"""Call a service or an action of a running node, as the command ros2 does.

call lists the names; call /attenuation/reset; call /run_sweep '{frequencies: [1, 5],
amplitudes: [0.5], seconds: 2.0, bag: sweep}'. Ctrl-C cancels an action.
"""

from __future__ import annotations

import argparse
import sys

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.shared_options import ros_needed
from piezo_hysteresis.errors import PiezoError

EXAMPLE = "call /run_sweep '{frequencies: [1, 5], amplitudes: [0.5], seconds: 2.0, bag: sweep}'"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('name', nargs='?', metavar='/NAME', help='service or action; without it all are listed')
    add('request', nargs='?', default='', metavar='YAML', help='fields, such as {seconds: 2.0}')
    add('--timeout', type=float, default=5.0, metavar='S', help='time to wait for an answer [s]')


def run(arguments: argparse.Namespace) -> int:
    """Call it and print the response; a response without success is an error."""
    with ros_needed():
        from piezo_hysteresis.nodes.parameter_client import Caller
    with Caller(arguments.timeout) as caller:
        if arguments.name is None:
            names = caller.names()
            if not names:
                raise PiezoError('no node is running in this domain')
            width = max(map(len, names))
            print('\n'.join(f'{name:{width}}  {kind}' for name, kind in names.items()))
            return 0
        quiet = verbosity.level() == verbosity.Verbosity.QUIET
        lines, success = caller.call(
            arguments.name,
            arguments.request,
            lambda line: None if quiet else print(line, file=sys.stderr),
        )
    print('\n'.join(lines))
    return 0 if success else 1
