"""Client of a running discovery node: requests an investigation and reports its progress."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from rclpy.action import ActionClient

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.investigation.action_watch import ActionWatch
from piezo_hysteresis.ros.client import Client
from piezo_interfaces.action import Investigate

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
