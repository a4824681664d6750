"""Publishes the health of a node on ``/diagnostics``: every second and when the level changes.

While the node starts or compiles kernels, the value ``state`` reports it at the same rate, so that
waiting nodes suspend their timeouts (`neighbours`).
"""

from __future__ import annotations

import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.node import Node

from piezo_hysteresis.common.node_sheet import HOLD, Health, Level
from piezo_hysteresis.ros.guarded import Guarded
from piezo_hysteresis.ros.readiness import HeartbeatPublisher, Readiness
from piezo_hysteresis.ros.running import wall_timer

TOPIC = '/diagnostics'

# Period of the check for a change of level, and the longest time between two messages [s].
LOOK = 0.2
PERIOD = 1.0

# Timeout for the delivery of the final status of a node.
FINAL_STATUS_TIMEOUT = Duration(seconds=1)


# Key of the value that states whether the node can respond.
STATE = 'state'


class Diagnostics:
    """Publishes the health of a node; create it before any slow initialization."""

    def __init__(self, node: Guarded, ask: Callable[[], Health]) -> None:
        self._node = node
        self._ask = ask
        self._level: Level | None = None
        self._reported = 0.0
        # That of a managed node would be mute while the node is inactive.
        self._publisher = Node.create_publisher(node, DiagnosticArray, TOPIC, 10)
        self._heartbeat = HeartbeatPublisher(self._starts, self._compiles)
        node.context.on_shutdown(self._heartbeat.close)
        wall_timer(node, LOOK, self.look)

    def look(self) -> None:
        """Publish if the level has changed or one second has elapsed."""
        self._heartbeat.ready()
        now = time.monotonic()
        health = self._with_failures(self._ask(), now)
        if health.level == self._level and now - self._reported < PERIOD - 0.5 * LOOK:
            return
        self._level, self._reported = health.level, now
        self._publish(Readiness.READY, health)

    def _with_failures(self, health: Health, now: float) -> Health:
        """Add failures of callbacks: an error for a while, then a count."""
        node = self._node
        if not node.callback_failures:
            return health
        values = {**health.values, 'callback_failures': node.callback_failures}
        if now - node.last_failed > HOLD:
            return Health(health.level, health.message, values)
        return Health(Level.ERROR, f'a callback failed: {node.last_failure}', values)

    def _starts(self, state: Readiness, message: str) -> None:
        self._publish(state, Health(Level.OK, message))

    def _compiles(self) -> None:
        self._node.get_logger().info(
            'compiles its kernels (first start only); waiting nodes extend their timeouts'
        )

    def _publish(self, state: Readiness, health: Health) -> None:
        values = {STATE: state.value, **health.values}
        status = DiagnosticStatus(
            level=bytes([health.level]),
            name=self._node.get_fully_qualified_name(),
            message=health.message,
            hardware_id=self._node.get_namespace().strip('/'),
            values=[KeyValue(key=key, value=_text(v)) for key, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def publish_final_status(self) -> None:
        """Publish the final status and wait until it is delivered."""
        self._level = None
        self.look()
        self._publisher.wait_for_all_acked(FINAL_STATUS_TIMEOUT)


def state_of(status: DiagnosticStatus) -> str:
    """Return the reported state of a node, empty if there is none."""
    return next((str(each.value) for each in status.values if each.key == STATE), '')


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
