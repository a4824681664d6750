"""Nodes under ``use_sim_time`` without a clock, and with one that jumps: the loop runs on."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock

from piezo_hysteresis.records import read_bag
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState

pytestmark = pytest.mark.ros

JUMPS = 1000, 5, 2_000_000_000, 0, 1001  # of the clock [s]


@pytest.mark.parametrize('clock', ['none', 'jumps'])
@pytest.mark.parametrize('pace', ['real_time', 'lock_step'])
def test_the_loop_runs_by_its_own_time(
    processes: LiveNodes, listener: Listener, tmp_path: Path, clock: str, pace: str
) -> None:
    publisher = listener.node.create_publisher(Clock, '/clock', 10)
    seconds = cycle(JUMPS)

    def served(condition: Callable[[], object]) -> None:
        """Wait for `condition` while the clock jumps."""

        def step() -> object:
            if clock == 'jumps':
                publisher.publish(Clock(clock=Time(sec=next(seconds))))
            return condition()

        listener.until(step)

    simulated: dict[str, object] = {'use_sim_time': True}
    health = listener.watch_health()
    states = listener.listen(ActuatorState, 'actuator/state')
    processes.start('piezo_sim', 'simulator', {**simulated, 'clock': pace, 'wait_for': 1})
    nodes = 'excitation', 'feedforward', 'attenuation', 'feedback', 'recorder'
    settings: dict[str, object] = {f'{node}:use_sim_time': True for node in nodes}
    settings |= {'excitation:folder': str(tmp_path), 'recorder:out': str(tmp_path / 'whole')}
    loop = processes.start('piezo_hysteresis', 'control_loop', settings)

    client = ActionClient(listener.node, RunSweep, 'run_sweep')
    served(client.server_is_ready)
    goal = RunSweep.Goal(frequencies=[20.0], amplitudes=[1.0], seconds=0.3, bag='swept')
    accepted = client.send_goal_async(goal)
    served(accepted.done)
    finished = accepted.result().get_result_async()
    served(finished.done)
    assert finished.result().result.success
    served(lambda: states and all(node in health for node in ('simulator', *nodes)))
    for node in ('simulator', *nodes):
        status = health[node]
        # after the sweep no node commands, which the simulator reports on a slow machine
        at_rest = node == 'simulator' and status.message.startswith('no commands')
        assert at_rest or status.level < DiagnosticStatus.ERROR, status.message
    assert loop.stop(60.0) == 0

    (swept,) = read_bag(tmp_path / 'swept')
    assert swept.rate == 1000.0
    late = 0.3 if pace == 'real_time' else 1e-2  # a busy machine misses ticks near the peaks
    assert swept.voltage.max() == pytest.approx(1.0, rel=late)
    whole = next(iter(read_bag(tmp_path / 'whole')))
    assert whole.rate == 1000.0
    # where the machine stands still, the watchdog ramps to 0 V before the other half wave
    assert np.ptp(whole.voltage) > (0.5 if pace == 'real_time' else 1.0)
