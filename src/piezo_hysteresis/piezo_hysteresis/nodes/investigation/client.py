"""Asks a running discovery node to investigate, and tells how it stands."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.investigation.action_watch import ActionWatch
from piezo_hysteresis.ros.middleware import prepare
from piezo_hysteresis.ros.running import destroy
from piezo_interfaces.action import Investigate

# For a discovery node to be found, and to come back after a restart [s].
FOUND_WITHIN, BACK_WITHIN = 15.0, 120.0
# For it to say whether it takes a goal [s].
ANSWERS_WITHIN = 30.0


class _Gone(Exception):
    """The discovery node has gone."""


class Asking:
    """Asks for the life of a `with` block.

    Parameters
    ----------
    namespace : str
        Of the discovery node.
    """

    def __init__(self, namespace: str = '') -> None:
        prepare()
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._node = Node(
            '_investigate',
            namespace=namespace,
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._client = ActionClient(self._node, Investigate, 'investigate')
        self._watch = ActionWatch(self._node, self._client, 'investigate')

    def __enter__(self) -> Asking:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        destroy(self._node)
        rclpy.shutdown(context=self._context)

    def investigate(
        self, goal: Investigate.Goal, on_feedback: Callable[[Investigate.Feedback], None]
    ) -> Investigate.Result:
        """Return the result of a goal; it goes on where the discovery node is started anew.

        An interruption cancels it, and waits until the actuator is at rest.

        Raises
        ------
        PiezoError
            If nobody offers it, or it is refused.
        """
        patience = FOUND_WITHIN
        while True:
            if not self._until(self._client.server_is_ready, patience):
                raise PiezoError(
                    'no discovery node is running: start it, and say the same words again'
                )
            try:
                return self._once(goal, on_feedback)
            except _Gone:
                patience = BACK_WITHIN

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
            raise PiezoError('the discovery node refused; its log says why')
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
        except _Gone:
            raise PiezoError('the discovery node has gone: see that the actuator rests') from None

    def _follow(self, future: Any, patience: float = inf) -> None:
        end = time.monotonic() + patience
        while not future.done():
            self._executor.spin_once(timeout_sec=0.05)
            late = time.monotonic() > end
            if (late or self._watch.lost) and not future.done():
                raise _Gone

    def _until(self, condition: Callable[[], bool], patience: float) -> bool:
        end = time.monotonic() + patience
        while not condition() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)
        return condition()


def goal_of(**fields: Any) -> Investigate.Goal:
    """Return a goal with these fields."""
    return Investigate.Goal(**fields)
