"""Processes and listeners of their own for every test, in a ROS domain of their own."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator

import pytest

from piezo_ros_common.processes import NodeProcesses

rclpy = pytest.importorskip('rclpy', reason='the workspace is not built: run "make setup"')

from listening import Listener  # noqa: E402

_domains = itertools.count(os.getpid() % 90)


@pytest.fixture
def processes() -> Iterator[NodeProcesses]:
    with NodeProcesses(domain=1 + next(_domains) % 100) as group:
        yield group


@pytest.fixture
def listener(processes: NodeProcesses) -> Iterator[Listener]:
    ear = Listener(processes.domain)
    yield ear
    ear.close()
