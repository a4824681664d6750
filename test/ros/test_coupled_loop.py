"""A loop of two axes in separate processes: the bits of the offline loop, less error, safety."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_load import load_axes
from piezo_hysteresis.compensation.coupled.axes_chain import axes_chain, axes_loop
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.ros.processes import NodeProcess, ros_arguments
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.waveforms import Sine
from piezo_interfaces.msg import ActuatorState, Reference
from piezo_interfaces.srv import InjectFault
from piezo_sim.axes_plant import AxesPlant

pytestmark = pytest.mark.ros

MODEL = Path(__file__).with_name('xy_scanner.yaml')
RATE, SEED, AXES = 10_000.0, 5, (1, 2)
FREQUENCIES, AMPLITUDE, EASED = (20.0, 25.0), 3e-6, 0.1
LIMITS = Limits(-40.0, 45.0, 1e5)
SIMULATED = {
    'preset': 'xy_scanner', 'rate': RATE, 'clock': 'lock_step', 'seed': SEED, 'wait_for': 2,
}  # fmt: skip


def settings(ticks: int, **coupled: Any) -> dict[str, Any]:
    """Return the parameters of the loop of both axes."""
    given: dict[str, Any] = {'rate': RATE, 'coupled:model_file': str(MODEL)}
    given |= {f'coupled:{name}': value for name, value in coupled.items()}
    for axis, frequency in zip(AXES, FREQUENCIES, strict=True):
        own = {
            'mode': 'reference', 'frequency': frequency, 'reference.amplitude': AMPLITUDE,
            'ramp': EASED, 'duration': ticks / RATE, 'exit_when_done': True, 'deadline': 60.0,
        }  # fmt: skip
        given |= {f'excitation_{axis}:{name}': value for name, value in own.items()}
        for name in ('low', 'high', 'slew'):
            given[f'voltage_{axis}:limits.{name}'] = getattr(LIMITS, name)
    return given


def listen(listener: Listener) -> list[list[ActuatorState]]:
    return [listener.listen(ActuatorState, f'axis_{axis}/actuator/state') for axis in AXES]


def ran(
    processes: LiveNodes, bag: Path, given: dict[str, Any], ticks: int
) -> tuple[FloatArray, FloatArray]:
    """Run the loop; return voltages [V] and displacements [m] of both axes, shape (ticks, 2)."""
    topics = [f'axis_{axis}/actuator/state' for axis in AXES]
    nodes = [
        processes.start('piezo_sim', 'simulator', SIMULATED),
        processes.start('piezo_hysteresis', 'recorder', {'out': str(bag), 'topics': topics}),
        processes.start('piezo_hysteresis', 'control_loop', given),
    ]
    assert processes.wait_for(nodes[-1], 60.0) == 0
    for node in reversed(nodes):
        assert node.stop(30.0) == 0
        processes.retire(node)
    (record,) = load_axes(bag)
    assert len(record) == ticks
    return record.voltage, record.displacement


def references(ticks: int) -> list[Any]:
    time = np.arange(ticks, dtype=np.float64) * (1.0 / RATE)
    return [Sine(AMPLITUDE, each, ticks / RATE, ramp=EASED).sample(time) for each in FREQUENCIES]


def test_nodes_of_two_axes_give_the_bits_of_the_offline_loop(
    processes: LiveNodes, tmp_path: Path
) -> None:
    ticks = 2500
    given = settings(ticks, sensor_check=False, orders=[0, 1, 3])
    voltage, displacement = ran(processes, tmp_path / 'bag', given, ticks)

    chain = axes_chain(
        modal_file.load(MODEL), [LIMITS, LIMITS], MatrixSettings(orders=(0, 1, 3)), RATE
    )
    plant = AxesPlant.from_preset('xy_scanner', RATE, SEED)
    expected = axes_loop(references(ticks), chain, plant, [LIMITS, LIMITS])
    np.testing.assert_array_equal(voltage, expected.voltage)
    np.testing.assert_array_equal(displacement, expected.displacement)
    assert chain.attenuation is not None
    assert np.abs(chain.attenuation.lines).max() > 1e-3


def test_error_and_cross_talk_shrink(processes: LiveNodes, tmp_path: Path) -> None:
    ticks = 12_000
    part = slice(ticks - 4000, None)  # whole periods of both
    wanted = np.stack([each.value for each in references(ticks)], 1)

    def measured(name: str, given: dict[str, Any]) -> tuple[FloatArray, float]:
        """Return the errors [m rms], and how much axis 2 moves at the frequency of axis 1."""
        _, y = ran(processes, tmp_path / name, given, ticks)
        y = y - y[part].mean(0)
        line = np.exp(-2j * np.pi * FREQUENCIES[0] * np.arange(ticks)[part] / RATE)
        moved = np.abs(line @ y[part])
        return np.sqrt(np.mean((y - wanted)[part] ** 2, 0)), float(moved[1] / moved[0])

    gain = 1.725e-7  # of both axes at this amplitude [m/V]
    alone = settings(ticks)
    for axis in AXES:
        alone |= {
            f'excitation_{axis}:mode': 'voltage',
            f'excitation_{axis}:voltage.amplitude': AMPLITUDE / gain,
        }
    before, crossed = measured('alone', alone)
    forward, decoupled = measured('forward', settings(ticks, enabled=False))
    learnt, left = measured('learnt', settings(ticks))
    assert 0.015 < crossed < 0.03
    assert decoupled < 0.2 * crossed
    assert left < 0.7 * decoupled
    assert np.all(before > 4.0 * forward)
    assert np.all(learnt < 0.8 * forward)


def goes_to_rest(listener: Listener, states: list[list[ActuatorState]], since: int) -> None:
    """Wait until both voltages are 0, which they reach no faster than the slew allows."""
    listener.until(lambda: all(each[-1].voltage == 0.0 for each in states))
    for each in states:
        applied = np.array([state.voltage for state in each[since:]])
        assert np.all(np.isfinite(applied))
        assert np.abs(np.diff(applied)).max() <= 1.0001 * LIMITS.slew / RATE


class Publisher:
    """A process that publishes the references of both axes, played by the test."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self.states = listen(listener)
        self._publishers = [
            listener.node.create_publisher(Reference, f'axis_{axis}/reference', LOOP)
            for axis in AXES
        ]

    def begin(self, processes: LiveNodes) -> NodeProcess:
        """Start simulator and loop, which follow this publisher; return the loop."""
        real = {'clock': 'real_time', 'speed_factor': 0.02, 'command_timeout': 100.0}
        processes.start('piezo_sim', 'simulator', {**SIMULATED, **real})
        given = settings(1) | {'watchdog': 0.01, 'safe_ramp': 5000.0, 'sensor_check': False}
        given |= {f'excitation_{axis}:mode': 'idle' for axis in AXES}
        loop = processes.start('piezo_hysteresis', 'control_loop', given)
        self._listener.until(lambda: all(p.get_subscription_count() for p in self._publishers))
        self._listener.until(lambda: all(self.states))
        return loop

    def answer(self, *values: float) -> None:
        """Publish the references of the tick after the newest one that both axes have reached."""
        tick = min(each[-1].sample for each in self.states) + 2
        for publisher, value in zip(self._publishers, values, strict=True):
            if not math.isinf(value):
                publisher.publish(Reference(sample=tick, displacement=value))

    def moves(self, *values: float) -> None:
        """Publish until both axes are driven."""

        def driven() -> bool:
            self.answer(*values)
            return all(abs(each[-1].voltage) > 5.0 for each in self.states)

        self._listener.until(driven)


def test_the_reference_of_one_axis_that_ends_takes_all_axes_to_safety(
    processes: LiveNodes, listener: Listener
) -> None:
    publisher = Publisher(listener)
    publisher.begin(processes)
    publisher.moves(2e-6, -2e-6)
    since = len(publisher.states[0]) - 1

    def rests() -> bool:
        publisher.answer(2e-6, math.inf)  # the publisher of axis 2 has died
        return all(each[-1].voltage == 0.0 for each in publisher.states)

    listener.until(rests)
    goes_to_rest(listener, publisher.states, min(since, len(publisher.states[1]) - 1))
    publisher.moves(2e-6, -2e-6)  # and goes on where it is back


def test_what_is_not_a_number_moves_nothing(processes: LiveNodes, listener: Listener) -> None:
    publisher = Publisher(listener)
    publisher.begin(processes)
    publisher.moves(2e-6, -2e-6)
    health = listener.watch_health()
    request = InjectFault.Request(fault='axis_2.sensor_dropout', duration=0.0)
    assert listener.call(InjectFault, 'simulator/inject_fault', request).success
    count = len(publisher.states[1])

    def spoiled() -> bool:
        publisher.answer(math.nan, -2e-6)
        return len(publisher.states[1]) > count + 50

    listener.until(spoiled)
    listener.says(health, 'coupled', None, 'not a number')
    applied = np.array([[state.voltage for state in each[-40:]] for each in publisher.states])
    assert np.all(np.isfinite(applied))
    assert np.all(np.abs(applied) > 5.0)
    assert np.abs(np.diff(applied)).max() < 1.0


def test_a_simulator_that_is_started_anew_is_driven_from_rest(
    processes: LiveNodes, listener: Listener
) -> None:
    states = listen(listener)
    simulator = processes.start('piezo_sim', 'simulator', SIMULATED)
    processes.start('piezo_hysteresis', 'control_loop', settings(10_000_000))
    listener.until(lambda: all(each and each[-1].sample > 1000 for each in states))
    simulator.signal(signal.SIGKILL)
    processes.retire(simulator)
    listener.serve(0.5)
    for each in states:
        each.clear()
    processes.start('piezo_sim', 'simulator', SIMULATED)
    listener.until(lambda: all(each and each[-1].sample > 1500 for each in states))
    for each in states:
        assert each[0].sample == 0
        applied = np.array([0.0, *(state.voltage for state in each)])
        ticks = np.diff([-1, *(state.sample for state in each)])
        assert np.all(np.abs(np.diff(applied)) <= 1.0001 * LIMITS.slew / RATE * ticks)
        assert np.ptp(applied) > 5.0


FAILING = """
import sys
from piezo_hysteresis.nodes.links.control_loop import create
from piezo_hysteresis.ros.running import run_nodes
from piezo_hysteresis.runtime.coupled_ticks import CoupledLoop

whole, ticks = CoupledLoop.voltages, []

def voltages(self, tick):
    ticks.append(tick)
    if len(ticks) > 1500:
        raise ValueError('the law is broken')
    return whole(self, tick)

CoupledLoop.voltages = voltages
sys.exit(run_nodes(create))
"""


def test_a_law_that_fails_takes_all_axes_to_safety(
    processes: LiveNodes, listener: Listener
) -> None:
    states, health = listen(listener), listener.watch_health()
    real = {'clock': 'real_time', 'speed_factor': 0.02, 'command_timeout': 100.0}
    processes.start('piezo_sim', 'simulator', {**SIMULATED, **real})
    given = settings(10_000_000) | {'watchdog': 0.01, 'safe_ramp': 5000.0, 'sensor_check': False}
    loop = subprocess.Popen(
        [sys.executable, '-c', FAILING, *ros_arguments(given)], env=processes.environment
    )
    try:
        listener.until(lambda: all(any(abs(s.voltage) > 1.0 for s in each) for each in states))
        goes_to_rest(listener, states, 0)
        listener.says(health, 'coupled', None, 'no voltage is commanded')
    finally:
        loop.terminate()
        loop.wait()


def test_a_model_file_that_does_not_exist_starts_no_loop_of_one_axis(
    processes: LiveNodes, tmp_path: Path
) -> None:
    """The loop of one axis ran in its place, and nothing was decoupled."""
    given = {'coupled:model_file': str(tmp_path / 'absent.yaml')}
    node = processes.start('piezo_hysteresis', 'control_loop', given)
    assert processes.wait_for(node, 60.0) == 2
    assert f'error: there is no model file {tmp_path / "absent.yaml"}' in node.tail()
    processes.retire(node)
