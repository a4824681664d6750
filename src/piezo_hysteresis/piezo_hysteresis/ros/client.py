"""Blocking ROS client: a node with its own context, which calls other nodes and waits."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf
from typing import Self

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from piezo_hysteresis.ros.running import destroy, joined


class Client:
    """Lives for a `with` block, or until it is closed; spins only while it waits."""

    def __init__(self, name: str, domain: int | None = None, *, namespace: str = '') -> None:
        self._context = joined(domain)
        self.node = Node(
            name, namespace=namespace, context=self._context, enable_rosout=False,
            start_parameter_services=False,
        )  # fmt: skip
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        destroy(self.node)
        rclpy.shutdown(context=self._context)

    def spin_once(self, seconds: float = 0.05) -> None:
        """Execute the next callback, if one is due within `seconds`."""
        self._executor.spin_once(timeout_sec=seconds)

    def wait(
        self,
        condition: Callable[[], object],
        seconds: float = inf,
        check: Callable[[], object] = lambda: None,
    ) -> bool:
        """Spin until `condition` holds or the timeout expires; return whether it holds.

        `check` is also called; it raises if the condition can no longer become true.
        """
        end = time.monotonic() + seconds
        while not condition():
            check()
            if time.monotonic() > end:
                return False
            self.spin_once()
        return True
