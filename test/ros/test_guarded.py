"""No callback ends a node: each is answered, logged and counted, with both executors."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.srv import ChangeState
from listening import Listener
from live_nodes import LiveNodes
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

import piezo_hysteresis
from piezo_hysteresis.ros.guarded import callback_name, sends_floats
from piezo_interfaces.action import RunSweep

pytestmark = pytest.mark.ros


@pytest.fixture(params=['auto', 'default'])
def failing(
    request: Any, processes: LiveNodes, listener: Listener, tmp_path: Path
) -> Iterator[subprocess.Popen[bytes]]:
    environment = {**processes.environment, 'PIEZO_EXECUTOR': request.param}
    script = Path(__file__).with_name('failing_node.py')
    with (tmp_path / 'log').open('wb') as log:
        node = subprocess.Popen(
            [sys.executable, str(script)], env=environment, stdout=log, stderr=subprocess.STDOUT
        )
    yield node
    node.kill()
    node.wait()


def test_every_callback_is_answered(
    failing: subprocess.Popen[bytes], listener: Listener, tmp_path: Path
) -> None:
    def call(**values: float) -> list[Any]:
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        request = SetParameters.Request(parameters=parameters)
        return list(listener.call(SetParameters, '/failing/set_parameters', request).results)

    answer = listener.call(Trigger, '/failing/trigger', Trigger.Request())
    assert not answer.success
    assert 'out of order' in answer.message
    for name, word in (('applied', 'cannot apply'), ('refused', 'missing')):
        (result,) = call(**{name: 1.0})
        assert not result.successful
        assert word in result.reason
    change = ChangeState.Request()
    change.transition.id = 77  # there is no such transition
    assert not listener.call(ChangeState, '/failing/change_state', change).success
    listener.node.create_publisher(Float64, 'number', 10).publish(Float64(data=1.0))
    early, late = (
        ActionClient(listener.node, RunSweep, name) for name in ('fails_early', 'fails_late')
    )
    for client in (early, late):
        listener.until(client.server_is_ready)
    sent = early.send_goal_async(RunSweep.Goal())
    listener.until(sent.done)
    assert not sent.result().accepted
    sent = late.send_goal_async(RunSweep.Goal())
    listener.until(sent.done)
    ended = sent.result().get_result_async()
    listener.until(ended.done)
    assert ended.result().status == GoalStatus.STATUS_ABORTED
    assert not ended.result().result.success
    assert 'no such plan' in ended.result().result.message
    listener.until(
        lambda: (
            'disk is full' in listener.call(Trigger, '/failing/safe', Trigger.Request()).message
        )
    )
    assert failing.poll() is None
    os.kill(failing.pid, signal.SIGINT)
    assert failing.wait(30.0) == 0
    log = (tmp_path / 'log').read_text()
    assert log.count('Failing._tick failed') <= 6  # not one for each of some hundred failures
    assert 'Segmentation' not in log


def test_no_node_avoids_the_guard() -> None:
    """Nodes, actions and tasks of the suite are made by `ros/guarded.py`."""
    sources = Path(piezo_hysteresis.__file__).parents[2]
    for path in sources.glob('piezo_*/piezo_*/**/*.py'):
        if path.name == 'guarded.py':
            continue
        text = path.read_text()
        for word in ('(Node):', '(LifecycleNode):', 'ActionServer(', 'executor.create_task('):
            assert word not in text, f'{path} avoids the guard: {word}'


def test_failures_of_the_callback_of_an_axis_are_its_own() -> None:
    first, second = (callback_name(partial(sends_floats, axis)) for axis in (1, 2))
    assert first != second
    assert first == callback_name(partial(sends_floats, 1))
    assert callback_name(sends_floats) == 'sends_floats'
