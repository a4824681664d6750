"""Plays a bag: at the recorded rate, at another rate, or in lock-step with its subscribers."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.common.stamps import stamp_into
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.recording.listeners import Ended, Listeners, message_type
from piezo_hysteresis.parameters.node_tables import PLAYER
from piezo_hysteresis.records.player import Played, Player
from piezo_hysteresis.records.storage import Topic
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.processes import ros_arguments
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics, Neighbours
from piezo_hysteresis.ros.running import run_node
from piezo_hysteresis.ros.starting import refuse_start
from piezo_interfaces.msg import RecordMarker

# Largest number of unconfirmed samples in lock-step; listeners confirm more often.
WINDOW = 256

# Largest number of samples not confirmed by recorders in real time.
FURTHEST = 2048

# Delay from which a message is counted as late [s].
LATE = 0.05

# Time for the delivery of the last messages after a stop [s].
LAST_WAY = 1.0

# Time without a report of a subscriber after which it is logged [s].
SILENCE = 2.0

SENTENCES: dict[str, Finding] = {
    'late': (Level.WARN, 'messages come too late: the machine or the disk is too slow')
}


class PlayerNode(GuardedNode):
    """Publishes the bytes of a bag as they were recorded.

    In lock-step it waits for the subscribers of ``actuator/state`` that report the number of
    consumed samples on ``~/status``, so that none is lost at any speed. Otherwise it waits for the
    recorders among them, until each has confirmed a marker before its first sample and has all
    samples at the end.
    """

    def __init__(self) -> None:
        super().__init__('player')
        self._diagnostics = Diagnostics(self, self._judge)
        self._neighbours = Neighbours(self, everywhere=True)
        self.stop = Future()
        self.exit_code = 0
        self._params = NodeParameters(self, PLAYER)
        self._lock_step = self._params.flag('lock_step')
        try:
            self._player = self._open()
            self._topics = {name: self._publisher(t) for name, t in self._player.topics.items()}
        except PiezoError as error:
            refuse_start(error)
        self._clock_publisher = None
        if self._params.flag('publish_clock'):
            self._clock_publisher = self.create_publisher(Clock, '/clock', LOOP)
        self._listeners: Listeners | None = None
        self._marker = ''
        self._stage = 'begins'
        self._problem = ''
        self._share = self._late = 0.0
        self._counts = {'samples': 0, 'messages': 0, 'late': 0, 'laps': 0}
        self._watch = CounterWatch(SENTENCES)
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)
        self._thread.start()

    def _open(self) -> Player:
        bag = self._params.text('bag')
        if not bag:
            raise PiezoError('give the bag to play: -p bag:=FOLDER')
        names = [str(name) for name in self._params.values['topics'] if name]  # type: ignore[union-attr]
        return Player(
            bag,
            rate=math.inf if self._lock_step else self._params.number('rate_factor'),
            loop=self._params.flag('loop'),
            topics=names or None,
            salvage=self._params.flag('salvage'),
        )

    def _publisher(self, topic: Topic) -> Any:
        latched = 'transient_local' in topic.qos
        return self.create_publisher(
            message_type(topic.msgtype), topic.name, LATCHED if latched else LOOP
        )

    # --- playing, in a separate thread -------------------------------------------------------

    def _play(self) -> None:
        try:
            self._stage = 'waits for a listener'
            self._prepare()
            self._stage = ''
            sent = 0
            for played in self._player:
                self._note(played)
                sent = self._send(played, sent)
                self._counts['samples'] = sent
            if self._listeners is not None:
                self._listeners.wait_taken(sent)
            self.get_logger().info(f'played {counted(sent, "sample")}')
        except Ended:
            pass
        except PiezoError as error:
            self.get_logger().error(str(error))
            self._problem = str(error)
            self.exit_code = 2
        except Exception:
            self.exit_code = 1
            raise
        finally:
            if not self.stop.done():
                self.stop.set_result(True)

    def _prepare(self) -> None:
        """Wait for the listeners, until all of them are at the start."""
        states = [name for name in self._topics if name.endswith(topics.STATE)]
        if self._lock_step:
            if not states:
                raise PiezoError(f'lock-step needs {topics.STATE}, which is not played')
            self._find_listeners(states[0])
            return
        started = time.monotonic()
        while time.monotonic() - started < self._timeout() and not any(
            publisher.get_subscription_count() for publisher in self._topics.values()
        ):
            if self._ends():
                raise Ended
            time.sleep(0.02)
        if len(states) == 1:
            self._find_recorders(states[0])

    def _find_listeners(self, state: str) -> None:
        listeners = self._listeners = self._listeners_of(state)
        listeners.find()
        # Samples before the first marker of the bag belong to no record.
        marker = self._marker = state.removesuffix(topics.STATE) + topics.MARKER
        marked = marker in self._topics
        if not marked:
            self._topics[marker] = self.create_publisher(RecordMarker, marker, LOOP)
        first = RecordMarker(record='' if marked else 'all')
        listeners.wait_matched([self._topics[state], self._topics[marker]])
        listeners.wait_marked(lambda: self._topics[marker].publish(first))
        listeners.begin()

    def _find_recorders(self, state: str) -> None:
        listeners = self._listeners_of(state, recorders=True)
        listeners.find()
        if listeners.has_listeners:
            listeners.wait_matched(list(self._topics.values()))
            listeners.begin()
            self._listeners, self._marker = listeners, state.removesuffix(topics.STATE)
            self._marker += topics.MARKER

    def _listeners_of(self, state: str, *, recorders: bool = False) -> Listeners:
        return Listeners(
            self, state, self._timeout, self._neighbours, self._ends, recorders=recorders
        )

    def _ends(self) -> bool:
        return self._player.stopped or not self.context.ok()

    def _timeout(self) -> float:
        """Return the timeout of a wait [s]; infinite while nodes are starting."""
        wait = self._params.number('wait')
        return wait if self._neighbours.silence() >= wait else math.inf

    def _send(self, played: Played, sent: int) -> int:
        name, listeners = played.topic.name, self._listeners
        publish = self._topics[name].publish
        if listeners is None:
            publish(played.payload)
        elif name == self._marker:
            waited = listeners.wait_taken(sent)
            self._player.hold(waited + listeners.wait_marked(lambda: publish(played.payload)))
        else:
            self._player.hold(listeners.wait_taken(sent, WINDOW if self._lock_step else FURTHEST))
            publish(played.payload)
        if self._clock_publisher is not None:
            clock = Clock()
            stamp_into(clock.clock, played.log_time)
            self._clock_publisher.publish(clock)
        return sent + name.endswith(topics.STATE)

    def _note(self, played: Played) -> None:
        first, last = self._player.first, self._player.last
        self._share = (played.log_time - first) / max(1, last - first)
        self._late = played.late
        self._counts['messages'] += 1
        self._counts['late'] += played.late > LATE
        self._counts['laps'] = played.lap

    # --- interface of the process ----------------------------------------------------------------

    def _judge(self) -> Health:
        findings = self._watch.findings(self._counts)
        if self._problem:
            findings.append((Level.ERROR, self._problem))
        elif self._stage == 'waits for a listener':
            findings.append((Level.WARN, self._stage))
        listeners = self._listeners
        awaited = '' if listeners is None else listeners.awaited
        silent = time.monotonic() - listeners.since if listeners is not None and awaited else 0.0
        if silent > SILENCE:
            message = f'{awaited} has not confirmed for {silent:.0f} s what was played'
            findings.append((Level.WARN, message))
        fine = self._stage or f'plays {self._player.path}: {self._share:.0%}'
        values = {'share': self._share, 'late_s': self._late, **self._counts}
        return judge(findings, fine, values)

    def close(self) -> None:
        """Stop playing; messages already sent are still delivered."""
        self._player.stop()
        # The thread uses objects that are destroyed next. It ends quickly, because every wait is
        # aborted.
        self._thread.join()
        end = time.monotonic() + LAST_WAY
        for publisher in self._topics.values():
            left = max(0.0, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))
        self._diagnostics.publish_final_status()


def run(values: Mapping[str, object]) -> int:
    """Run the player with parameters for the verb ``play``."""
    return run_node(PlayerNode, ros_arguments(values))


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(PlayerNode))
