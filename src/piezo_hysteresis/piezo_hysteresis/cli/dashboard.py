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
    parser.add_argument(
        '--namespace', default='', help='of the actuator; all that are found where not given'
    )
    parser.add_argument(
        '--folder', default='.', help='for sweeps and discoveries; its reports are served'
    )
    parser.add_argument('--port', type=int, default=5006, help='0 takes a free one')
    parser.add_argument(
        '--address',
        default='127.0.0.1',
        help='where to listen; others than 127.0.0.1 let others in',
    )


def run(arguments: argparse.Namespace) -> int:
    """Hand over to the dashboard node."""
    return int(
        node_module('dashboard').run(
            [
                f'--namespace={arguments.namespace}',
                f'--folder={arguments.folder}',
                f'--port={arguments.port}',
                f'--address={arguments.address}',
            ]
        )
    )
