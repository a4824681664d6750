"""The action ``investigate`` on live nodes: cancelled, gone on with, repeated from its bags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from listening import Listener
from rclpy.action import ActionClient

from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.investigation.conduct import repeated
from piezo_hysteresis.investigation.journal import Journal
from piezo_hysteresis.models import named
from piezo_hysteresis.records import load
from piezo_interfaces.action import Investigate
from piezo_interfaces.msg import ActuatorState
from piezo_ros_common.processes import NodeProcesses
from piezo_ros_common.qos import LOOP
from piezo_sim.sweep import grid, simulate

pytestmark = pytest.mark.ros
PRESET = 'generic_bouc_wen'
PATIENCE = 240.0


def ask(listener: Listener, client: ActionClient, goal: Any, feedback: list[Any]) -> Any:
    sent = client.send_goal_async(goal, feedback_callback=lambda m: feedback.append(m.feedback))
    listener.until(sent.done)
    handle: Any = sent.result()
    assert handle.accepted
    return handle


def ended(listener: Listener, handle: Any) -> Any:
    future = handle.get_result_async()
    listener.until(future.done, timeout=PATIENCE)
    return future.result()


def test_it_finds_an_effect_is_cancelled_goes_on_and_shows_the_gap_shrink(
    processes: NodeProcesses, listener: Listener, tmp_path: Path
) -> None:
    specs = grid('sine', [1.0, 5.0, 20.0, 50.0], [1.0, 0.5], {'duration': 2.5, 'ramp': 0.2})
    records = simulate(PRESET, specs, {}, 1)
    file = identify(records, named('classical')).model_file()
    file.save(tmp_path / 'model.yaml')
    world = {'clock': 'lock_step', 'preset': PRESET, 'effects.creep': True, 'wait_for': 2}
    processes.start('piezo_sim', 'simulator', world)
    model = str(tmp_path / 'model.yaml')
    processes.start('piezo_hysteresis', 'gap_monitor', {'model_file': model})
    processes.start('piezo_hysteresis', 'excitation', {'actuator': PRESET})
    settings = {'folder': str(tmp_path), 'model_file': model}
    processes.start('piezo_hysteresis', 'discovery', settings)
    voltages: list[float] = []
    listener.node.create_subscription(
        ActuatorState, 'actuator/state', lambda m: voltages.append(m.voltage), LOOP
    )
    client = ActionClient(listener.node, Investigate, 'investigate')
    listener.until(client.server_is_ready)
    goal = Investigate.Goal(out='out', low=-1.0, high=1.0, slew=700.0, budget=60.0, apply=True)

    feedback: list[Any] = []
    handle = ask(listener, client, goal, feedback)
    listener.until(lambda: any(f.number == 2 for f in feedback), timeout=PATIENCE)
    handle.cancel_goal_async()
    broken_off = ended(listener, handle)
    assert broken_off.status == GoalStatus.STATUS_CANCELED
    assert 'at rest' in broken_off.result.message
    assert voltages[-1] == pytest.approx(0.0, abs=1e-3)
    done = len(Journal.read(tmp_path / 'out').lines)
    assert done >= 1

    result = ended(listener, ask(listener, client, goal, feedback)).result
    assert result.success, result.message
    assert list(result.effects) == ['creep']
    assert result.stop == 'sure'
    assert result.after_in_floors < 0.5 * result.before_in_floors
    assert max(map(abs, voltages)) <= 1.0 + 1e-9
    assert all(f.why for f in feedback if f.stage == 'run')
    lines = Journal.read(tmp_path / 'out').lines
    assert len(lines) == result.experiments > done
    assert len(load([tmp_path / 'out' / 'bags' / '01'])) == 1

    again = repeated(tmp_path / 'out')
    assert again.differences == ()
    assert again.stop is not None
    assert again.stop.reason == 'sure'
