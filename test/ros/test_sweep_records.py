"""A live sweep records itself; other recorders may take it as well and hold nothing up."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.nodes.excitation.sweep_server import DISCOVERY
from piezo_hysteresis.records import Record, read_bag, survey
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.runtime.sweep_plan import Sweep
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, LoopStatus, RecordMarker, VoltageCommand

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
        excitation = {'folder': str(self.folder), **excitation}
        self.excitation = self.processes.start('piezo_hysteresis', 'excitation', excitation)
        self.listener.until(self._client.server_is_ready)
        self.listener.found_by('excitation')

    def record(self, name: str) -> NodeProcess:
        """Start a recorder and return as soon as the graph knows its subscription of markers."""
        settings = {'out': str(self.folder / name)}
        node = self.processes.start('piezo_hysteresis', 'recorder', settings, name=name)
        self._bags[id(node)] = self.folder / name
        infos = self.listener.node.get_subscriptions_info_by_topic
        self.listener.until(lambda: name in [i.node_name for i in infos('/record/marker')])
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
        self.processes.retire(node)
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


def test_a_sweep_without_a_bag_leaves_recorders_the_time_to_be_discovered(bench: Bench) -> None:
    bench.start()
    before, sent = len(bench.states), time.monotonic()
    handle = bench.send()
    bench.listener.until(lambda: time.monotonic() > sent + 0.8 * DISCOVERY)
    late = time.monotonic() > sent + DISCOVERY  # a busy machine shows nothing
    assert late or len(bench.states) - before <= 1
    assert bench.result(handle).result.success


@pytest.mark.parametrize('clock', ['lock_step', 'real_time'])
def test_a_sweep_is_all_in_the_bag_that_it_names(bench: Bench, clock: str) -> None:
    bench.start(clock)
    result = bench.result(bench.send(bag='sweeps/one')).result
    bag = bench.folder / 'sweeps' / 'one'
    assert result.success, result.message
    assert result.message == f'2 records in {bag}'
    assert (list(result.names), result.bag) == (NAMES, str(bag))
    if clock == 'lock_step':
        holds(bag)
    # In real time a busy machine makes commands late, which are then held back by the slew.
    received = {state.sample: state for state in bench.states}
    for record in whole(bag):
        assert np.abs(record.voltage).max() <= 1.0
        first = round(record.start * RATE)
        for k in range(0, len(record), 50):
            if first + k in received:
                assert record.voltage[k] == received[first + k].voltage
    again = bench.send(bag=str(bag))
    assert not again.accepted  # nothing is overwritten
    assert not bench.send(bag='../elsewhere').accepted
    assert bench.result(bench.send(bag=str(bag) + '2')).result.success


def test_what_is_behind_a_status_is_not_answered(processes: LiveNodes, listener: Listener) -> None:
    """An excitation that is behind catches up: it takes the states that wait and answers the last.

    The answers to the others would be too late; an actuator in real time would not move.
    """
    publish = listener.node.create_publisher
    states = publish(ActuatorState, 'actuator/state', LOOP)
    status = publish(LoopStatus, 'loop/status', LATCHED)
    commands = listener.listen(VoltageCommand, 'voltage/command')
    settings = {'mode': 'voltage', 'voltage.amplitude': 0.5, 'duration': 10.0, 'deadline': 60.0}
    processes.start('piezo_hysteresis', 'excitation', settings)
    for publisher in (states, status):
        listener.until(lambda each=publisher: each.get_subscription_count() > 0)
    for k in range(10):
        states.publish(ActuatorState(sample=k))
        listener.until(lambda k=k: commands and commands[-1].sample == k + 1)
    status.publish(LoopStatus(sample=30, low=-5.0, high=5.0))
    listener.serve(0.1)
    for k in range(10, 30):
        states.publish(ActuatorState(sample=k))
    listener.until(lambda: commands[-1].sample == 30)
    states.publish(ActuatorState(sample=30))
    listener.until(lambda: commands[-1].sample == 31)
    assert sorted({each.sample for each in commands}) == [*range(1, 11), 30, 31]


def test_a_bag_needs_no_other_recorder_and_a_recorder_no_bag(bench: Bench) -> None:
    bench.start()
    node = bench.record('recorder')
    result = bench.result(bench.send(bag='own')).result
    assert result.success, result.message
    other = bench.close(node)
    for one, two in zip(whole(bench.folder / 'own'), whole(other), strict=True):
        np.testing.assert_array_equal(one.voltage, two.voltage)
        np.testing.assert_array_equal(one.displacement, two.displacement)
    result = bench.result(bench.send()).result
    assert (result.message, result.bag) == ('2 records', '')


def test_a_cancelled_record_is_in_the_bag_as_such(bench: Bench) -> None:
    bench.start()
    handle = bench.send(seconds=60.0, bag='cancelled')
    bench.running()
    bench.listener.until(handle.cancel_goal_async().done)
    assert bench.result(handle).status == GoalStatus.STATUS_CANCELED
    result = bench.result(bench.send(bag='next')).result
    assert result.success, result.message
    with pytest.raises(RecordError, match='sine_5Hz_1V was cancelled and is left out'):
        survey([bench.folder / 'cancelled'])
    holds(bench.folder / 'next')


def test_a_recorder_that_stands_still_holds_nothing_up(bench: Bench) -> None:
    bench.start(deadline=2.0)
    node = bench.record('stuck')
    assert bench.result(bench.send(bag='first')).result.success
    node.signal(signal.SIGSTOP)
    result = bench.result(bench.send(bag='second')).result
    assert result.success, result.message
    node.signal(signal.SIGCONT)
    holds(bench.folder / 'second')
    bench.close(node)


def holds_samples(bag: Path) -> bool:
    """Tell whether a part of the record is on the disk; each is flushed within 0.25 s."""
    try:
        return any(each.name == 'sine_5Hz_1V' for each in survey([bag]).records)
    except (OSError, RecordError):
        return False


def test_a_killed_excitation_leaves_a_bag_that_can_be_read(bench: Bench) -> None:
    bench.start()
    bench.send(seconds=60.0, bag='killed')  # in lock-step eight seconds can be over in one
    bench.listener.until(lambda: holds_samples(bench.folder / 'killed'))
    bench.excitation.signal(signal.SIGKILL)
    bench.processes.retire(bench.excitation)
    found = survey([bench.folder / 'killed'])
    assert any('was not closed' in str(note) for note in found.notes)
    (record,) = [each for each in found.records if each.name == 'sine_5Hz_1V']
    plan = Sweep(GOAL['frequencies'], GOAL['amplitudes'], 60.0, RATE).records[0]
    np.testing.assert_array_equal(record.voltage, plan.voltages[: len(record)])


def test_what_a_sweep_reports_on_a_disk_that_fills_is_in_its_bag(bench: Bench) -> None:
    """A limit of the size of files, which the recording reaches in the second record."""
    bench.start('real_time')
    pid = bench.excitation.pid
    handle = bench.send(bag='full', seconds=1.5)
    bench.listener.until(lambda: [each.record for each in bench.markers][-1:] == NAMES[1:])
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (150_000, -1))
    result = bench.result(handle).result
    found = {each.name: each for each in survey([bench.folder / 'full'], salvage=True).records}
    assert result.records == len(result.names) < 2
    assert not result.success
    assert f'{NAMES[1]} could not be written' in result.message
    for name in result.names:
        assert len(found[name]) == 1.5 * RATE
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (-1, -1))
    assert bench.result(bench.send(bag='again')).result.records == 2
    whole(bench.folder / 'again')


def test_a_name_that_is_too_long_is_refused_and_the_node_lives(bench: Bench) -> None:
    bench.start()
    assert not bench.send(bag='x' * 300).accepted
    assert bench.result(bench.send(bag='again')).result.records == 2


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
        assert bench.result(bench.send(bag='first')).result.success
        listener.close()
    return bench.folder / 'first'


@pytest.mark.parametrize('settings', [{'rate_factor': 20.0}, {'lock_step': True}])
def test_a_bag_that_is_played_to_a_recorder_is_all_there(
    bench: Bench, recorded: Path, settings: dict[str, Any]
) -> None:
    copy = bench.record('copy')
    assert play(bench, recorded, **settings)() == 0
    holds(bench.close(copy))
