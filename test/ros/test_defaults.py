"""Every node starts with nothing but what it needs, answers, and ends with Ctrl-C."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from listening import Listener
from rcl_interfaces.srv import ListParameters

from piezo_hysteresis.common.registry import NODES, package_of
from piezo_hysteresis.records import Record, write_bag
from piezo_hysteresis.ros.processes import NodeProcesses

# `test_ends` starts all of them at once in a tenth of the time.
pytestmark = [pytest.mark.ros, pytest.mark.slow]

# What a node cannot do without; the page takes any port that is free.
NEEDED: dict[str, Callable[[Path], dict[str, object]]] = {
    'recorder': lambda folder: {'out': str(folder / 'recorded')},
    'player': lambda folder: {'bag': str(folder / 'bag')},
    'dashboard': lambda folder: {'port': 0},
    'gcs_driver': lambda folder: {'controller': 'gcs://127.0.0.1:1'},
}
INSIDE = {'control_loop': ('excitation', 'feedforward', 'attenuation', 'feedback')}


@pytest.fixture
def processes(started_processes: NodeProcesses) -> NodeProcesses:
    return started_processes


@pytest.mark.parametrize('name', sorted(NODES))
def test_a_node_starts_answers_and_ends(
    processes: NodeProcesses, listener: Listener, tmp_path: Path, name: str
) -> None:
    voltage = np.sin(2 * np.pi * 5.0 * np.arange(20000) * 1e-3)
    write_bag(tmp_path / 'bag', [Record('a', 1e-3, voltage, 1e-4 * voltage)])
    settings = NEEDED[name](tmp_path) if name in NEEDED else {}
    node = processes.start(package_of(name), name, settings)
    for each in INSIDE.get(name, (name,)):
        answer = listener.call(ListParameters, f'{each}/list_parameters', ListParameters.Request())
        assert answer.result.names
    node.signal(signal.SIGINT)
    assert node.wait(30) == 0, node.tail(10)
    assert 'Traceback' not in node.log.read_text()


@pytest.mark.parametrize(
    ('name', 'needed'), [('recorder', 'out'), ('player', 'bag'), ('gcs_driver', 'controller')]
)
def test_a_node_without_a_requirement_reports_it(
    processes: NodeProcesses, name: str, needed: str
) -> None:
    node = processes.start(package_of(name), name)
    assert node.wait(60) == 2
    text = node.log.read_text()
    (line,) = text.strip().splitlines()
    assert line.startswith('error: ')  # as of a verb, without level and time of the log
    assert needed in line
