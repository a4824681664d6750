"""Two actuators side by side, set up by a parameter file, without cross-talk."""

from __future__ import annotations

from pathlib import Path

import pytest
from listening import Listener

from piezo_interfaces.msg import ActuatorState, VoltageCommand
from piezo_ros_common.processes import NodeProcesses
from piezo_ros_common.qos import LOOP

pytestmark = pytest.mark.ros

SCENARIO = Path(__file__).parents[2] / 'config' / 'scenarios' / 'hidden_effect.yaml'


def test_two_actuators_side_by_side(processes: NodeProcesses, listener: Listener) -> None:
    x = listener.listen(ActuatorState, 'stage_x/actuator/state')
    y = listener.listen(ActuatorState, 'stage_y/actuator/state')
    for stage in ('stage_x', 'stage_y'):
        settings = {'clock': 'lock_step', 'wait_for': 1}
        processes.start('piezo_sim', 'simulator', settings, namespace=stage, files=[SCENARIO])
    publisher = listener.node.create_publisher(VoltageCommand, 'stage_x/voltage/command', LOOP)
    listener.matched('stage_x/actuator/state')
    listener.matched('stage_y/actuator/state')
    listener.until(lambda: publisher.get_subscription_count() == 1)
    for k in range(20):
        publisher.publish(VoltageCommand(sample=k, voltage=0.5))
        listener.until(lambda seen=k: len(x) > seen)
    assert [state.voltage for state in x] == [0.5] * 20
    assert not y
    for stage in ('stage_x', 'stage_y'):
        assert listener.get_parameter(f'{stage}/simulator', 'effects.creep') is True
        assert listener.get_parameter(f'{stage}/simulator', 'amplifier.lag_time_constant') == 0.002
    assert listener.set_one('stage_x/simulator', 'effects.creep', False) == ''
    assert listener.get_parameter('stage_y/simulator', 'effects.creep') is True
