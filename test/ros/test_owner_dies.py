"""Nodes do not outlive the process that started them, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from listening import Listener

from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_interfaces.msg import ActuatorState

pytestmark = pytest.mark.ros

RAMP, RATE = 2.0, 200.0

# Starts two nodes, says which, and would wait for ever.
OWNER = """
import sys, time
from piezo_hysteresis.ros.processes import NodeProcesses
with NodeProcesses(int(sys.argv[1])) as nodes:
    drive = {'rate': 200.0, 'mode': 'voltage', 'voltage.offset': 0.5, 'voltage.amplitude': 0.0}
    started = [
        nodes.start('piezo_hysteresis', 'excitation', drive),
        nodes.start('piezo_sim', 'simulator', {'rate': 200.0}, namespace='elsewhere'),
    ]
    print(*(node.pid for node in started), flush=True)
    time.sleep(600.0)
"""


def runs(pid: int) -> bool:
    """Tell whether a process runs; one that has ended may wait for somebody to notice."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def test_nodes_end_when_their_owner_is_killed_and_the_actuator_goes_to_safety(
    processes: NodeProcesses, listener: Listener
) -> None:
    states = listener.listen(ActuatorState, 'actuator/state')
    elsewhere = listener.listen(ActuatorState, 'elsewhere/actuator/state')
    processes.start('piezo_sim', 'simulator', {'rate': RATE, 'ramp': RAMP})
    owner = subprocess.Popen(
        [sys.executable, '-c', OWNER, str(processes.domain)],
        env=processes.environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert owner.stdout is not None
    pids = [int(word) for word in owner.stdout.readline().split()]
    try:
        listener.until(lambda: elsewhere and any(s.voltage > 0.3 for s in states))
        assert all(runs(pid) for pid in pids)
    finally:
        owner.kill()
        owner.wait()
    count = len(states)
    try:
        listener.until(lambda: not any(runs(pid) for pid in pids), 60.0)
    finally:
        for pid in pids:
            if runs(pid):
                os.kill(pid, signal.SIGKILL)
    assert len(pids) == 2
    listener.until(lambda: states[-1].voltage == 0.0, 60.0)
    tail = [state for state in states[count:] if state.voltage >= 0.0]
    falling = [a.voltage - b.voltage for a, b in pairwise(tail) if b.sample == a.sample + 1]
    assert 0.0 < max(falling) <= RAMP / RATE * (1 + 1e-9)
