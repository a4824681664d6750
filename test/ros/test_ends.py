"""A node that ends leaves nothing to end beside the process."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from listening import Listener
from rclpy.action import ActionClient

from piezo_hysteresis.parameters.sheets import SHEETS
from piezo_hysteresis.records import Record, write_bag
from piezo_interfaces.action import Discover
from piezo_ros_common.processes import NodeProcesses
from piezo_sim.sweep import simulate

pytestmark = pytest.mark.ros

# Threads of the middleware and of Python that are left when a node has done its work. The watchdog
# of shared memory belongs to no participant, the one of the owner uses nothing of the node.
RUNS = """
import atexit, pathlib, runpy, sys, threading

@atexit.register
def tell():
    names = (path.read_text().strip() for path in pathlib.Path('/proc/self/task').glob('*/comm'))
    left = [name for name in names if name.startswith('dds.')]
    left += [thread.name for thread in threading.enumerate()]
    print('left:', *sorted(left), flush=True)

sys.argv.pop(0)
runpy.run_path(sys.argv[0], run_name='__main__')
"""
OF_THE_PROCESS = {'dds.shm.wdog', 'MainThread', 'owner'}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    time = np.arange(500) * 1e-3
    write_bag(tmp_path / 'bag', [Record('r', 1e-3, np.sin(30 * time), 1e-4 * np.sin(30 * time))])
    return tmp_path / 'bag'


def start(name: str, options: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    """Start a node that tells at its end which threads are left."""
    package = 'piezo_sim' if name == 'simulator' else 'piezo_hysteresis'
    path = Path(get_package_prefix(package)) / 'lib' / package / name
    return subprocess.Popen(
        [sys.executable, '-c', RUNS, str(path), '--ros-args', *options],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        text=True,
    )


def left_by(process: subprocess.Popen[str]) -> set[str]:
    """Return the threads that a node left which has been asked to end."""
    text = process.communicate(timeout=20.0)[0]
    assert process.returncode == 0, text
    assert 'left:' in text, text
    assert 'Traceback' not in text, text
    return set(text.rpartition('left:')[2].split()) - OF_THE_PROCESS


def test_nothing_outlives_its_node(
    processes: NodeProcesses, listener: Listener, bag: Path, tmp_path: Path
) -> None:
    parameters: dict[str, dict[str, object]] = {
        'recorder': {'out': tmp_path / 'recorded'},
        'player': {'bag': bag, 'loop': True},
        'dashboard': {'port': 0},
    }
    health = listener.watch_health()
    running = {}
    for name in ('simulator', *SHEETS):
        given = [f'{key}:={value}' for key, value in parameters.get(name, {}).items()]
        options = [word for each in given for word in ('-p', each)]
        if name == 'control_loop':  # three nodes, with the names of those that run alone
            options += ['-r', '__ns:=/together']
        running[name] = start(name, options, processes.environment)
    try:
        served = {'simulator', *SHEETS, 'together/feedback'} - {'control_loop'}
        listener.until(lambda: served <= set(health), 60.0)
        for process in running.values():
            process.send_signal(signal.SIGINT)
        for name, process in running.items():
            assert not left_by(process), name
    finally:
        for process in running.values():
            process.kill()
            process.wait()


@pytest.mark.parametrize('lock_step', [True, False])
def test_a_player_that_waits_for_a_listener_ends_at_once(
    processes: NodeProcesses, listener: Listener, bag: Path, lock_step: bool
) -> None:
    waits = [f'bag:={bag}', f'lock_step:={str(lock_step).lower()}', 'wait:=3600.0']
    options = [part for each in waits for part in ('-p', each)]
    health = listener.watch_health()
    player = start('player', options, processes.environment)
    try:
        listener.says(health, 'player', None, 'waits for a listener')
        player.send_signal(signal.SIGINT)
        assert not left_by(player)
    finally:
        player.kill()
        player.wait()


def test_a_discovery_under_way_ends_with_its_node(
    processes: NodeProcesses, listener: Listener, tmp_path: Path
) -> None:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': 1.0, 'duration': 2.0} for f in (2, 7, 23)
    ]
    hidden = {'effects.sensor_nonlinearity': True}
    write_bag(tmp_path / 'bag', simulate('generic_bouc_wen', plan, hidden, 4))
    node = processes.start('piezo_hysteresis', 'discovery', {'folder': str(tmp_path)})
    client = ActionClient(listener.node, Discover, 'discover')
    listener.until(client.server_is_ready)
    feedback: list[float] = []
    goal = Discover.Goal(data=['bag'], baseline='classical', out='out', seed=3, workers=2)
    client.send_goal_async(goal, feedback_callback=lambda m: feedback.append(m.feedback.fraction))
    listener.until(lambda: feedback, 120.0)
    node.signal(signal.SIGINT)
    assert node.wait(20.0) == 0, node.tail(30)
    assert 'Traceback' not in node.log.read_text()
    assert not (tmp_path / 'out').exists()
