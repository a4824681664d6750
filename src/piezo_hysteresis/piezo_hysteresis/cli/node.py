"""Run one node: node feedforward -p model_file:=out/model/model.yaml.

The same as ros2 run, with or without an installation of ROS 2. Options after the name:
-p NAME:=VALUE, -r OLD:=NEW, --params-file FILE; `node NAME --help` lists the parameters.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from piezo_hysteresis.cli.shared_options import installed, ros_needed
from piezo_hysteresis.common.registry import NODES, package_of
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import PiezoError

EXAMPLE = 'node feedforward -p model_file:=out/model/model.yaml'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('node', metavar='NAME', help=f'node: {", ".join(NODES)}')
    parser.add_argument(
        'words',
        nargs=argparse.REMAINDER,
        metavar='...',
        help='options of the node, such as -p NAME:=VALUE',
    )


def run(arguments: argparse.Namespace) -> int:
    """Replace the process by the node."""
    path = executable(arguments.node)
    sys.stdout.flush()
    options = ros_arguments(arguments.words)
    with ros_needed():
        from piezo_hysteresis.ros.starting import blocked_signals
    with blocked_signals():
        os.execv(sys.executable, [sys.executable, str(path), *options])  # never returns
    return 0


def executable(node: str) -> Path:
    """Return the installed executable of a node."""
    if node not in NODES:
        raise PiezoError(f'there is no node {node}{choices(node, NODES)}')
    package = package_of(node)
    path = installed(package) / 'lib' / package / node
    if not path.is_file():
        raise PiezoError(f'{path} is not there: build the workspace with `make setup`')
    return path


def ros_arguments(options: list[str]) -> list[str]:
    """Return the process arguments, with those of ROS after ``--ros-args``."""
    plain = {'-h', '--help', '--ros-args'}
    return options if not options or not plain.isdisjoint(options) else ['--ros-args', *options]
