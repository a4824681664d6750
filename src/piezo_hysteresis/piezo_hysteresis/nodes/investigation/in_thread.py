"""Work for the thread that spins a node: what rclpy's clients ask is only safe to ask there.

An action client of rclpy notes whom an answer is for after it has sent the question. Asked from
another thread on a busy machine, the answer comes first, is nobody's, and is never heard of again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from rclpy.node import Node

T = TypeVar('T')


class _Work(Generic[T]):
    """Something to do, and what came of it."""

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
