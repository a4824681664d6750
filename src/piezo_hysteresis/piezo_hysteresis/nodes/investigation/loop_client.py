"""Client of a running discovery node: requests an investigation and reports its progress."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.ros.client import Client
from piezo_interfaces.action import Investigate

# Period of the check [s].
LOOK = 0.2


class ActionWatch:
    """Detects that an action server has ended, also if another one has replaced it.

    A killed process remains in the graph for a while, and a quick restart is not visible there;
    but the new endpoints have other identifiers.
    """

    def __init__(self, node: Node, client: ActionClient, name: str) -> None:
        self._node, self._client = node, client
        self._topic = node.resolve_topic_name(f'{name}/_action/status')
        self._known: frozenset[bytes] = frozenset()
        self._due, self._lost = 0.0, False

    def begin(self) -> None:
        """Store the present server."""
        self._known, self._lost = self._there(), False

    @property
    def lost(self) -> bool:
        """Whether the stored server has ended or was replaced, according to the last check."""
        if not self._lost and time.monotonic() >= self._due:
            there = self._there()
            self._lost = bool(there - self._known) or not there & self._known
            self._lost |= not self._client.server_is_ready()
            self._due = time.monotonic() + LOOK
        return self._lost

    def _there(self) -> frozenset[bytes]:
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return frozenset(bytes(info.endpoint_gid) for info in infos)


# Timeout of the discovery node: for its discovery, and after its restart [s].
FOUND_WITHIN, BACK_WITHIN = 15.0, 120.0
# Timeout of the acceptance of a goal [s].
ANSWERS_WITHIN = 30.0


class _NodeLost(Exception):
    """The discovery node has ended."""


class Asking(Client):
    """Client node, alive within a `with` block."""

    def __init__(self, namespace: str = '') -> None:
        super().__init__('_investigate', namespace=namespace)
        self._client = ActionClient(self.node, Investigate, 'investigate')
        self._watch = ActionWatch(self.node, self._client, 'investigate')

    def investigate(
        self, goal: Investigate.Goal, on_feedback: Callable[[Investigate.Feedback], None]
    ) -> Investigate.Result:
        """Return the result of a goal; it continues after a restart of the discovery node.

        An interruption cancels it, and waits until the actuator is at rest.
        """
        timeout = FOUND_WITHIN
        while True:
            if not self.wait(self._client.server_is_ready, timeout):
                raise PiezoError(
                    'no discovery node is running: start it, and say the same words again'
                )
            try:
                return self._once(goal, on_feedback)
            except _NodeLost:
                timeout = BACK_WITHIN

    def _once(
        self, goal: Investigate.Goal, on_feedback: Callable[[Investigate.Feedback], None]
    ) -> Investigate.Result:
        self._watch.begin()
        sent = self._client.send_goal_async(
            goal, feedback_callback=lambda m: on_feedback(m.feedback)
        )
        self._follow(sent, ANSWERS_WITHIN)
        handle: Any = sent.result()
        if not handle.accepted:
            raise PiezoError('the discovery node refused; see its log')
        ended = handle.get_result_async()
        try:
            self._follow(ended)
        except KeyboardInterrupt:
            handle.cancel_goal_async()
            self._cancelled(ended)
        result: Investigate.Result = ended.result().result
        return result

    def _cancelled(self, ended: Any) -> None:
        try:
            self._follow(ended)
        except _NodeLost:
            raise PiezoError('the discovery node has gone: see that the actuator rests') from None

    def _follow(self, future: Any, timeout: float = inf) -> None:
        def here() -> None:
            if self._watch.lost and not future.done():
                raise _NodeLost

        if not self.wait(future.done, timeout, here):
            raise _NodeLost


def goal_of(**fields: Any) -> Investigate.Goal:
    """Return a goal with these fields."""
    return Investigate.Goal(**fields)
