"""A loop does not close on a sensor whose sign is reversed, and says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, VoltageCommand

pytestmark = pytest.mark.ros

TICKS = 3000
MODEL = 'bouc_wen_mode'


@pytest.mark.parametrize('gain', [1.0, -1.0, 0.01], ids=['right', 'reversed', 'still'])
def test_a_loop_closes_on_a_sensor_that_follows_the_voltage(
    processes: LiveNodes, listener: Listener, tmp_path: Path, gain: float
) -> None:
    """The displacement goes through a relay, which has the gain of the sensor."""
    model = named(MODEL)
    ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(tmp_path / 'm.yaml')
    known: dict[str, object] = {'model_file': str(tmp_path / 'm.yaml'), 'limits.high': 1.2}
    health = listener.watch_health()
    straight = listener.listen(VoltageCommand, 'voltage/feedforward')
    commands = listener.listen(VoltageCommand, 'voltage/command')
    relay = listener.node.create_publisher(ActuatorState, 'actuator/state', LOOP)
    states: list[float] = []

    def pass_on(state: ActuatorState) -> None:
        states.append(state.voltage)
        state.displacement *= gain
        relay.publish(state)

    listener.node.create_subscription(ActuatorState, 'actuator/raw', pass_on, LOOP)
    simulated = {'clock': 'lock_step', 'wait_for': 1}
    processes.start('piezo_sim', 'simulator', simulated, remap={'actuator/state': 'actuator/raw'})
    nodes: dict[str, dict[str, object]] = {
        'feedforward': known,
        'attenuation': known,
        'feedback': {**known, 'method': 'pid', 'pid.integral': 300.0},
        'excitation': {
            'mode': 'reference',
            'frequency': 5.0,
            'reference.amplitude': 4e-5,
            'duration': 1e-3 * TICKS,
        },
    }
    settings = {
        f'{node}:{name}': value for node, given in nodes.items() for name, value in given.items()
    }
    loop = processes.start('piezo_hysteresis', 'control_loop', settings)
    listener.until(lambda: commands and commands[-1].sample >= TICKS - 1)
    listener.until(lambda: straight[-1].sample >= TICKS - 1)

    sent = {each.sample: each.voltage for each in commands}
    shares = np.array(
        [sent[each.sample] - each.voltage for each in straight if each.sample in sent]
    )
    assert np.ptp(states) > 0.3
    assert max(map(abs, states)) <= 1.2
    if gain == 1.0:
        assert np.max(np.abs(shares)) > 1e-3
        assert np.flatnonzero(shares)[0] < 500
        return
    assert not np.any(shares)
    sentence = 'moves against the voltage' if gain < 0.0 else 'does not follow the voltage'
    for node in ('attenuation', 'feedback'):
        listener.says(health, node, DiagnosticStatus.ERROR, sentence)
    listener.until(lambda: sentence in loop.log.read_text())
