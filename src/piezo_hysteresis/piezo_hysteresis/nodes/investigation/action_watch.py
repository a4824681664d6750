"""Detection of a restarted action server during a goal."""

from __future__ import annotations

import time

from rclpy.action import ActionClient
from rclpy.node import Node

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
