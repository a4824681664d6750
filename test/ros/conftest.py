"""Processes and listeners of their own for every test or module, each in its own ROS domain."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from piezo_ros_common.processes import NodeProcesses

rclpy = pytest.importorskip('rclpy', reason='the workspace is not built: run "make setup"')

from listening import Listener  # noqa: E402


@pytest.fixture
def processes() -> Iterator[NodeProcesses]:
    with NodeProcesses() as group:
        yield group


@pytest.fixture
def listener(processes: NodeProcesses) -> Iterator[Listener]:
    ear = Listener(processes)
    yield ear
    ear.close()


@pytest.fixture(scope='module')
def shared_processes() -> Iterator[NodeProcesses]:
    with NodeProcesses() as group:
        yield group


@pytest.fixture(scope='module')
def shared_listener(shared_processes: NodeProcesses) -> Iterator[Listener]:
    ear = Listener(shared_processes)
    yield ear
    ear.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Show what the nodes printed where a test fails."""
    report = yield
    if report.failed:
        for group in getattr(item, 'funcargs', {}).values():
            if isinstance(group, NodeProcesses):
                for node in group.nodes:
                    title = f'{node.name} (code {node.returncode})'
                    report.sections.append((title, node.tail(20).replace(' | ', '\n')))
    return report
