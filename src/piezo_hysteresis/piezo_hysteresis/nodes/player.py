"""Plays a bag back to topics: at its own pace, at any other, or in step with its listeners."""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.message_types import message_type
from piezo_hysteresis.nodes.tables import PLAYER
from piezo_hysteresis.records.player import Played, Player
from piezo_interfaces.msg import LoopStatus
from piezo_ros_common import topics
from piezo_ros_common.parameters import NodeParameters
from piezo_ros_common.qos import LATCHED, LOOP
from piezo_ros_common.running import run_node
from piezo_ros_common.stamps import stamp_into

# Samples that may be under way in lock-step; listeners confirm more often than that.
WINDOW = 256


class PlayerNode(Node):
    """Publishes the bytes of a bag as they were recorded.

    In lock-step it waits for the listeners of ``actuator/state`` that report on ``~/status`` how
    many samples they have taken in, so that none is lost at any speed.
    """

    def __init__(self) -> None:
        super().__init__('player')
        self.stop = Future()
        self.exit_code = 0
        self._params = NodeParameters(self, PLAYER, lambda _: None)
        self._lock_step = self._params.flag('lock_step')
        self._taken: dict[str, int] = {}
        self._progress = threading.Condition()
        self._listeners: list[str] = []
        try:
            self._player = self._open()
        except PiezoError as error:
            self.get_logger().fatal(str(error))
            raise SystemExit(2) from None
        self._topics = {
            name: self.create_publisher(message_type(topic.msgtype), name, LOOP)
            for name, topic in self._player.topics.items()
        }
        self._clock_publisher = None
        if self._params.flag('publish_clock'):
            self._clock_publisher = self.create_publisher(Clock, '/clock', LOOP)
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)
        self._thread.start()

    def _open(self) -> Player:
        bag = self._params.text('bag')
        if not bag:
            raise PiezoError('give the bag to play: -p bag:=FOLDER')
        wanted = [str(name) for name in self._params.values['topics'] if name]  # type: ignore[union-attr]
        return Player(
            bag,
            rate=math.inf if self._lock_step else self._params.number('rate_factor'),
            loop=self._params.flag('loop'),
            topics=wanted or None,
            salvage=self._params.flag('salvage'),
        )

    # --- playing, in a thread of its own -------------------------------------------------------

    def _play(self) -> None:
        try:
            self._wait_for_listeners()
            sent = 0
            for played in self._player:
                sent = self._send(played, sent)
            self._wait_until_taken(sent, 0)
            self.get_logger().info(f'played {sent} samples')
        except PiezoError as error:
            self.get_logger().error(str(error))
            self.exit_code = 2
        finally:
            if not self.stop.done():
                self.stop.set_result(True)

    def _send(self, played: Played, sent: int) -> int:
        name = played.topic.name
        is_state = name.endswith(topics.STATE)
        if self._lock_step and name.endswith(topics.MARKER):
            self._wait_until_taken(sent, 0)
        elif self._lock_step and is_state:
            self._wait_until_taken(sent, WINDOW)
        self._topics[name].publish(played.payload)
        if name.endswith(topics.MARKER):
            self._topics[name].wait_for_all_acked()
        if self._clock_publisher is not None:
            clock = Clock()
            stamp_into(clock.clock, played.log_time)
            self._clock_publisher.publish(clock)
        return sent + is_state

    def _wait_for_listeners(self) -> None:
        """Wait until somebody listens, and find out who reports progress."""
        end = time.monotonic() + self._params.number('wait')
        while not any(p.get_subscription_count() for p in self._topics.values()):
            if time.monotonic() > end:
                break
            time.sleep(0.02)
        if not self._lock_step:
            return
        state = next((name for name in self._topics if name.endswith(topics.STATE)), None)
        infos: list[Any] = self.get_subscriptions_info_by_topic(state) if state else []
        for info in infos:
            node = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            status = f'{node}/status'
            if any(name == status for name, _ in self.get_topic_names_and_types()):
                self._listeners.append(node)
                self.create_subscription(LoopStatus, status, self._noted(node), LATCHED)
        if state and not self._listeners:
            raise PiezoError(
                'lock-step needs a listener that reports how far it is: start the identification '
                'node first, or play without --lock-step'
            )

    def _noted(self, node: str) -> Any:
        def on_status(message: LoopStatus) -> None:
            with self._progress:
                counts = dict(zip(message.names.split(','), message.counts, strict=False))
                self._taken[node] = counts.get('taken', 0)
                self._progress.notify_all()

        return on_status

    def _wait_until_taken(self, sent: int, window: int) -> None:
        if not self._lock_step:
            return
        patience = self._params.number('wait')
        with self._progress:
            done = self._progress.wait_for(
                lambda: all(sent - self._taken.get(n, 0) <= window for n in self._listeners),
                timeout=patience,
            )
        if not done:
            behind = [n for n in self._listeners if sent - self._taken.get(n, 0) > window]
            raise PiezoError(
                f'{", ".join(behind)} did not take sample {sent} within {patience:g} s: it died '
                'or started before; restart it and play again'
            )

    def close(self) -> None:
        """Stop playing."""
        self._player.stop()
        self._thread.join(2.0)


def run(arguments: Sequence[str]) -> int:
    """Run the player for the verb ``play``."""
    parser = argparse.ArgumentParser(prog='play')
    parser.add_argument('bag')
    parser.add_argument('topics', nargs='*')
    parser.add_argument('--rate', type=float, default=1.0)
    for switch in ('--loop', '--lock-step', '--salvage', '--clock'):
        parser.add_argument(switch, action='store_true')
    words = parser.parse_args(list(arguments))
    values = {
        'bag': words.bag,
        'topics': f'[{", ".join(words.topics) or chr(39) * 2}]',
        'rate_factor': words.rate,
        'loop': str(words.loop).lower(),
        'lock_step': str(words.lock_step).lower(),
        'salvage': str(words.salvage).lower(),
        'publish_clock': str(words.clock).lower(),
    }
    ros = ['--ros-args']
    for name, value in values.items():
        ros += ['-p', f'{name}:={value}']
    return run_node(PlayerNode, ros)


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(PlayerNode))
