"""Serve the live page of running nodes: plots, sliders, sweeps and discoveries in a browser.

Open the printed address. Without --address only browsers on this machine can connect.
"""

from __future__ import annotations

import argparse

from piezo_hysteresis.cli.shared_options import ros_needed
from piezo_hysteresis.parameters.node_tables import configure

__all__ = ['configure', 'run']

EXAMPLE = 'dashboard --port 5007'


def run(arguments: argparse.Namespace) -> int:
    """Execute the dashboard node."""
    known = {name: getattr(arguments, name) for name in ('namespace', 'folder', 'port', 'address')}
    given = {name: value for name, value in known.items() if value is not None}
    with ros_needed():
        from piezo_hysteresis.nodes.dashboard import dashboard_node
    return dashboard_node.run([f'--{name}={given[name]}' for name in given])
