"""The action ``discover``: feedback, the verdict at the end, no path out of its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient

from piezo_hysteresis.records import write_bag
from piezo_interfaces.action import Discover
from piezo_sim.sweep import simulate

pytestmark = pytest.mark.ros


def send(listener: Listener, client: ActionClient, goal: Any, feedback: list[float]) -> Any:
    future = client.send_goal_async(
        goal, feedback_callback=lambda m: feedback.append(m.feedback.fraction)
    )
    listener.until(future.done)
    return future.result()


def test_a_discovery_over_ros(processes: LiveNodes, listener: Listener, tmp_path: Path) -> None:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 2.0}
        for a in (1.0, 0.5)
        for f in (2, 7, 23)
    ]
    hidden = {'effects.sensor_nonlinearity': True}
    write_bag(tmp_path / 'bag', simulate('generic_bouc_wen', plan, hidden, 4))
    processes.start('piezo_hysteresis', 'discovery', {'folder': str(tmp_path)})
    client = ActionClient(listener.node, Discover, 'discover')
    listener.until(client.server_is_ready)
    listener.found_by('discovery')
    health = listener.watch_health()
    ok, warn, error = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
    listener.says(health, 'discovery', ok, 'idle')

    outside = Discover.Goal(data=['../elsewhere'], baseline='classical', out='out')
    assert not send(listener, client, outside, []).accepted
    listener.says(health, 'discovery', warn, 'refused')

    feedback: list[float] = []
    goal = Discover.Goal(data=['bag'], baseline='classical', out='out', seed=3, workers=2)
    handle = send(listener, client, goal, feedback)
    assert handle.accepted
    busy = send(listener, client, goal, [])
    assert not busy.accepted
    listener.tells(health, 'discovery', 'busy', 'True')
    finished = handle.get_result_async()
    listener.until(finished.done, timeout=180.0)
    result = finished.result().result
    assert result.success, result.message
    assert result.verdict == 'named'
    assert result.effects[0] == 'sensor_nonlinearity'
    assert result.after_in_floors < 1.2 < result.before_in_floors
    assert (tmp_path / 'out' / 'report.html').exists()
    assert feedback
    assert feedback == sorted(feedback)
    listener.tells(health, 'discovery', 'last_verdict', result.message)

    missing = Discover.Goal(data=['nowhere'], baseline='classical', out='out2')
    handle = send(listener, client, missing, [])
    finished = handle.get_result_async()
    listener.until(finished.done, timeout=60.0)
    assert not finished.result().result.success
    assert 'nowhere' in finished.result().result.message
    assert listener.says(health, 'discovery', error, 'nowhere')['failed'] == '1'

    given_up = Discover.Goal(data=['bag'], baseline='classical', out='out3')
    handle = send(listener, client, given_up, [])
    assert handle.accepted
    cancelled = handle.cancel_goal_async()
    listener.until(cancelled.done)
    finished = handle.get_result_async()
    listener.until(finished.done, timeout=120.0)
    assert finished.result().status == GoalStatus.STATUS_CANCELED
    assert 'cancelled' in finished.result().result.message
    assert not (tmp_path / 'out3').exists()
    client.destroy()
