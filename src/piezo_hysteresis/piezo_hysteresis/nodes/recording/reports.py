"""Finds the nodes that take a topic in and hears on their ``~/status`` how far they are."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from piezo_hysteresis.ros.qos import LATCHED
from piezo_hysteresis.runtime.consumer_progress import Progress
from piezo_interfaces.msg import LoopStatus

# So long nothing may change among the nodes before they count as all there [s]. Two processes find
# each other within 0.3 s on an idle machine; with four busy ones to a core that was too short for
# the first record of 1 sweep in 50.
QUIET = 1.0

STATUS = 'piezo_interfaces/msg/LoopStatus'
_UNKNOWN = '_NODE_NAME_UNKNOWN_'


class Reports:
    """The nodes that subscribe to a topic, as they come and go.

    Parameters
    ----------
    node : Node
        That looks.
    topic : str
        What they take in.
    received : callable
        Called after each status, by the executor of the node.

    Attributes
    ----------
    progress : dict of str to Progress
        What each of those that report has reported, by its whole name.
    subscribed : int
        Subscriptions of the topic that a volatile publisher serves.
    """

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
        """Notice who has come and who has gone."""
        infos = self._node.get_subscriptions_info_by_topic(self._topic)
        names = {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos}
        nodes = sorted(self._node.get_node_names_and_namespaces())
        topics = {
            name for name, kinds in self._node.get_topic_names_and_types() if STATUS in kinds
        }
        seen = (names, len(infos), nodes, topics)
        # An endpoint is known before the name of its node: then that is about to come.
        if seen != self._seen or any(name.endswith(_UNKNOWN) for name in names):
            self._seen, self._changed = seen, time.monotonic()
        self.subscribed = _served(infos)
        for name in names - self.progress.keys():
            if f'{name}/status' in topics:
                self._follow(name)
        for name in self.progress.keys() - names:
            self._forget(name)

    def quiet_since(self) -> float:
        """Return since when nobody came or went [s], on the monotonic clock."""
        return self._changed

    def silent(self) -> list[str]:
        """Return those that are about to report and have not yet said a word."""
        return sorted(name for name, known in list(self.progress.items()) if not known.received)

    def takers(self) -> dict[str, Progress]:
        """Return those that tell how many samples they have taken."""
        return {name: known for name, known in list(self.progress.items()) if known.takes}

    def keepers(self) -> dict[str, Progress]:
        """Return the recorders among them."""
        return {name: known for name, known in list(self.progress.items()) if known.keeps}

    def _follow(self, name: str) -> None:
        known = self.progress[name] = Progress()

        def on_status(message: LoopStatus) -> None:
            known.receive(message.names, message.counts)
            self._received()

        self._subscriptions[name] = self._node.create_subscription(
            LoopStatus, f'{name}/status', on_status, LATCHED
        )

    def _forget(self, name: str) -> None:
        del self.progress[name]
        self._node.destroy_subscription(self._subscriptions.pop(name))


def subscribers(node: Node, topic: str) -> int:
    """Return how many subscriptions of a topic a reliable, volatile publisher serves."""
    return _served(node.get_subscriptions_info_by_topic(topic))


def _served(infos: Sequence[TopicEndpointInfo]) -> int:
    return sum(info.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL for info in infos)
