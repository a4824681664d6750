"""Excitation, controllers and recorder in one process do what they do as processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient

from piezo_hysteresis.records import read_bag
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand

pytestmark = pytest.mark.ros

TICKS = 400
DRIVE = {
    'mode': 'reference',
    'frequency': 20.0,
    'reference.amplitude': 5e-5,
    'duration': 1e-3 * TICKS,
    'exit_when_done': True,
}
SIMULATED = {'clock': 'lock_step', 'preset': 'generic_bouc_wen', 'seed': 3}


def recorded(folder: Path) -> dict[str, np.ndarray[Any, Any]]:
    record = next(iter(read_bag(folder)))
    assert record.reference is not None
    return {'u': record.voltage, 'y': record.displacement, 'r': record.reference}


def test_a_reference_is_tracked_and_recorded_with_the_same_bits(
    processes: LiveNodes, tmp_path: Path
) -> None:
    simulator = processes.start('piezo_sim', 'simulator', {**SIMULATED, 'wait_for': 3})
    links = [processes.start('piezo_hysteresis', name) for name in ('feedforward', 'attenuation')]
    recorder = processes.start('piezo_hysteresis', 'recorder', {'out': str(tmp_path / 'apart')})
    excitation = processes.start('piezo_hysteresis', 'excitation', {**DRIVE, 'wait_for': 3})
    assert processes.wait_for(excitation, 60.0) == 0
    assert recorder.stop(30.0) == 0
    for node in (excitation, recorder, *links, simulator):
        node.stop(30.0)
        processes.retire(node)

    processes.start('piezo_sim', 'simulator', {**SIMULATED, 'wait_for': 1})
    settings = {f'excitation:{name}': value for name, value in DRIVE.items()}
    settings['recorder:out'] = str(tmp_path / 'together')
    loop = processes.start('piezo_hysteresis', 'control_loop', settings)
    assert processes.wait_for(loop, 60.0) == 0
    processes.retire(loop)

    apart, together = recorded(tmp_path / 'apart'), recorded(tmp_path / 'together')
    assert min(each.size for each in (*apart.values(), *together.values())) >= TICKS - 1
    assert np.ptp(apart['u'][: TICKS - 1]) > 0.2
    for name, values in apart.items():
        np.testing.assert_array_equal(values[: TICKS - 1], together[name][: TICKS - 1])


def test_a_sweep_and_the_reference_of_another_process(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    states = listener.listen(ActuatorState, 'actuator/state')
    commands = listener.listen(VoltageCommand, 'voltage/command')
    processes.start('piezo_sim', 'simulator', {**SIMULATED, 'wait_for': 1})
    processes.start('piezo_hysteresis', 'control_loop', {'excitation:folder': str(tmp_path)})
    client = ActionClient(listener.node, RunSweep, 'run_sweep')
    listener.until(client.server_is_ready)
    goal = RunSweep.Goal(frequencies=[20.0], amplitudes=[1.0], seconds=0.3, bag='swept')
    accepted = client.send_goal_async(goal)
    listener.until(accepted.done)
    finished = accepted.result().get_result_async()
    listener.until(finished.done)
    swept = finished.result().result
    assert swept.success
    listener.until(lambda: states[-1].sample >= swept.samples - 1)
    assert next(iter(read_bag(tmp_path / 'swept'))).voltage.max() == pytest.approx(1.0, rel=1e-2)

    publisher = listener.node.create_publisher(Reference, 'reference', 10)
    listener.until(lambda: publisher.get_subscription_count() == 1)
    tick = states[-1].sample + 1
    for sample in range(tick, tick + 20):
        before = len(states)
        publisher.publish(Reference(sample=sample, displacement=1e-5))
        listener.until(lambda before=before: len(states) > before)
    listener.until(lambda: commands[-1].sample == tick + 19)
    # one command a tick: no reference was taken twice
    assert [each.sample for each in commands[-20:]] == list(range(tick, tick + 20))
    assert commands[-1].voltage != 0.0

    listener.set_one('excitation', 'frequency', 50.0)
    assert not listener.set_one('excitation', 'mode', 'reference')
    listener.until(lambda: states[-1].sample > tick + 500)
    listener.until(lambda: publisher.get_subscription_count() == 0)
