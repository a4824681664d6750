"""`run_sweep` under SIGKILL: what was written can be read, the actuator rests, a restart works."""

from __future__ import annotations

import random
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient
from rosbags.highlevel import AnyReader

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import survey
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_hysteresis.runtime.sweep_plan import Sweep
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, RecordMarker

pytestmark = pytest.mark.ros

RATE, TIMEOUT, RAMP = 500.0, 0.2, 5.0
SEED = 55
GOAL: dict[str, Any] = {'frequencies': [5.0, 20.0], 'amplitudes': [1.0], 'seconds': 0.4}
PLAN = Sweep(GOAL['frequencies'], GOAL['amplitudes'], GOAL['seconds'], RATE)
LENGTH = sum(each.voltages.size for each in PLAN.records) / RATE


class Kills:
    """A simulator that lives on, an excitation and a recorder that do not."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.processes, self.listener, self.folder = processes, listener, folder
        self.states = listener.listen(ActuatorState, 'actuator/state')
        simulated = {'rate': RATE, 'ramp': RAMP, 'command_timeout': TIMEOUT}
        processes.start('piezo_sim', 'simulator', simulated)
        self.markers = listener.listen(RecordMarker, 'record/marker')
        self.nodes: dict[str, NodeProcess] = {}

    def start(self, name: str, k: int) -> None:
        """Start a node unless it lives."""
        if name in self.nodes:
            return
        settings: dict[str, dict[str, object]] = {
            'excitation': {'rate': RATE, 'folder': str(self.folder)},
            'recorder': {'out': str(self.folder / f'recorder_{k}')},
        }
        self.nodes[name] = self.processes.start('piezo_hysteresis', name, settings[name])

    def kill(self, name: str) -> None:
        node = self.nodes.pop(name)
        node.signal(signal.SIGKILL)
        self.processes.retire(node)

    def goal(self, bag: str) -> Any:
        """Send a goal to the excitation that runs now; return the future of its result."""
        client = ActionClient(self.listener.node, RunSweep, 'run_sweep')
        self.listener.until(client.server_is_ready)
        self.listener.found_by('excitation')
        sent = client.send_goal_async(RunSweep.Goal(**GOAL, bag=bag))
        self.listener.until(sent.done)
        assert sent.result().accepted
        future = sent.result().get_result_async()
        future.client = client  # lives as long
        return future

    def rests(self) -> None:
        """Wait until the actuator is at its safe voltage."""
        count = len(self.states)
        self.listener.until(
            lambda: len(self.states) > count and self.states[-1].voltage == 0.0, 30.0
        )


def samples_of(bag: Path, *, is_whole: bool = False) -> int:
    """Return the samples of the records of a bag; a whole one is read by rosbags, too."""
    if not (bag / 'metadata.yaml').exists():
        return 0
    try:
        records = survey([bag], salvage=True).records
    except RecordError as error:
        print(f'    {error}')
        records = []
    count = 0
    for record in records:
        count += len(record)
        assert np.max(np.abs(record.voltage)) <= 1.0 + 1e-9
    if is_whole:
        with AnyReader([bag]) as reader:
            kinds = [connection.msgtype for connection, _, _ in reader.messages()]
        assert kinds.count('piezo_interfaces/msg/ActuatorState') >= count > 0
    return count


def moments(count: int) -> list[tuple[str, float]]:
    """Return what is killed, and after which part of the sweep, by a seed."""
    chance = random.Random(SEED)
    parts = [0.0, 1.0, *(chance.random() for _ in range(count - 2))]
    return [('recorder' if k % 4 == 1 else 'excitation', part) for k, part in enumerate(parts)]


@pytest.mark.parametrize('count', [2, pytest.param(20, marks=pytest.mark.slow)])
def test_what_is_kept_can_be_read_after_a_kill_at_any_moment(
    processes: LiveNodes, listener: Listener, tmp_path: Path, count: int
) -> None:
    bench = Kills(processes, listener, tmp_path)
    bags: list[Path] = []
    for k, (name, part) in enumerate(moments(count)):
        bags += [tmp_path / f'recorder_{k}'] if 'recorder' not in bench.nodes else []
        bench.start('recorder', k)
        bench.start('excitation', k)
        bench.markers.clear()
        result = bench.goal(f'swept_{k}')
        listener.until(lambda: bench.markers)
        due = len(bench.states) + part * LENGTH * RATE
        listener.until(lambda due=due: len(bench.states) >= due)
        bench.kill(name)
        if name == 'excitation':
            kept = samples_of(tmp_path / f'swept_{k}')
            print(f'{k:2}  {name:10}  at {part:.3f}  in its bag {kept}')
        else:
            listener.until(result.done)
            swept = result.result().result
            assert swept.success
            kept = samples_of(Path(swept.bag), is_whole=True)
            other = samples_of(bags[-1])
            print(
                f'{k:2}  {name:10}  at {part:.3f}  in its bag {other}, in that of the sweep {kept}'
            )
            assert swept.records == 2
            assert kept == LENGTH * RATE
            assert other > 0
        bench.rests()
    bench.start('excitation', count)
    again = bench.goal('again')
    listener.until(again.done)
    assert again.result().result.success
    assert again.result().result.records == 2
    assert samples_of(tmp_path / 'again', is_whole=True) == LENGTH * RATE
    voltage = np.array([state.voltage for state in bench.states])
    assert np.max(np.abs(voltage)) <= 1.0 + 1e-9
