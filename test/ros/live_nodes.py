"""Nodes of one domain."""

from __future__ import annotations

from piezo_ros_common.processes import NodeProcesses


class LiveNodes(NodeProcesses):
    """Nodes of one domain.

    Each is a process of its own: a node that ends in a thread can leave Fast DDS 2.14 spinning
    with the lock of Python held, and the test with it.
    """
