"""Two actuators side by side, set up by a parameter file, without cross-talk."""

from __future__ import annotations

from pathlib import Path

import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand

pytestmark = pytest.mark.ros

SCENARIO = Path(__file__).parents[2] / 'config' / 'scenarios' / 'hidden_effect.yaml'


def test_two_actuators_side_by_side(processes: LiveNodes, listener: Listener) -> None:
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


GAINS = {'stage_x': 1e-4, 'stage_y': 2e-4}


def test_two_chains_side_by_side(processes: LiveNodes, listener: Listener) -> None:
    """References of one stage move that stage alone, by its own links and its own gain."""
    for stage, gain in GAINS.items():
        settings = {'clock': 'lock_step', 'wait_for': 2}
        processes.start('piezo_sim', 'simulator', settings, namespace=stage)
        processes.start('piezo_hysteresis', 'feedforward', {'gain': gain}, namespace=stage)
        processes.start('piezo_hysteresis', 'attenuation', {'enabled': False}, namespace=stage)
    kinds: dict[str, type[ActuatorState | VoltageCommand]] = {
        'voltage/feedforward': VoltageCommand,
        'voltage/command': VoltageCommand,
        'actuator/state': ActuatorState,
    }
    words = {
        stage: {topic: listener.listen(kind, f'{stage}/{topic}') for topic, kind in kinds.items()}
        for stage in GAINS
    }
    publishers = {
        stage: listener.node.create_publisher(Reference, f'{stage}/reference', LOOP)
        for stage in GAINS
    }
    for stage in GAINS:
        listener.until(lambda p=publishers[stage]: p.get_subscription_count() == 2)
        for topic in words[stage]:
            listener.matched(f'{stage}/{topic}')

    for turn, (stage, gain) in enumerate(GAINS.items()):
        states = words[stage]['actuator/state']
        for k in range(10):
            while len(states) <= k:  # again where a link had not yet found the next one
                publishers[stage].publish(Reference(sample=k, displacement=5e-5))
                listener.wait_briefly(lambda seen=k, received=states: len(received) > seen, 1.0)
        assert [state.voltage for state in states] == [5e-5 / gain] * 10
        if turn == 0:
            assert not any(words['stage_y'].values())
    assert len(words['stage_x']['actuator/state']) == 10
    assert {message.voltage for message in words['stage_x']['voltage/command']} == {5e-5 / 1e-4}
    assert {message.voltage for message in words['stage_y']['voltage/command']} == {5e-5 / 2e-4}
