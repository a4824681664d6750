"""No record of a live sweep is lost: whoever records is waited for, without being told of."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient

from piezo_hysteresis.records import Record, read_bag, survey
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_hysteresis.runtime.sweep_plan import Sweep
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, RecordMarker

pytestmark = pytest.mark.ros

RATE = 1000.0
PRESET = 'generic_bouc_wen'
NAMES = ['sine_5Hz_1V', 'sine_20Hz_1V']
GOAL: dict[str, Any] = {'frequencies': [5.0, 20.0], 'amplitudes': [1.0], 'seconds': 0.4}
PLAN = Sweep(GOAL['frequencies'], GOAL['amplitudes'], GOAL['seconds'], RATE)


class Bench:
    """A simulator, an excitation and whatever recorders a test starts."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.processes, self.listener, self.folder = processes, listener, folder
        self.states = listener.listen(ActuatorState, 'actuator/state')
        self.markers = listener.listen(RecordMarker, 'record/marker')
        self._client = ActionClient(listener.node, RunSweep, 'run_sweep')
        self._bags: dict[int, Path] = {}

    def start(self, clock: str = 'lock_step', **excitation: Any) -> None:
        """Start the loop."""
        settings = {'clock': clock, 'preset': PRESET}
        self.simulator = self.processes.start('piezo_sim', 'simulator', settings)
        self.processes.start('piezo_hysteresis', 'excitation', excitation)
        self.listener.until(self._client.server_is_ready)
        self.listener.found_by('excitation')

    def record(self, name: str) -> NodeProcess:
        """Start a recorder and return as soon as the graph knows its name, not what it does."""
        settings = {'out': str(self.folder / name)}
        node = self.processes.start('piezo_hysteresis', 'recorder', settings, name=name)
        self._bags[id(node)] = self.folder / name
        self.listener.until(lambda: name in self.listener.node.get_node_names())
        return node

    def send(self, **goal: Any) -> Any:
        future = self._client.send_goal_async(RunSweep.Goal(**{**GOAL, **goal}))
        self.listener.until(future.done)
        return future.result()

    def result(self, handle: Any) -> Any:
        future = handle.get_result_async()
        self.listener.until(future.done)
        return future.result()

    def close(self, node: NodeProcess) -> Path:
        """End a recorder; return its bag."""
        assert node.stop(30.0) == 0
        self.processes.forget(node)
        return self._bags[id(node)]

    def running(self, count: int = 100) -> None:
        """Wait until a sweep is under way."""
        before = len(self.states)
        self.listener.until(lambda: len(self.states) > before + count)


@pytest.fixture
def bench(processes: LiveNodes, listener: Listener, tmp_path: Path) -> Bench:
    return Bench(processes, listener, tmp_path)


def whole(bag: Path) -> list[Record]:
    """Return the records of a bag, which are those of the sweep and of its lengths."""
    records = read_bag(bag)
    assert [record.name for record in records] == NAMES
    assert [len(record) for record in records] == [each.voltages.size for each in PLAN.records]
    return records


def holds(bag: Path) -> None:
    """Assert that a bag holds the whole sweep as planned, sample by sample."""
    for record, wanted in zip(whole(bag), PLAN.records, strict=True):
        np.testing.assert_array_equal(record.voltage, wanted.voltages)


@pytest.mark.parametrize('clock', ['lock_step', 'real_time'])
def test_a_sweep_at_once_after_a_recorder_came_up_is_all_in_its_bag(
    bench: Bench, clock: str
) -> None:
    bench.start(clock)
    early = bench.record('early')
    late = bench.record('late')
    result = bench.result(bench.send()).result
    assert result.success, result.message
    assert result.message == '2 records, recorded by /early, /late'
    assert list(result.names) == NAMES
    assert list(result.recorded_by) == ['/early, /late'] * 2
    bags = [bench.close(node) for node in (early, late)]
    if clock == 'lock_step':
        for bag in bags:
            holds(bag)
    for one, other in zip(*map(whole, bags), strict=True):
        # In real time a busy machine makes commands late, which are then held back by the slew.
        assert np.abs(one.voltage).max() <= 1.0
        np.testing.assert_array_equal(one.voltage, other.voltage)
        np.testing.assert_array_equal(one.displacement, other.displacement)


# In lock-step a sweep must be long for the simulator to be stopped in time.
@pytest.mark.parametrize(('clock', 'seconds'), [('lock_step', 8.0), ('real_time', 1.5)])
def test_a_recorder_that_comes_during_a_sweep_gets_the_record_that_runs(
    bench: Bench, clock: str, seconds: float
) -> None:
    bench.start(clock, deadline=60.0)
    handle = bench.send(seconds=seconds)
    bench.running()
    bench.simulator.signal(signal.SIGSTOP)  # time stands still until the recorder is there
    node = bench.record('recorder')
    bench.simulator.signal(signal.SIGCONT)
    result = bench.result(handle).result
    assert result.success, result.message
    assert '/recorder' in result.recorded_by[-1]
    names = [name for name, by in zip(result.names, result.recorded_by, strict=True) if by]
    assert [record.name for record in read_bag(bench.close(node))] == names


def test_a_cancelled_record_is_in_the_bag_as_such(bench: Bench) -> None:
    bench.start()
    node = bench.record('recorder')
    handle = bench.send(seconds=60.0)
    bench.running()
    bench.listener.until(handle.cancel_goal_async().done)
    assert bench.result(handle).status == GoalStatus.STATUS_CANCELED
    result = bench.result(bench.send()).result
    assert result.success, result.message
    bag = bench.close(node)
    assert [str(n).split(': ')[1] for n in survey([bag]).left_out] == [
        'record sine_5Hz_1V was cancelled and is left out'
    ]
    holds(bag)


def test_a_recorder_that_does_not_confirm_is_named_within_the_deadline(bench: Bench) -> None:
    bench.start(deadline=2.0)
    node = bench.record('stuck')
    result = bench.result(bench.send()).result
    assert result.recorded_by[0] == '/stuck'
    bench.listener.until(lambda: len(bench.markers) == 4)  # two records; may come after the result
    node.signal(signal.SIGSTOP)
    count = len(bench.markers)
    result = bench.result(bench.send()).result
    assert not result.success
    assert '/stuck to confirm the marker of record sine_5Hz_1V' in result.message
    bench.listener.until(lambda: len(bench.markers) >= count + 2)
    assert [m.excitation for m in bench.markers[count:]] == ['sine', 'failed']
    node.signal(signal.SIGCONT)
    result = bench.result(bench.send()).result
    assert result.message == '2 records, recorded by /stuck'
    bag = bench.close(node)
    assert len(read_bag(bag)) == 4


def test_nobody_who_records_is_no_reason_to_wait(bench: Bench) -> None:
    bench.start()
    result = bench.result(bench.send()).result
    assert result.success, result.message
    assert result.message == '2 records, confirmed by no recorder'
    assert list(result.recorded_by) == ['', '']


def play(bench: Bench, bag: Path, **settings: Any) -> Callable[[], int | None]:
    node = bench.processes.start('piezo_hysteresis', 'player', {'bag': str(bag), **settings})
    return lambda: bench.processes.wait_for(node, 60.0)


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of a sweep whose nodes have ended."""
    with LiveNodes() as processes:
        listener = Listener(processes)
        bench = Bench(processes, listener, tmp_path_factory.mktemp('recorded'))
        bench.start()
        node = bench.record('first')
        assert bench.result(bench.send()).result.success
        bag = bench.close(node)
        listener.close()
    return bag


@pytest.mark.parametrize('settings', [{'rate_factor': 20.0}, {'lock_step': True}])
def test_a_bag_that_is_played_to_a_recorder_is_all_there(
    bench: Bench, recorded: Path, settings: dict[str, Any]
) -> None:
    copy = bench.record('copy')
    assert play(bench, recorded, **settings)() == 0
    holds(bench.close(copy))
