"""A process ends although its executor loses a wake-up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from piezo_hysteresis.ros.running import LONGEST_WAIT, spin  # noqa: E402


class DeafExecutor:
    """Runs no timer, and returns from each wait only when its time is over."""

    def __init__(self, on_wait: Any) -> None:
        self.waits: list[float] = []
        self._on_wait = on_wait

    def spin_until_future_complete(self, future: Any, timeout_sec: float) -> None:
        assert len(self.waits) < 3, 'it does not end'
        self.waits.append(timeout_sec)
        self._on_wait()

    def add_node(self, node: Any) -> None:
        """Accept any node."""

    remove_node = add_node

    def shutdown(self) -> None:
        """Have nothing to shut down."""


def quiet_node() -> Any:
    timer = SimpleNamespace(cancel=lambda: None)
    context = SimpleNamespace(ok=lambda: True)
    return SimpleNamespace(context=context, create_timer=lambda *_, **__: timer)


@pytest.mark.parametrize('ends', ['signal', 'stop'])
def test_a_request_to_end_is_seen_without_a_timer(ends: str) -> None:
    interrupt, stop = SimpleNamespace(requested=False), rclpy.task.Future()

    def request() -> None:
        if ends == 'signal':
            interrupt.requested = True
        else:
            stop.set_result(True)

    executor: Any = DeafExecutor(request)
    spin([quiet_node()], executor, stop, interrupt)  # type: ignore[arg-type]
    assert executor.waits == [LONGEST_WAIT]
    assert LONGEST_WAIT <= 5.0
