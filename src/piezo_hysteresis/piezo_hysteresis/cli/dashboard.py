"""Serve the live page of running nodes: plots, sliders, sweeps and discoveries in a browser.

Open the address that it prints. Only browsers on this machine can, unless --address says
otherwise.
"""

from __future__ import annotations

import argparse

from piezo_hysteresis.cli.need_ros import node_module

HELP = 'live page of running nodes, in a browser'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of this verb."""
    parser.add_argument('--namespace', help='of the actuator; all that are found where not given')
    parser.add_argument(
        '--folder', help='for sweeps and discoveries, whose reports are served; ~/piezo_hysteresis'
    )
    parser.add_argument('--port', type=int, help='5006; 0 takes a free one')
    parser.add_argument(
        '--address', help='where to listen; others than 127.0.0.1 let other machines in'
    )


def run(arguments: argparse.Namespace) -> int:
    """Hand over to the dashboard node."""
    known = {name: getattr(arguments, name) for name in ('namespace', 'folder', 'port', 'address')}
    given = {name: value for name, value in known.items() if value is not None}
    return int(node_module('dashboard').run([f'--{name}={given[name]}' for name in given]))
