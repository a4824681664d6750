"""Nodes whose callbacks cannot end the process: a failure is answered, logged and counted.

An exception that leaves a callback ends the events executor with a segmentation fault, and any
executor with the process. Every callback of a guarded node is therefore wrapped where rclpy learns
of it: subscriptions, timers, services (those of rclpy too), actions and tasks.
"""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Awaitable, Callable
from functools import partial, wraps
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.waitable import Waitable

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.ros.cdr_header import with_floats

# A callback that fails this many times in succession makes its node go to its safe state.
PERSISTENT = 10
# Shortest time between two reports of the same callback [s].
REPORT_EVERY = 10.0

Callback = Callable[..., Any]


class Guarded(Node):
    """Wraps the callbacks of a node."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.callback_failures = 0
        self.last_failure, self.last_failed = '', -math.inf
        self._in_succession: dict[str, int] = {}
        self._report_due: dict[str, float] = {}
        super().__init__(*arguments, **options)
        for service in self.services:  # rclpy adds some without `create_service`
            if not hasattr(service.callback, '__wrapped__'):
                service.callback = self.guard(service.callback, _refused)

    def create_publisher(self, kind: Any, topic: str, *a: Any, **k: Any):  # type: ignore[no-untyped-def]
        """As that of rclpy; numbers that it publishes are made floats."""
        return sends_floats(super().create_publisher(kind, topic, *a, **k))

    def create_subscription(self, kind: Any, topic: str, callback: Callback, *a: Any, **k: Any):  # type: ignore[no-untyped-def]
        """As that of rclpy, for a callback that may fail."""
        return super().create_subscription(kind, topic, self.guard(callback), *a, **k)

    def create_timer(self, period: float, callback: Callback, *a: Any, **k: Any):  # type: ignore[no-untyped-def]
        """As that of rclpy, for a callback that may fail."""
        return super().create_timer(period, self.guard(callback), *a, **k)

    def create_service(self, kind: Any, name: str, callback: Callback, *a: Any, **k: Any):  # type: ignore[no-untyped-def]
        """As that of rclpy; the response to a callback that fails states the reason."""
        return super().create_service(kind, name, self.guard(callback, _refused), *a, **k)

    def add_waitable(self, waitable: Waitable) -> None:
        """As that of rclpy, for the action servers and clients of the node."""
        execute = waitable.execute

        @wraps(execute)
        async def guarded(taken: Any) -> None:
            try:
                await execute(taken)
            except Exception as error:
                self.note_failure(execute.__qualname__, error)

        waitable.execute = guarded
        super().add_waitable(waitable)

    def run_later(self, callback: Callback, *arguments: Any) -> None:
        """Call `callback` in the thread that spins the node; also from other threads."""
        if self.executor is not None:
            self.executor.create_task(self.guard(callback), *arguments)

    def guard(self, callback: Callback, answer: Callback | None = None) -> Callback:
        """Return `callback` without its exceptions."""
        name = callback_name(callback)
        in_succession = self._in_succession

        @wraps(callback)
        def guarded(*arguments: Any) -> Any:
            try:
                result = callback(*arguments)
            except Exception as error:
                reason = self.note_failure(name, error)
                return None if answer is None else answer(reason, *arguments)
            if in_succession:
                in_succession.pop(name, None)
            return result

        return guarded

    def note_failure(self, name: str, error: Exception) -> str:
        """Count a failure of the callback `name`, log it now and then, and return its reason."""
        reason, now = _reason(error), time.monotonic()
        self.callback_failures += 1
        self.last_failure, self.last_failed = reason, now
        if now >= self._report_due.get(name, now):
            self._report_due[name] = now + REPORT_EVERY
            trace = '' if isinstance(error, PiezoError | OSError) else traceback.format_exc()
            self.get_logger().error(f'{name} failed: {reason}\n{trace}'.rstrip())
        failures = self._in_succession[name] = self._in_succession.get(name, 0) + 1
        if failures == PERSISTENT:
            try:
                self.go_safe(f'{name} failed {failures} times in succession: {reason}')
            except Exception as unsafe:
                self.get_logger().error(f'no safe state was reached: {_reason(unsafe)}')
        return reason

    def go_safe(self, reason: str) -> None:
        """Go to the safe state of the node, because a callback fails persistently."""


class GuardedNode(Guarded):
    """A node whose callbacks may fail."""


class GuardedLifecycleNode(Guarded, LifecycleNode):
    """A managed node whose callbacks may fail."""


def callback_name(callback: Any) -> str:
    """Return the name under which failures count, of a partial one with its numbers.

    The callbacks of several axes are one function with other numbers; each has its own failures.
    """
    if isinstance(callback, partial):
        numbers = ', '.join(str(each) for each in callback.args if isinstance(each, int))
        return f'{callback_name(callback.func)}({numbers})'
    return str(getattr(callback, '__qualname__', type(callback).__name__))


def sends_floats(publisher: Publisher) -> Publisher:
    """Return a publisher that makes the float64 of its messages floats; bytes pass as they are."""
    send, send_bytes = publisher.publish, publisher.handle.publish_raw

    def publish(message: Any) -> None:
        if type(message) is bytes:
            send_bytes(message)
        else:
            send(with_floats(message))

    publisher.publish = publish
    return publisher


def serve_action(
    node: Guarded,
    kind: Any,
    name: str,
    judge: Callable[[Any], GoalResponse],
    execute: Callable[[Any], Awaitable[Any]],
) -> ActionServer:
    """Return the server of an action whose goals can be cancelled.

    A goal whose check fails is rejected; one whose execution fails is aborted with the reason.
    """

    async def executed(goal: Any) -> Any:
        try:
            return with_floats(await execute(goal))
        except Exception as error:
            reason = node.note_failure(name, error)
            if goal.is_active:
                goal.abort()
            return _with_reason(kind.Result(), reason)

    return ActionServer(
        node,
        kind,
        name,
        execute_callback=executed,
        goal_callback=node.guard(judge, lambda *_: GoalResponse.REJECT),
        cancel_callback=lambda _: CancelResponse.ACCEPT,
    )


def _reason(error: Exception) -> str:
    if isinstance(error, PiezoError):
        return str(error)
    return reason_of(error) if isinstance(error, OSError) else f'{type(error).__name__}: {error}'


def _refused(reason: str, request: Any, response: Any) -> Any:
    """Return the response of a service that failed."""
    parts = [response]
    if hasattr(response, 'results') and hasattr(request, 'parameters'):  # rcl_interfaces
        from rcl_interfaces.msg import SetParametersResult

        response.results = [SetParametersResult() for _ in request.parameters]
        parts = list(response.results)
    elif hasattr(response, 'result'):
        parts = [response.result]
    for part in parts:
        _with_reason(part, reason)
    return response


def _with_reason(part: Any, reason: str) -> Any:
    """Return a result with the fields that state a failure."""
    for name, value in (
        ('success', False), ('successful', False), ('message', reason), ('reason', reason),
    ):  # fmt: skip
        if hasattr(part, name):
            setattr(part, name, value)
    return part
