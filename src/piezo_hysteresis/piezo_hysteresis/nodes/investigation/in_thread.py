"""Work for the thread that spins a node: only there are requests of rclpy clients safe.

An action client of rclpy registers a request after sending it. If it is sent from another thread
on a busy machine, the response can arrive before the registration and is lost.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from rclpy.node import Node

T = TypeVar('T')


class _Work(Generic[T]):
    """A task and its result."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._done = threading.Event()
        self._result: list[T] = []
        self._error: Exception | None = None

    def __call__(self) -> None:
        try:
            self._result.append(self._work())
        except Exception as error:  # handed to the waiting thread
            self._error = error
        finally:
            self._done.set()

    def result(self) -> T:
        self._done.wait()
        if self._error is not None:
            raise self._error
        return self._result[0]


def in_thread_of(node: Node, work: Callable[[], T]) -> T:
    """Do something in the thread that spins a node, and return its result; from any other one."""
    task = _Work(work)
    node.executor.create_task(task)
    return task.result()
