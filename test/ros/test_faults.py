"""Nodes that die or cannot start: one line that says why, an exit code, nothing left running."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.ros.processes import NodeProcesses, ProcessError
from piezo_interfaces.msg import ActuatorState

pytestmark = pytest.mark.ros

# What each node is started with, and a word of the reason for which it must refuse.
WRONG: list[tuple[str, dict[str, Any], str]] = [
    ('simulator', {'preset': 'no_such_actuator'}, 'fdk_pzba_00030'),
    ('simulator', {'structure.damping_ratio': -1.0}, 'structure.damping_ratio'),
    ('simulator', {'amplifier.range_low': 6.0}, 'amplifier.range'),
    ('simulator', {'rate': 'fast'}, 'rate'),
    ('excitation', {'frequency': 500.0}, 'sampled'),
    ('feedforward', {'limits.low': 2.0}, 'limits.low'),
    ('feedforward', {'model_file': 'no_such.yaml'}, 'no_such.yaml'),
    ('attenuation', {'orders': [3, -2]}, 'orders'),
    ('feedback', {'pid.integral': '.nan'}, 'pid.integral'),
    ('identification', {'harmonic': 4}, 'harmonic'),
    ('recorder', {}, 'out'),
    ('player', {}, 'bag'),
    ('player', {'bag': '[half a list'}, 'arguments'),
]


def says_why(text: str, word: str) -> None:
    own = [line for line in text.strip().splitlines() if '[rcl]' not in line]
    assert len(own) == 1, text
    assert word in text


def test_a_failed_start_is_reported_in_one_line(processes: LiveNodes) -> None:
    # A few at a time: they mostly wait for the disk.
    for first in range(0, len(WRONG), 6):
        started = [
            (processes.start(package_of(name), name, values), word)
            for name, values, word in WRONG[first : first + 6]
        ]
        for node, word in started:
            assert node.wait(60.0) == 2, node.tail()
            says_why(node.log.read_text(), word)
            processes.retire(node)


def test_a_dead_link_ends_the_experiment_and_leaves_nothing_running() -> None:
    with LiveNodes() as processes:
        listener = Listener(processes)
        states = listener.listen(ActuatorState, 'actuator/state')
        processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'wait_for': 3})
        processes.start('piezo_hysteresis', 'feedforward')
        victim = processes.start('piezo_hysteresis', 'attenuation')
        settings = {'mode': 'reference', 'exit_when_done': True, 'deadline': 60.0, 'wait_for': 2}
        listener.matched('actuator/state')
        excitation = processes.start('piezo_hysteresis', 'excitation', settings)
        listener.until(lambda: len(states) > 100)
        assert listener.set_one('excitation', 'deadline', 1.0) == ''
        victim.signal(signal.SIGKILL)
        victim.wait(5.0)
        with pytest.raises(ProcessError, match='attenuation') as caught:
            processes.wait_for(excitation, 30.0)
        assert '\n' not in str(caught.value)

        assert excitation.wait(30.0) == 3
        text = excitation.log.read_text()
        assert 'Traceback' not in text
        (error,) = [line for line in text.splitlines() if 'ERROR' in line]
        assert 'a link of the chain is not running' in error
        pids = [node.pid for node in (victim, excitation)]
        listener.close()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


# What is started and ended at once: each executable, and a moment of its start [s].
STARTS = [
    ('piezo_sim', 'simulator', 0.0),
    ('piezo_sim', 'simulator', 0.4),
    ('piezo_hysteresis', 'feedforward', 0.0),
    ('piezo_hysteresis', 'excitation', 0.05),
    ('piezo_hysteresis', 'attenuation', 0.1),
    ('piezo_hysteresis', 'control_loop', 0.2),
    ('piezo_hysteresis', 'identification', 0.6),
    ('piezo_hysteresis', 'gap_monitor', 0.3),
]


def test_a_node_that_is_interrupted_while_it_starts_ends_in_silence(
    started_processes: NodeProcesses,
) -> None:
    for package, name, moment in STARTS:
        node = started_processes.start(package, name)
        time.sleep(moment)
        node.signal(signal.SIGINT)
        assert node.wait(60.0) == 0, node.tail()
        assert 'Traceback' not in node.log.read_text(), node.tail(20)
        started_processes.retire(node)
