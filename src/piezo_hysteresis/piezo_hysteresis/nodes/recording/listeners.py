"""Progress of the nodes that consume the samples of a player."""

from __future__ import annotations

import importlib
import threading
import time
from collections.abc import Callable, Sequence

import yaml
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.ros.qos import LATCHED
from piezo_hysteresis.ros.readiness import Neighbours
from piezo_hysteresis.runtime.consumer_progress import Progress
from piezo_interfaces.msg import LoopStatus


def message_type(name: str) -> type:
    """Return the class of ``package/msg/Name``, or of a service or an action."""
    package, _, rest = name.partition('/')
    room, _, kind = rest.partition('/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.{room or "msg"}'), kind)
    except (ImportError, AttributeError):
        raise PiezoError(
            f'messages of type {name} are not known here: source the workspace that has {package}'
        ) from None
    return found


DEPTH = 20000


def matching(publishers: Sequence[TopicEndpointInfo]) -> QoSProfile:
    """Return the strongest profile that every one of `publishers` can serve."""
    profiles = [publisher.qos_profile for publisher in publishers]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offered_as_yaml(qos: QoSProfile) -> str:
    """Return a profile in the format of rosbag2, so that players offer the same profile."""
    forever = {'sec': 9223372036, 'nsec': 854775807}
    return str(
        yaml.safe_dump(
            [
                {
                    'history': 'keep_last',
                    'depth': 64,
                    'reliability': qos.reliability.name.lower(),
                    'durability': qos.durability.name.lower(),
                    'deadline': forever,
                    'lifespan': forever,
                    'liveliness': 'automatic',
                    'liveliness_lease_duration': forever,
                    'avoid_ros_namespace_conventions': False,
                }
            ],
            sort_keys=False,
        )
    )


class Ended(Exception):
    """The wait ends because the player is shutting down."""


class Listeners:
    """The nodes that report the number of consumed samples on ``~/status``."""

    def __init__(
        self,
        node: Node,
        topic: str,
        timeout: Callable[[], float],  # [s]
        neighbours: Neighbours,
        ended: Callable[[], bool],
        *,
        recorders: bool = False,
    ) -> None:
        self._node = node
        self._neighbours = neighbours
        self._timeout = timeout
        self._ended = ended
        self._recorders = recorders
        self.awaited = ''
        self.since = 0.0
        self._condition = threading.Condition()
        self._reports = Reports(node, topic, self._notify)
        self._counted: frozenset[str] | None = None

    def find(self) -> None:
        """Wait until at least one node reports, and every discovered node does."""
        started = time.monotonic()
        while not self._complete(started):
            if self._timed_out(started):
                raise PiezoError(self._missing())
            time.sleep(0.02)

    @property
    def has_listeners(self) -> bool:
        """Whether there is a node to wait for."""
        return bool(self._known())

    def _complete(self, started: float) -> bool:
        self._reports.look()
        self._neighbours.look()
        if self._neighbours.awaiting_first_heartbeat() or self._reports.silent():
            return False
        quiet = time.monotonic() - max(started, self._reports.unchanged_since()) >= SETTLING_TIME
        return quiet and (self._recorders or bool(self._known()))

    def _missing(self) -> str:
        if silent := self._reports.silent():
            return f'{", ".join(silent)} does not publish its status; restart it and play again'
        if self._known():
            return 'nodes come and go all the time; play again when all are there'
        return (
            'lock-step needs a listener that reports how far it is: start the identification '
            'node or a recorder first, or play without --lock-step'
        )

    def wait_matched(self, publishers: Sequence[Publisher]) -> None:
        """Wait until all nodes are connected to every publisher."""
        started = time.monotonic()
        while any(self._unmatched(each) for each in publishers):
            if self._timed_out(started):
                raise PiezoError('the listeners could not be connected; start them and play again')
            time.sleep(0.02)

    def _unmatched(self, publisher: Publisher) -> bool:
        there = subscribers(self._node, publisher.topic_name)
        return bool(publisher.get_subscription_count() < there)

    def wait_marked(self, publish: Callable[[], None]) -> float:
        """Publish a marker and wait until all nodes have received it; return the duration [s]."""
        with self._condition:
            counts = {name: known.marked + 1 for name, known in self._known().items()}
        publish()
        return self._wait(lambda name, known: known.marked >= counts.get(name, 0), 'a marker')

    def begin(self) -> None:
        """Start counting samples; nodes that start later are not waited for."""
        with self._condition:
            for known in self._known().values():
                known.first = known.taken
            self._counted = frozenset(self._known())

    def wait_taken(self, sent: int, window: int = 0) -> float:
        """Wait until all nodes have all but `window` of the samples; return the wait [s]."""
        return self._wait(
            lambda _, known: sent - (known.taken - known.first) <= window, f'sample {sent}'
        )

    def _known(self) -> dict[str, Progress]:
        found = self._reports.keepers() if self._recorders else self._reports.takers()
        if self._counted is None:
            return found
        return {name: known for name, known in found.items() if name in self._counted}

    def _wait(self, reached: Callable[[str, Progress], bool], what: str) -> float:
        def behind() -> list[str]:
            return [name for name, known in self._known().items() if not reached(name, known)]

        if not behind():
            return 0.0
        started = time.monotonic()
        # In short steps, so that a shutdown is not delayed.
        while (late := behind()) and not self._timed_out(started):
            self.awaited, self.since = ', '.join(late), started
            with self._condition:
                self._condition.wait_for(lambda: not behind(), 0.1)
            if behind():
                self._reports.look()  # remove nodes that have ended
        self.awaited = ''
        if late:
            raise PiezoError(
                f'{", ".join(late)} did not take {what} within {self._timeout():g} s: it died or '
                'is overloaded; restart it and play again'
            )
        return time.monotonic() - started

    def _timed_out(self, started: float) -> bool:
        if self._ended():
            raise Ended
        return time.monotonic() - started > self._timeout()

    def _notify(self) -> None:
        with self._condition:
            self._condition.notify_all()


# Time without a change after which discovery is complete [s]. Two processes discover each other
# within 0.3 s on an idle machine; with four busy processes per core that was too short for the
# first record of 1 sweep in 50.
SETTLING_TIME = 1.0

STATUS = 'piezo_interfaces/msg/LoopStatus'
_UNKNOWN = '_NODE_NAME_UNKNOWN_'


class Reports:
    """The nodes that subscribe to a topic, updated during operation."""

    def __init__(self, node: Node, topic: str, received: Callable[[], None]) -> None:
        self._node = node
        self._topic = node.resolve_topic_name(topic)
        self._received = received
        self.progress: dict[str, Progress] = {}
        self.subscribed = 0
        self._subscriptions: dict[str, Subscription] = {}
        self._seen: object = None
        self._changed = time.monotonic()

    def look(self) -> None:
        """Update the subscribing nodes."""
        infos = self._node.get_subscriptions_info_by_topic(self._topic)
        names = {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos}
        nodes = sorted(self._node.get_node_names_and_namespaces())
        topics = {
            name for name, kinds in self._node.get_topic_names_and_types() if STATUS in kinds
        }
        seen = (names, len(infos), nodes, topics)
        # An endpoint can be discovered before the name of its node, which then follows.
        if seen != self._seen or any(name.endswith(_UNKNOWN) for name in names):
            self._seen, self._changed = seen, time.monotonic()
        self.subscribed = _served(infos)
        for name in names - self.progress.keys():
            if f'{name}/status' in topics:
                self._follow(name)
        for name in self.progress.keys() - names:
            self._remove(name)

    def unchanged_since(self) -> float:
        """Return the time of the last change among the nodes [s], on the monotonic clock."""
        return self._changed

    def silent(self) -> list[str]:
        """Return the discovered nodes that have not yet reported."""
        return sorted(name for name, known in list(self.progress.items()) if not known.received)

    def takers(self) -> dict[str, Progress]:
        """Return the nodes that report the number of consumed samples."""
        return {name: known for name, known in list(self.progress.items()) if known.takes}

    def keepers(self) -> dict[str, Progress]:
        """Return the recorders."""
        return {name: known for name, known in list(self.progress.items()) if known.keeps}

    def _follow(self, name: str) -> None:
        known = self.progress[name] = Progress()

        def on_status(message: LoopStatus) -> None:
            known.receive(message.names, message.counts)
            self._received()

        self._subscriptions[name] = self._node.create_subscription(
            LoopStatus, f'{name}/status', on_status, LATCHED
        )

    def _remove(self, name: str) -> None:
        del self.progress[name]
        self._node.destroy_subscription(self._subscriptions.pop(name))


def subscribers(node: Node, topic: str) -> int:
    """Return the number of subscriptions that match a reliable, volatile publisher."""
    return _served(node.get_subscriptions_info_by_topic(topic))


def _served(infos: Sequence[TopicEndpointInfo]) -> int:
    return sum(info.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL for info in infos)
