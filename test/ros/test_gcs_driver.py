"""The node of a controller: sweeps run there, and whatever ends them leaves 0 V."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient

from piezo_hysteresis.records import read_bag
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState
from piezo_sim.gcs.controller import OUTPUT, SimulatedController
from piezo_sim.gcs.server import GcsServer
from piezo_sim.plant import Plant

pytestmark = pytest.mark.ros

RATE = 20_000.0
GOAL: dict[str, Any] = {'frequencies': [10.0, 20.0], 'amplitudes': [1.0], 'seconds': 0.4}


class Stage:
    """A simulated controller, the node that drives it, and who asks it for sweeps."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.folder, self.listener, self.processes = folder, listener, processes
        self.controller = SimulatedController(Plant.from_preset('fdk_pzba_00030', RATE))
        self.server = GcsServer(self.controller)
        self._serving = threading.Thread(target=self.server.serve_forever, args=(0.01,))
        self._serving.start()
        self.states = listener.listen(ActuatorState, 'actuator/state')
        self.health = listener.watch_health()
        self.feedback: list[RunSweep.Feedback] = []
        self._client = ActionClient(listener.node, RunSweep, 'run_sweep')

    def start(self, **more: Any) -> Any:
        settings = {
            'controller': f'gcs://127.0.0.1:{self.server.server_address[1]}',
            'folder': str(self.folder / 'bags'),
            'actuator': 'bender',
            'timeout': 1.0,
            'limits.slew': 2000.0,
            **more,
        }
        node = self.processes.start('piezo_hysteresis', 'gcs_driver', settings)
        self.listener.until(self._client.server_is_ready)
        self.listener.found_by('gcs_driver')
        self.says(DiagnosticStatus.OK, 'is connected')
        return node

    def says(self, level: bytes, word: str) -> dict[str, str]:
        return self.listener.says(self.health, 'gcs_driver', level, word)

    def send(self, **goal: Any) -> Any:
        future = self._client.send_goal_async(
            RunSweep.Goal(**{**GOAL, **goal}),
            feedback_callback=lambda message: self.feedback.append(message.feedback),
        )
        self.listener.until(future.done)
        return future.result()

    def accepted(self, **goal: Any) -> Any:
        handle = self.send(**goal)
        assert handle.accepted, self.health['gcs_driver']
        return handle

    def result(self, handle: Any) -> Any:
        future = handle.get_result_async()
        self.listener.until(future.done)
        return future.result()

    def moving(self, handle: Any) -> None:
        """Wait until the wave of an accepted goal is well under way; fail if the goal ends."""
        ended = handle.get_result_async()
        self.listener.until(lambda: abs(self.controller.voltage) > 0.1 or ended.done())
        assert not ended.done(), ended.result().result.message

    def rests(self) -> None:
        """Wait until the output is at 0 V; assert that it was within the sweep until then."""
        self.listener.until(self._at_rest)
        recorder = self.controller.recorder
        tables = [table for table, option in recorder.options.items() if option == OUTPUT]
        parts = [part for table in tables for part in recorder.samples.get(table, [])]
        assert max(np.abs(part).max(initial=0.0) for part in parts) <= 1.0 + 1e-8

    def _at_rest(self) -> bool:
        self.controller.advance()
        return not self.controller.is_running and self.controller.voltage == 0.0

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()
        self._serving.join()


@pytest.fixture
def stage(processes: LiveNodes, listener: Listener, tmp_path: Path) -> Iterator[Stage]:
    made = Stage(processes, listener, tmp_path)
    yield made
    for node in processes.nodes:  # before their controller is gone
        node.stop(30.0)
        processes.retire(node)
    made.close()


def test_a_sweep_runs_in_the_controller_and_becomes_a_bag(stage: Stage) -> None:
    stage.controller.set_voltage(0.5)
    stage.start()
    stage.listener.until(lambda: len(stage.states) > 3)
    assert {state.voltage for state in stage.states[1:]} == {0.5}  # connecting moves nothing
    result = stage.result(stage.send())
    assert result.status == GoalStatus.STATUS_SUCCEEDED, result.result.message
    assert result.result.names == ['sine_10Hz_1V', 'sine_20Hz_1V']
    assert result.result.samples == 2 * 0.4 * RATE
    bag = stage.folder / 'bags' / 'sweep_0001'
    assert str(bag) in result.result.message
    stage.rests()
    records = read_bag(bag)
    assert [record.name for record in records] == result.result.names
    for record in records:
        assert record.rate == RATE
        assert record.info.actuator == 'bender'
        assert np.ptp(record.displacement) > 5e-5
    about = yaml.safe_load((bag / 'controller.yaml').read_text())
    assert about['rate'] == about['controller']['rate'] == RATE
    assert {'firmware', 'name'} < set(about['controller'])
    assert {'axis', 'voltage', 'displacement', 'filters', 'limits'} < set(about)
    assert {each.record for each in stage.feedback} <= set(result.result.names)
    assert stage.feedback[0].fraction < stage.feedback[-1].fraction <= 1.0
    assert max(abs(state.voltage) for state in stage.states) > 0.1
    assert [state.sample for state in stage.states] == list(
        range(stage.states[0].sample, stage.states[0].sample + len(stage.states))
    )


def test_one_thing_at_a_time_and_within_the_limits(stage: Stage) -> None:
    stage.start(**{'limits.low': -1.0, 'limits.high': 1.0})
    assert not stage.send(amplitudes=[1.5]).accepted
    values = stage.says(DiagnosticStatus.OK, 'at rest')
    stage.listener.until(
        lambda: 'leaves the range -1 .. 1 V' in str(stage.health['gcs_driver'].values)
    )
    assert 'losses' in values
    assert stage.controller.tables == {}
    handle = stage.accepted(seconds=20.0)
    stage.moving(handle)
    assert not stage.send().accepted
    stage.listener.until(handle.cancel_goal_async().done)
    result = stage.result(handle)
    assert result.status == GoalStatus.STATUS_CANCELED
    assert 'at rest; no record' in result.result.message
    stage.rests()


def test_a_lost_connection_is_reported_and_followed_by_rest(stage: Stage) -> None:
    stage.start()
    handle = stage.accepted(seconds=200.0)  # longer than anything waits for its end
    stage.moving(handle)
    stage.server.fault.after, stage.server.fault.kind = 0, 'drop'
    result = stage.result(handle)
    assert result.status == GoalStatus.STATUS_ABORTED
    assert 'the connection is lost' in result.result.message
    stage.says(DiagnosticStatus.OK, 'is connected')
    stage.listener.tells(stage.health, 'gcs_driver', 'losses', '1')
    stage.rests()  # the stop of the new connection, not the end of the wave
    assert stage.result(stage.send(frequencies=[20.0])).result.success


def test_a_node_that_is_ended_stops_the_wave(stage: Stage) -> None:
    node = stage.start()
    handle = stage.accepted(seconds=20.0)
    stage.moving(handle)
    began = time.monotonic()
    assert node.stop(20.0) == 0
    assert time.monotonic() - began < 10.0
    stage.processes.retire(node)
    stage.rests()


def test_a_node_that_is_killed_leaves_a_wave_that_ends_by_itself(stage: Stage) -> None:
    rng = np.random.default_rng(3)
    for _ in range(3):
        node = stage.start()
        stage.send(frequencies=[10.0], seconds=0.6)
        time.sleep(float(rng.uniform(0.0, 1.0)))
        node.signal(signal.SIGKILL)
        stage.processes.wait_for(node, 10.0)
        stage.processes.retire(node)
        end = time.monotonic() + 5.0
        while stage.controller.is_running and time.monotonic() < end:
            time.sleep(0.05)
        stage.rests() if stage.controller.recorder.samples else None


def test_a_controller_that_is_not_there_is_waited_for(stage: Stage) -> None:
    stage.processes.start(
        'piezo_hysteresis', 'gcs_driver', {'controller': 'gcs://127.0.0.1:1', 'timeout': 0.2}
    )
    stage.says(DiagnosticStatus.ERROR, 'no controller answers')
    stage.listener.found_by('gcs_driver')
    assert not stage.send().accepted
