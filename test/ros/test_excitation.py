"""Sweeps and experiments of the excitation node on a live simulator in lock-step."""

from __future__ import annotations

import signal
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes
from rcl_interfaces.msg import Log
from rclpy.action import ActionClient
from std_msgs.msg import Header

from piezo_hysteresis.ros.processes import NodeProcess
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.runtime.sweep_plan import Sweep
from piezo_hysteresis.waveforms import from_spec
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, LoopStatus, RecordMarker

pytestmark = pytest.mark.ros

RATE = 1000.0
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Loop:
    """A simulator that can be killed, an excitation, and what a user does with them."""

    def __init__(self, processes: LiveNodes, listener: Listener) -> None:
        self.listener = listener
        self.states = listener.listen(ActuatorState, 'actuator/state')
        self.markers = listener.listen(RecordMarker, 'record/marker')
        self.health = listener.watch_health()
        self.log = listener.listen(Log, '/rosout')
        self.feedback: list[RunSweep.Feedback] = []
        self.simulator = self.start_simulator(processes)
        self.excitation = processes.start(
            'piezo_hysteresis', 'excitation', {'actuator': 'bender', 'deadline': 2.0}
        )
        self._client = ActionClient(listener.node, RunSweep, 'run_sweep')
        listener.matched('actuator/state')
        listener.matched('record/marker')
        listener.until(self._client.server_is_ready)
        listener.found_by('excitation')

    @staticmethod
    def start_simulator(processes: LiveNodes) -> NodeProcess:
        return processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'wait_for': 2})

    def genuine(self) -> list[ActuatorState]:
        """Return the states of the simulator."""
        return [state for state in self.states if not state.header.frame_id]

    def says(self, level: bytes | None, word: str) -> dict[str, str]:
        """Wait until the excitation says of itself `word`; return its counters."""
        return self.listener.says(self.health, 'excitation', level, word)

    def tells(self, key: str, value: int) -> None:
        """Wait until the excitation has counted so many."""
        self.listener.tells(self.health, 'excitation', key, str(value))

    def send(self, **goal: Any) -> Any:
        """Send a goal; return the handle."""
        self.feedback.clear()
        future = self._client.send_goal_async(
            RunSweep.Goal(**goal), feedback_callback=lambda m: self.feedback.append(m.feedback)
        )
        self.listener.until(future.done)
        return future.result()

    def result(self, handle: Any) -> Any:
        """Wait for the end of a goal."""
        future = handle.get_result_async()
        self.listener.until(future.done)
        return future.result()

    def still(self) -> None:
        """Wait until the loop stands still."""
        count = -1
        while len(self.states) > count:
            count = len(self.states)
            self.listener.serve(0.3)  # a busy machine pauses for longer than a tick takes

    def resting(self) -> None:
        """Wait until the loop stands still, at rest."""
        self.still()
        assert self.states[-1].voltage == 0.0


@pytest.fixture(scope='module')
def loop(shared_processes: LiveNodes, shared_listener: Listener) -> Loop:
    return Loop(shared_processes, shared_listener)


GOAL: dict[str, Any] = {
    'frequencies': [10.0, 20.0],
    'amplitudes': [0.5, 1.0],
    'seconds': 0.2,
    'warm_up': 0.05,
}
PLAN = Sweep([10.0, 20.0], [0.5, 1.0], 0.2, RATE, warm_up=0.05)


def test_a_sweep_is_what_was_ordered(loop: Loop) -> None:
    result = loop.result(loop.send(**GOAL))
    assert result.status == GoalStatus.STATUS_SUCCEEDED
    assert result.result.success
    assert result.result.records == 4
    loop.resting()

    expected = [PLAN.voltage(k) for k in range(PLAN.length)]
    assert [state.voltage for state in loop.states] == expected
    assert result.result.samples == PLAN.length
    named = [marker for marker in loop.markers if marker.record]
    assert [marker.record for marker in named] == [record.name for record in PLAN.records]
    assert {marker.actuator for marker in named} == {'bender'}
    assert [marker.frequency for marker in named] == [10.0, 20.0, 10.0, 20.0]
    assert {marker.warm_up for marker in named} == {0.05}
    ends = [marker.header.stamp for marker in loop.markers if not marker.record]
    stamps = [state.header.stamp for state in loop.states]
    assert [stamps.index(end) for end in ends] == [record.last for record in PLAN.records]
    places = [f'sample {k}' for record in PLAN.records for k in (record.first, record.last)]
    assert [marker.header.frame_id for marker in loop.markers] == places

    left = [each.seconds_left for each in loop.feedback]
    assert left
    assert left == sorted(left, reverse=True)
    assert all(0.0 <= each.fraction <= 1.0 for each in loop.feedback)
    assert {each.record for each in loop.feedback} <= {record.name for record in PLAN.records}
    assert all(each.frequency in (10.0, 20.0) for each in loop.feedback)


def test_one_thing_at_a_time(loop: Loop) -> None:
    long = {**GOAL, 'seconds': 60.0}
    handle = loop.send(**long)
    assert handle.accepted
    loop.says(OK, 'sweep: sine_10Hz_0.5V, ')
    assert not loop.send(**GOAL).accepted
    assert 'another one is running' in loop.says(WARN, 'a sweep was refused')['last_sweep']
    assert 'sweep' in loop.listener.set_one('excitation', 'mode', 'voltage')

    count = len(loop.states)
    loop.listener.until(lambda: len(loop.states) > count + 130)
    loop.listener.until(handle.cancel_goal_async().done)
    result = loop.result(handle)
    assert result.status == GoalStatus.STATUS_CANCELED
    assert not result.result.success
    assert 'at rest' in result.result.message
    assert result.result.records == 0
    loop.resting()
    # per tick: a listener that is starved does not hear every one
    voltages, ticks = np.diff([(s.voltage, s.sample) for s in loop.states[count:]], axis=0).T
    assert np.max(np.abs(voltages / ticks)) < 1.0 * 2 * np.pi * 20.0 / RATE
    loop.listener.until(lambda: loop.markers[-1].excitation == 'cancelled')
    last = loop.markers[-1]
    assert (last.record, last.header.frame_id) == ('', 'sine_10Hz_0.5V')


@pytest.mark.parametrize(
    'wrong',
    [
        {'waveform': 'sawtooth'},
        {'frequencies': [600.0]},
        {'frequencies': []},
        {'amplitudes': [float('nan')]},
        {'seconds': -1.0},
        {'options': '[1]'},
        {'options': 'a: ['},
    ],
)
def test_impossible_sweeps_are_refused(loop: Loop, wrong: dict[str, Any]) -> None:
    count = len(loop.log)
    assert not loop.send(**{**GOAL, **wrong}).accepted
    loop.listener.until(lambda: any('sweep refused: ' in line.msg for line in loop.log[count:]))


def test_an_amplitude_beyond_the_actuator_is_refused_before_the_first_sample(loop: Loop) -> None:
    loop.still()
    states, markers = len(loop.states), len(loop.markers)
    result = loop.result(loop.send(**{**GOAL, 'amplitudes': [1.0, 6.0]}))
    assert result.status == GoalStatus.STATUS_ABORTED
    assert '-6 .. 6 V, but the actuator takes -5 .. 5 V' in result.result.message
    assert result.result.samples == 0
    loop.says(WARN, 'a sweep was refused')
    for name, value in {'voltage.amplitude': 6.0, 'waveform': 'triangle'}.items():
        assert loop.listener.set_one('excitation', name, value) == ''
    assert 'takes -5 .. 5 V' in loop.listener.set_one('excitation', 'mode', 'voltage')
    assert loop.listener.set_one('excitation', 'voltage.amplitude', 1.0) == ''
    loop.still()
    assert (len(loop.states), len(loop.markers)) == (states, markers)


def test_a_range_that_shrinks_ends_the_sweep_with_the_reason(loop: Loop) -> None:
    count = len(loop.markers)
    handle = loop.send(**{**GOAL, 'amplitudes': [1.0], 'seconds': 60.0})
    loop.listener.until(lambda: len(loop.markers) > count)
    assert loop.listener.set_one('simulator', 'amplifier.range_high', 0.5) == ''
    result = loop.result(handle)
    status = loop.listener.listen(LoopStatus, 'loop/status', latched=True)
    assert loop.listener.set_one('simulator', 'amplifier.range_high', 5.0) == ''
    loop.listener.until(lambda: status and status[-1].high == 5.0)
    loop.listener.serve(0.2)  # the excitation has heard it too
    assert result.status == GoalStatus.STATUS_ABORTED
    assert 'beyond its range' in result.result.message
    loop.resting()
    loop.listener.until(lambda: loop.markers[-1].excitation == 'refused')
    assert loop.markers[-1].header.frame_id == 'sine_10Hz_1V'


def test_an_experiment_plays_any_waveform_and_changes_without_a_jump(loop: Loop) -> None:
    def accept(name: str, value: Any) -> None:
        assert loop.listener.set_one('excitation', name, value) == ''

    for name, value in {
        'waveform': 'multisine',
        'waveform_options': '{seed: 3, highest: 40.0}',
        'frequency': 5.0,
        'voltage.amplitude': 0.5,
        'ramp': 0.1,
    }.items():
        accept(name, value)
    start = len(loop.states)
    first = loop.states[-1].sample + 1 if loop.states else 0
    accept('mode', 'voltage')
    assert not loop.send(**GOAL).accepted
    loop.listener.until(lambda: len(loop.states) > start + 300)
    accept('voltage.amplitude', 0.8)
    accept('frequency', 7)
    loop.listener.until(lambda: len(loop.states) > start + 900)
    assert 'sampled' in loop.listener.set_one('excitation', 'frequency', 500.0)
    assert 'colour' in loop.listener.set_one('excitation', 'waveform_options', '{colour: red}')
    accept('mode', 'idle')
    loop.listener.serve(0.1)

    # A listener that is starved does not hear every tick of a loop that runs as fast as it can.
    voltage = np.array([state.voltage for state in loop.states[start:]])
    tick = np.array([state.sample for state in loop.states[start:]]) - first
    spec = {'kind': 'multisine', 'seed': 3, 'highest': 40.0, 'frequency': 5.0, 'amplitude': 0.5}
    before = tick[tick < 250]
    assert before.size >= 50
    expected = from_spec({**spec, 'ramp': 0.1}).sample(before * (1.0 / RATE)).value
    np.testing.assert_allclose(voltage[: before.size], expected, rtol=0, atol=1e-12)
    steepest = 0.8 * 2 * np.pi * 42.0 / RATE
    next_to_each_other = np.diff(tick) == 1
    assert next_to_each_other.sum() >= 500
    assert np.abs(np.diff(voltage))[next_to_each_other].max() < 1.5 * steepest


def test_states_of_others_do_not_move_an_experiment(loop: Loop) -> None:
    """One rogue state after the other, none of which may be taken for the actuator's."""
    rogue = loop.listener.node.create_publisher(ActuatorState, 'actuator/state', LOOP)
    loop.listener.until(lambda: rogue.get_subscription_count() >= 2)
    before = loop.says(None, '')
    spec = {'kind': 'triangle', 'frequency': 5.0, 'amplitude': 0.5, 'ramp': 0.1}
    drive = {'waveform_options': '', 'waveform': 'triangle', 'frequency': 5.0, 'ramp': 0.1}
    drive['voltage.amplitude'] = 0.5
    results = loop.listener.set_parameters('excitation', drive)
    assert all(result.successful for result in results), results
    loop.still()
    first = loop.genuine()[-1].sample + 1
    assert loop.listener.set_one('excitation', 'mode', 'voltage') == ''
    strays = 0
    for k in range(1, 8):
        count = len(loop.states)
        loop.listener.until(lambda count=count: len(loop.states) > count + 100)
        newest = loop.genuine()[-1].sample
        for sample in (newest + k * 10**6, newest - 200 * k, *([0] if k == 4 else [])):
            rogue.publish(ActuatorState(header=Header(frame_id='rogue'), sample=sample))
            strays += 1
    count = len(loop.states)
    loop.listener.until(lambda: len(loop.states) > count + 200)
    assert loop.listener.set_one('excitation', 'mode', 'idle') == ''
    loop.still()
    played = [state for state in loop.genuine() if state.sample >= first]
    assert len(played) > 700
    # By their numbers: on a busy machine this listener, not the loop, may lose some.
    time = np.array([state.sample - first for state in played]) * (1.0 / RATE)
    voltage = np.array([state.voltage for state in played])
    np.testing.assert_allclose(voltage, from_spec(spec).sample(time).value, rtol=0, atol=1e-12)

    loop.tells('strays', int(before['strays']) + strays)
    loop.tells('restarts', int(before['restarts']))


def test_a_dead_simulator_ends_the_sweep_with_the_reason(
    loop: Loop, shared_processes: LiveNodes
) -> None:
    handle = loop.send(**{**GOAL, 'seconds': 60.0})
    count = len(loop.states)
    loop.listener.until(lambda: len(loop.states) > count + 50)
    loop.simulator.signal(signal.SIGKILL)
    shared_processes.retire(loop.simulator)
    result = loop.result(handle)
    assert result.status == GoalStatus.STATUS_ABORTED
    assert 'no actuator/state' in result.result.message
    loop.says(ERROR, 'no actuator/state')
    restarts = int(loop.says(ERROR, 'is not running')['restarts'])
    assert 'Traceback' not in loop.excitation.tail(100)

    # A new simulator counts from 0 again; the excitation follows without being restarted.
    loop.start_simulator(shared_processes)
    status = loop.listener.listen(LoopStatus, 'loop/status', latched=True)
    loop.listener.until(lambda: status and status[-1].sample == 0)
    count = len(loop.states)
    result = loop.result(loop.send(**GOAL))
    assert result.result.success, result.result.message
    last = f'sample {PLAN.records[-1].last}'
    loop.listener.until(lambda: loop.markers[-1].header.frame_id == last)
    # a starved listener may hear states of the dead one after that
    assert any(state.sample == 0 for state in loop.states[count:])
    loop.tells('restarts', restarts + 1)


def test_a_sweep_waits_for_subscribers_of_its_markers(loop: Loop) -> None:
    listener = loop.listener
    count = len(loop.markers)
    listener.until(lambda: listener.node.count_subscribers('record/marker') == 1)
    assert listener.set_one('excitation', 'marker_listeners', 2) == ''
    assert listener.set_one('excitation', 'deadline', 0.5) == ''
    given_up = loop.result(loop.send(**GOAL)).result
    assert not given_up.success
    assert 'record/marker' in given_up.message
    assert not any(marker.record for marker in loop.markers[count:])
    assert listener.set_one('excitation', 'deadline', 30.0) == ''
    handle = loop.send(**GOAL)
    loop.says(WARN, 'waits for 2 subscribers of record/marker, 1 are there')
    late: list[RecordMarker] = []
    subscription = listener.node.create_subscription(
        RecordMarker, 'record/marker', late.append, LOOP
    )
    try:
        assert loop.result(handle).result.success
        listener.until(lambda: sum(bool(marker.record) for marker in late) == 4)
    finally:
        listener.node.destroy_subscription(subscription)
    assert listener.set_one('excitation', 'marker_listeners', 0) == ''
    assert listener.set_one('excitation', 'deadline', 2.0) == ''
