"""A kernel that takes longer to compile than timeouts: no node aborts, all report it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes
from rcl_interfaces.msg import Log

from piezo_hysteresis.records import Record, write_bag
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_hysteresis.ros.readiness import FRESH
from piezo_interfaces.msg import ActuatorState, LoopStatus

pytestmark = pytest.mark.ros

SLOWLY = str(Path(__file__).parent / 'slow_kernels')
SIMULATOR = 'settle'  # the plant at rest
ATTENUATION = '_law.<locals>.step'  # of any law on harmonics


def slowed(folder: Path, kernel: str, seconds: float) -> dict[str, str]:
    """Return what makes the processes that have it in their environment compile slowly."""
    return {
        'PYTHONPATH': os.pathsep.join([SLOWLY, os.environ['PYTHONPATH']]),
        'NUMBA_CACHE_DIR': str(folder),
        'SLOW_KERNEL': kernel,
        'SLOW_SECONDS': str(seconds),
    }


@contextmanager
def slow(processes: LiveNodes, folder: Path, kernel: str, seconds: float) -> Iterator[None]:
    """Let nodes that are started meanwhile compile slowly."""
    before = dict(processes.environment)
    processes.environment.update(slowed(folder, kernel, seconds))
    yield
    processes.environment.clear()
    processes.environment.update(before)


def log(node: NodeProcess) -> str:
    return node.log.read_text(errors='replace')


def test_an_excitation_waits_for_an_actuator_that_compiles(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    said = listener.listen(Log, '/rosout')
    states = listener.listen(ActuatorState, 'actuator/state')
    health = listener.watch_health()
    held = tmp_path / 'held'  # until both were heard, however late the excitation starts
    held.touch()
    with slow(processes, tmp_path, SIMULATOR, 1.4 * FRESH):
        processes.environment['SLOW_WHILE'] = str(held)
        simulator = processes.start('piezo_sim', 'simulator', {'clock': 'lock_step'})
    listener.tells(health, 'simulator', 'state', 'starting')
    excitation = processes.start(
        'piezo_hysteresis',
        'excitation',
        {'mode': 'voltage', 'voltage.amplitude': 0.5, 'duration': 0.5, 'deadline': 3.0,
         'exit_when_done': True},
    )  # fmt: skip
    listener.says(health, 'simulator', None, 'starting: compiles its kernels')
    listener.says(
        health, 'excitation', None, 'waits for simulator: starting: compiles its kernels'
    )
    assert not states
    held.unlink()
    assert processes.wait_for(excitation, 120.0) == 0
    listener.until(lambda: len(states) >= 500)
    assert log(simulator).count('compiles its kernels (first start only)') == 1
    listener.until(lambda: any('waits for simulator: starting' in line.msg for line in said))


def test_a_lock_step_actuator_waits_for_a_link_that_compiles(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    """The excitation counts a link that starts for one that works, and so does the simulator."""
    health = listener.watch_health()
    processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'lock_step_deadline': 2.0})
    processes.start('piezo_hysteresis', 'feedforward')
    with slow(processes, tmp_path, ATTENUATION, 6.0):
        processes.start('piezo_hysteresis', 'attenuation', {'method': 'rls', 'orders': [3]})
    listener.tells(health, 'attenuation', 'state', 'starting')
    excitation = processes.start(
        'piezo_hysteresis',
        'excitation',
        {'mode': 'reference', 'reference.amplitude': 1e-6, 'duration': 0.5, 'deadline': 3.0,
         'wait_for': 2, 'exit_when_done': True},
    )  # fmt: skip
    listener.says(health, 'excitation', None, 'waits for attenuation: starting: compiles')
    assert processes.wait_for(excitation, 120.0) == 0


def test_a_player_waits_for_a_listener_that_compiles(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    bag = tmp_path / 'bag'
    phase = np.arange(500) * 0.03
    write_bag(bag, [Record('short', 1e-3, np.sin(phase), 1e-6 * np.sin(phase - 0.2))])
    received = listener.listen(LoopStatus, 'piezo/identification/status', latched=True)
    health = listener.watch_health()
    with slow(processes, tmp_path / 'kernels', 'update_many', 6.0):
        processes.start('piezo_hysteresis', 'identification', namespace='piezo')
    listener.tells(health, 'piezo/identification', 'state', 'starting')
    player = processes.start(
        'piezo_hysteresis', 'player', {'bag': str(bag), 'lock_step': True, 'wait': 3.0}
    )
    assert processes.wait_for(player, 120.0) == 0
    listener.until(lambda: bool(received) and received[-1].counts[0] == 500)


@pytest.mark.slow
def test_the_demo_passes_while_a_kernel_compiles_for_a_minute(tmp_path: Path) -> None:
    words = ['-m', 'piezo_hysteresis', 'demo', '--out', str(tmp_path / 'out')]
    env = {**os.environ, **slowed(tmp_path / 'kernels', SIMULATOR, 60.0)}
    done = subprocess.run([sys.executable, *words], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    none, feedforward, attenuated = (run['rmse_m'] for run in summary['tracking']['runs'])
    assert attenuated < feedforward < none
    assert summary['parts_seconds']['sweep'] > 60.0
