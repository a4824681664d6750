"""Whether the nodes that one waits for are starting, compiling or ready, by their diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from piezo_hysteresis.ros.diagnostics import TOPIC, state_of
from piezo_hysteresis.ros.readiness import Heartbeats


class Neighbours(Heartbeats):
    """The other nodes of a namespace."""

    def __init__(self, node: Node, *, everywhere: bool = False) -> None:
        super().__init__()
        self._node = node
        self._own = node.get_fully_qualified_name()
        self._place = None if everywhere else node.get_namespace().strip('/')
        node.create_subscription(DiagnosticArray, TOPIC, self._on_diagnostics, 10)

    def look(self) -> None:
        """Update the discovered nodes: each node publishes a heartbeat once it is created."""
        there = {
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(TOPIC)
            if self._place is None or info.node_namespace.strip('/') == self._place
        }
        self.update_discovered(there - {self._own})

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            there = self._place is None or status.hardware_id == self._place
            if there and status.name != self._own:
                self.note(status.name, state_of(status), status.message)
