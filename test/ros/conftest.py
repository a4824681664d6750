"""Processes and listeners of their own for every test or module, each in its own ROS domain."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

# As nodes that are processes have it: who has another range is not found.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

rclpy = pytest.importorskip('rclpy', reason='the workspace is not built: run "make setup"')

from listening import Listener  # noqa: E402
from live_nodes import LiveNodes  # noqa: E402

from piezo_hysteresis.ros.processes import NodeProcesses  # noqa: E402

# Files that take longest, the longest first. A worker runs whole files, and one that began such a
# file last would be alone with it.
LONG = (
    'test_dashboard_live',
    'test_sweep_records',
    'test_slow_kernels',
    'test_nothing_compiles',
    'test_record_and_play',
    'test_excitation',
    'test_ends',
    'test_discovery_live',
    'test_restarts',
    'test_fault_campaign',
    'test_demo',
    'test_chain',
    'test_coupled_loop',
    'test_lock_step',
    'test_investigation_live',
    'test_verbs_for_nodes',
    'test_fork_server',
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest; the others stay in their order."""
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.stem, len(LONG)))


@pytest.fixture
def processes() -> Iterator[LiveNodes]:
    with LiveNodes() as group:
        yield group


@pytest.fixture
def started_processes() -> Iterator[NodeProcesses]:
    """Return a group for tests of how processes start: none of them is forked."""
    with NodeProcesses() as group:
        yield group


@pytest.fixture
def listener(processes: LiveNodes) -> Iterator[Listener]:
    recorder = Listener(processes)
    yield recorder
    recorder.close()


@pytest.fixture(scope='module')
def shared_processes() -> Iterator[LiveNodes]:
    with LiveNodes() as group:
        yield group


@pytest.fixture(scope='module')
def shared_listener(shared_processes: LiveNodes) -> Iterator[Listener]:
    recorder = Listener(shared_processes)
    yield recorder
    recorder.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: Any, call: Any) -> Any:
    """Show what the nodes printed where a test fails."""
    report = yield
    if report.failed:
        for group in getattr(item, 'funcargs', {}).values():
            if isinstance(group, NodeProcesses):
                for node in group.nodes:
                    title = f'{node.name} (code {node.returncode})'
                    report.sections.append((title, node.tail(20).replace(' | ', '\n')))
    return report
