"""Nodes of one domain, started by the names of their executables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from piezo_hysteresis.cli.node import PACKAGES
from piezo_ros_common.processes import NodeProcess, NodeProcesses


class LiveNodes(NodeProcesses):
    """Nodes of one domain.

    Each is a process of its own: a node that ends in a thread can leave Fast DDS 2.14 spinning
    with the lock of Python held, and the test with it.
    """

    def serve(
        self,
        executable: str,
        parameters: Mapping[str, object] | None = None,
        *,
        name: str = '',
        namespace: str = '',
        remap: Mapping[str, str] | None = None,
        files: Sequence[Path] = (),
    ) -> NodeProcess:
        """Start a node by the name of its executable."""
        package = PACKAGES[executable]
        return NodeProcesses.start(
            self, package, executable, parameters,
            name=name, namespace=namespace, remap=remap, files=files,
        )  # fmt: skip
