"""Every executable starts with nothing but what it needs, answers, and ends with nothing left."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from listening import Listener
from live_nodes import LiveNodes
from rcl_interfaces.srv import ListParameters
from rosbags.highlevel import AnyReader

from piezo_hysteresis.common.registry import NODES, package_of
from piezo_hysteresis.records import Record, read_bag, write_bag
from piezo_interfaces.msg import ActuatorState, LoopStatus

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
    return short_bag(tmp_path, 500)


def short_bag(folder: Path, samples: int) -> Path:
    time = np.arange(samples) * 1e-3
    record = Record('r', 1e-3, np.sin(30 * time), 1e-4 * np.sin(30 * time))
    write_bag(folder / 'bag', [record])
    return folder / 'bag'


def start(name: str, options: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    """Start a node that tells at its end which threads are left."""
    package = package_of(name)
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
    assert 'FATAL' not in text, text
    return set(text.rpartition('left:')[2].split()) - OF_THE_PROCESS


# Publishes one sample, and 200 more once the file `go` exists; then it ends.
SOURCE = """
import pathlib, sys
from rclpy.node import Node
from rclpy.task import Future
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import run_node
from piezo_hysteresis.ros.running import wall_timer
from piezo_interfaces.msg import ActuatorState

folder = pathlib.Path(sys.argv.pop())

class Source(Node):
    def __init__(self):
        super().__init__('source')
        self.stop = Future()
        self.publisher = self.create_publisher(ActuatorState, 'actuator/state', LOOP)
        wall_timer(self, 0.05, self.look)

    def look(self):
        if self.stop.done():
            return
        if (folder / 'go').exists():
            for k in range(1, 201):
                self.publisher.publish(ActuatorState(sample=k))
            self.stop.set_result(True)
        elif not (folder / 'matched').exists() and self.publisher.get_subscription_count():
            self.publisher.publish(ActuatorState(sample=0))
            if self.publisher.wait_for_all_acked():
                (folder / 'matched').touch()

sys.exit(run_node(Source))
"""


# What a node cannot do without; the page takes any port that is free.
NEEDED: dict[str, Callable[[Path], str]] = {
    'recorder': lambda folder: f'out:={folder / "recorded"}',
    'player': lambda folder: f'bag:={short_bag(folder, 300_000)}',
    'dashboard': lambda folder: 'port:=0',
    'gcs_driver': lambda folder: 'controller:=gcs://127.0.0.1:1',
}
# The links one behind the other, three more with the same names elsewhere, and a driver there,
# which has the action of the excitation.
NAMES = {
    'attenuation': ['voltage/command:=voltage/attenuated'],
    'feedback': ['voltage/feedforward:=voltage/attenuated'],
    'control_loop': ['__ns:=/together'],
    'gcs_driver': ['__ns:=/driven'],
}
LINKS = ('excitation', 'feedforward', 'attenuation', 'feedback')


class Everything:
    """Every executable, started with nothing but what it needs."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.listener, self.folder = listener, folder
        self.health = listener.watch_health()
        self.states = listener.listen(ActuatorState, 'actuator/state')
        self.running = {}
        for name in NODES:
            words = ['-p', NEEDED[name](folder)] if name in NEEDED else []
            words += [word for each in NAMES.get(name, ()) for word in ('-r', each)]
            self.running[name] = start(name, words, processes.environment)
        # at full speed they would take the time that those which still load need
        assert listener.set_one('simulator', 'speed_factor', 0.2) == ''

    def close(self) -> None:
        for process in self.running.values():
            process.kill()
            process.wait()


@pytest.fixture(scope='module')
def everything(
    shared_processes: LiveNodes,
    shared_listener: Listener,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Everything]:
    nodes = Everything(shared_processes, shared_listener, tmp_path_factory.mktemp('nodes'))
    yield nodes
    nodes.close()


@pytest.mark.parametrize('name', sorted(NODES))
def test_a_node_starts_and_answers(everything: Everything, name: str) -> None:
    elsewhere = {
        'control_loop': [f'together/{link}' for link in LINKS],
        'gcs_driver': ['driven/gcs_driver'],
    }
    inside = elsewhere.get(name, [name])
    for each in inside:
        answer = everything.listener.call(
            ListParameters, f'{each}/list_parameters', ListParameters.Request()
        )
        assert answer.result.names
        everything.listener.until(lambda each=each: each in everything.health)


def test_every_node_ends_on_either_signal_while_the_loop_runs_and_leaves_nothing(
    everything: Everything,
) -> None:
    listener, states = everything.listener, everything.states
    assert listener.set_one('excitation', 'frequency', 10.0) == ''
    assert listener.set_one('excitation', 'mode', 'reference') == ''
    listener.until(lambda: states and abs(states[-1].voltage) > 0.0)
    first = states[-1].sample
    listener.until(lambda: states[-1].sample > first + 50)
    written = listener.listen(LoopStatus, 'recorder/status', latched=True)
    listener.until(lambda: written)
    # a recorder that loads for long misses the samples before
    recording = len(states)
    listener.until(lambda: len(states) > recording + 200)
    for k, process in enumerate(everything.running.values()):
        process.send_signal(signal.SIGINT if k % 2 else signal.SIGTERM)
    for name, process in everything.running.items():
        assert not left_by(process), name
    records = read_bag(everything.folder / 'recorded')
    assert sum(len(record) for record in records) >= 0.5 * (len(states) - recording)


@pytest.mark.parametrize('lock_step', [True, False])
def test_a_player_that_waits_for_a_listener_ends_at_once(
    processes: LiveNodes, listener: Listener, bag: Path, lock_step: bool
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


def test_what_a_node_published_last_reaches_a_recorder_that_was_not_scheduled(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    options = {'out': str(tmp_path / 'bag'), 'topics': ['actuator/state']}
    recorder = processes.start('piezo_hysteresis', 'recorder', options)
    command = [sys.executable, '-c', SOURCE, str(tmp_path)]
    source = subprocess.Popen(command, env=processes.environment)
    try:
        listener.until(lambda: (tmp_path / 'matched').exists())
        recorder.signal(signal.SIGSTOP)
        (tmp_path / 'go').touch()
        with pytest.raises(subprocess.TimeoutExpired):
            source.wait(1.0)
        recorder.signal(signal.SIGCONT)
        assert source.wait(20.0) == 0
    finally:
        source.kill()
        source.wait()
    assert recorder.stop() == 0
    with AnyReader([tmp_path / 'bag']) as reader:
        states: list[Any] = [
            reader.deserialize(payload, connection.msgtype)
            for connection, _, payload in reader.messages()
        ]
    assert [state.sample for state in states] == list(range(201))
