"""A forked node behaves as a started one, and ends with the process that asked for it."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from listening import Listener
from live_nodes import ForkedNode, LiveNodes
from rcl_interfaces.srv import GetParameters, ListParameters

from piezo_hysteresis.ros.processes import NodeProcess, NodeProcesses

pytestmark = pytest.mark.ros

SETTINGS = {'gain': 2e-4, 'limits.slew': 60.0}

OWNER = """
import sys, time
from live_nodes import LiveNodes
with LiveNodes(int(sys.argv[1])) as nodes:
    print(nodes.start('piezo_sim', 'simulator').pid, flush=True)
    time.sleep(600.0)
"""


def parameters_of(listener: Listener, space: str) -> dict[str, Any]:
    node = f'{space}/feedforward'
    request = ListParameters.Request()
    names = listener.call(ListParameters, f'{node}/list_parameters', request).result.names
    asked = GetParameters.Request(names=sorted(names))
    values = listener.call(GetParameters, f'{node}/get_parameters', asked).values
    return dict(zip(asked.names, values, strict=True))


def signals_of(node: NodeProcess) -> dict[str, str]:
    lines = Path(f'/proc/{node.pid}/status').read_text().splitlines()
    masks = 'SigBlk', 'SigIgn', 'SigCgt'
    return dict(line.split(':', 1) for line in lines if line.startswith(masks))


def threads_of(node: NodeProcess) -> list[str]:
    """Return the names of the threads of a node, without the ports that they serve."""
    names = (path.read_text() for path in Path(f'/proc/{node.pid}/task').glob('*/comm'))
    return sorted(re.sub(r'\d+', '', name) for name in names)


def test_a_forked_node_is_and_ends_as_a_started_one(
    processes: LiveNodes, listener: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with NodeProcesses(processes.domain) as others:
        groups = {'forked': processes, 'started': others}
        forked, started = pair = [
            group.start('piezo_hysteresis', 'feedforward', SETTINGS, namespace=space)
            for space, group in groups.items()
        ]
        assert isinstance(forked, ForkedNode)
        assert not isinstance(started, ForkedNode)

        known, expected = (parameters_of(listener, space) for space in groups)
        assert known == expected
        assert known['gain'].double_value == SETTINGS['gain']
        assert signals_of(forked) == signals_of(started)
        listener.until(lambda: threads_of(forked) == threads_of(started))
        for node in pair:
            assert os.getsid(node.pid) == os.getpgid(node.pid) == node.pid
            assert Path(f'/proc/{node.pid}/cwd').resolve() == tmp_path.resolve()

        for node in pair:
            assert node.returncode is None
            node.signal(signal.SIGINT)
        assert [node.wait(20.0) for node in pair] == [0, 0]
        assert words_of(forked) == words_of(started)


def test_the_code_of_a_killed_node_names_the_signal(processes: LiveNodes) -> None:
    node = processes.start('piezo_hysteresis', 'feedforward')
    node.signal(signal.SIGKILL)
    assert node.wait(20.0) == -signal.SIGKILL
    processes.retire(node)


def words_of(node: NodeProcess) -> list[str]:
    """Return what a node logged, without the times and its own name.

    Warnings of rclpy that an answer came too late are of the machine, and not of the node.
    """
    text = node.log.read_text()
    return [line.partition(']: ')[2] for line in text.splitlines() if ']: ' in line]


def test_a_node_that_refuses_its_parameters_gives_the_same_code_and_reason(
    processes: LiveNodes,
) -> None:
    with NodeProcesses(processes.domain) as others:
        refused = [
            group.start('piezo_hysteresis', 'feedforward', {'limits.low': 2.0})
            for group in (processes, others)
        ]
        assert [node.wait(30.0) for node in refused] == [2, 2]
        words = [node.log.read_text().splitlines() for node in refused]
        assert words[0] == words[1]
        assert [line.partition(' ')[0] for line in words[0]] == ['error:']
        for group, node in zip((processes, others), refused, strict=True):
            group.retire(node)


def test_a_forked_node_ends_when_its_client_is_killed(
    processes: LiveNodes, listener: Listener
) -> None:
    owner = subprocess.Popen(
        [sys.executable, '-c', OWNER, str(processes.domain)],
        env=processes.environment,
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert owner.stdout is not None
        end = os.pidfd_open(int(owner.stdout.readline()))
        listener.until(lambda: 'simulator' in listener.node.get_node_names())
    finally:
        owner.kill()
        owner.wait()
    poll = select.poll()
    poll.register(end, select.POLLIN)
    assert poll.poll(30_000)
    os.close(end)


def test_what_is_read_at_loading_asks_for_a_process_of_its_own(
    processes: LiveNodes, tmp_path: Path
) -> None:
    processes.environment['NUMBA_CACHE_DIR'] = str(tmp_path)
    node = processes.start('piezo_hysteresis', 'recorder')
    assert not isinstance(node, ForkedNode)
    assert node.wait(30.0) == 2
    processes.retire(node)
