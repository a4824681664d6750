"""Record topics of a running ROS 2 system into a crash-safe bag.

All flushed data are readable after a crash, a kill or a full disk; Ctrl-C stops the recording.
"""

from __future__ import annotations

import argparse

from piezo_hysteresis.cli.shared_options import ros_needed

EXAMPLE = 'record /piezo/actuator/state --out bag'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument(
        'topics', nargs='*', metavar='TOPIC',
        help='topics to record (default: actuator/state, reference and record/marker)',
    )  # fmt: skip
    parser.add_argument('--out', required=True, metavar='BAG', help='bag folder to create')
    parser.add_argument(
        '--namespace', default='piezo', help='namespace of topics without a leading slash'
    )


def run(arguments: argparse.Namespace) -> int:
    """Execute the recorder node."""
    with ros_needed():
        from piezo_hysteresis.nodes.recording import recorder_node
    return recorder_node.run(arguments.out, arguments.topics, arguments.namespace)
