"""The parameters of the live page, as a table and as options of the command line."""

from __future__ import annotations

import argparse

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable

# Of the page and of the discovery node; not the working directory, which may hold sources.
RESULTS = '~/piezo_hysteresis'

DASHBOARD = ParameterTable(
    (
        ParameterSpec(
            'actuators',
            [''],
            'Namespaces of the actuators; by default its own, or all that are found.',
            read_only=True,
        ),
        ParameterSpec(
            'folder',
            RESULTS,
            'Folder for recorded sweeps and discoveries; reports in it are served.',
            read_only=True,
        ),
        ParameterSpec(
            'port',
            5006,
            'Port of the page; 0 selects a free port.',
            low=0,
            high=65535,
            read_only=True,
        ),
        ParameterSpec(
            'address',
            '127.0.0.1',
            'Address to listen on; with another address, other '
            'machines can open the page and move the actuator.',
            read_only=True,
        ),
        ParameterSpec(
            'origins', [''], 'Additional HOST:PORT names of the page for browsers.', read_only=True
        ),
        ParameterSpec(
            'token',
            '',
            'Token that a browser must send once, as ?token=... in the address, '
            'at least 16 characters; empty requires none.',
            read_only=True,
        ),
        ParameterSpec(
            'refresh', 10.0, 'Refresh rate of the plots.', 'Hz', 1.0, 30.0, read_only=True
        ),
    )
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of the verb and of the executable ``dashboard``."""
    parser.add_argument('--namespace', help='namespace of the actuator (default: all)')
    parser.add_argument(
        '--folder', help='folder for sweeps, discoveries and reports (default: ~/piezo_hysteresis)'
    )
    parser.add_argument(
        '--port', type=int, help='port of the page, 0 for a free one (default: 5006)'
    )
    parser.add_argument(
        '--address',
        help='address to listen on (default: 127.0.0.1); any other gives other machines access',
    )
