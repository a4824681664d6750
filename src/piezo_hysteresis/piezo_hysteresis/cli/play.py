"""Publish a bag on its topics, at any rate or in lock-step with the subscribed nodes."""

from __future__ import annotations

import argparse

from piezo_hysteresis.cli.shared_options import ros_needed

EXAMPLE = 'play out/sweep --lock-step'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('bag', metavar='BAG', help='bag folder, .mcap or .db3 file')
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='topics to play (default: all)')
    parser.add_argument('--rate', type=float, default=1.0, help='speed relative to the recording')
    parser.add_argument('--loop', action='store_true', help='restart at the end')
    parser.add_argument(
        '--lock-step', action='store_true',
        help='send each message as soon as the subscribers have processed the previous one',
    )  # fmt: skip
    parser.add_argument('--clock', action='store_true', help='publish the time of the bag')
    parser.add_argument(
        '--salvage', action='store_true', help='play the readable part of damaged data'
    )


def run(arguments: argparse.Namespace) -> int:
    """Execute the player node."""
    values = {
        'bag': arguments.bag,
        'topics': arguments.topics or [''],
        'rate_factor': arguments.rate,
        'loop': arguments.loop,
        'lock_step': arguments.lock_step,
        'salvage': arguments.salvage,
        'publish_clock': arguments.clock,
    }
    with ros_needed():
        from piezo_hysteresis.nodes.recording import player_node
    return player_node.run(values)
