"""A listener in the test's own process, with a context and domain of its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

from piezo_ros_common.qos import LATCHED, LOOP


class Listener:
    """Collects messages and calls services of the nodes under test.

    Parameters
    ----------
    domain : int
        ROS domain of the processes under test.
    """

    def __init__(self, domain: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node('listener', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.heard: dict[str, list[Any]] = {}

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def listen(self, kind: type, topic: str, *, latched: bool = False) -> None:
        """Collect every message of `topic` in ``heard[topic]``."""
        book = self.heard.setdefault(topic, [])
        self.node.create_subscription(kind, topic, book.append, LATCHED if latched else LOOP)

    def until(self, condition: Callable[[], bool], timeout: float = 20.0) -> None:
        """Serve until `condition` holds.

        Raises
        ------
        AssertionError
            If it does not within `timeout` seconds.
        """
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, 'the awaited condition did not come true'
            self._executor.spin_once(timeout_sec=0.05)

    def matched(self, topic: str, timeout: float = 20.0) -> None:
        """Serve until somebody publishes `topic`."""
        self.until(lambda: self.node.count_publishers(topic) > 0, timeout)

    def call(self, kind: type, service: str, request: Any, timeout: float = 20.0) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, timeout)
        future = client.call_async(request)
        self.until(future.done, timeout)
        self.node.destroy_client(client)
        return future.result()

    def set_parameters(
        self, node: str, values: dict[str, Any], timeout: float = 20.0
    ) -> list[Any]:
        """Set parameters over the node's service, as ``ros2 param set`` does; return results."""
        client = AsyncParameterClient(self.node, node)
        self.until(client.services_are_ready, timeout)
        parameters = [rclpy.Parameter(name, value=value) for name, value in values.items()]
        future = client.set_parameters(parameters)
        self.until(future.done, timeout)
        return list(future.result().results)
