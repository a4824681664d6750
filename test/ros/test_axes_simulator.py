"""The simulator node with a preset of several axes against the plant it wraps, bit for bit."""

from __future__ import annotations

import math

import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, LoopStatus, VoltageCommand
from piezo_interfaces.srv import InjectFault
from piezo_sim.axes_plant import AxesPlant

pytestmark = pytest.mark.ros

PRESET, SEED, RATE, AXES = 'xy_scanner', 3, 10_000.0, (1, 2)


class Driver:
    """Takes the place of the links of all axes: commands a lock-step simulator tick by tick."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self.tick = 0
        self.states = [listener.listen(ActuatorState, f'axis_{i}/actuator/state') for i in AXES]
        self._publishers = [
            listener.node.create_publisher(VoltageCommand, f'axis_{i}/voltage/command', LOOP)
            for i in AXES
        ]
        for i in AXES:
            listener.matched(f'axis_{i}/actuator/state')
        listener.until(lambda: all(p.get_subscription_count() for p in self._publishers))

    def send(self, axis: int, voltage: float) -> None:
        """Publish one command of one axis."""
        self._publishers[axis - 1].publish(VoltageCommand(sample=self.tick, voltage=voltage))

    def step(self, *voltages: float) -> list[ActuatorState]:
        """Command all axes for the next tick; return its states, which have one stamp."""
        count = self.tick
        for axis, voltage in zip(AXES, voltages, strict=True):
            self.send(axis, voltage)
        self._listener.until(lambda: all(len(each) > count for each in self.states))
        states = [each[-1] for each in self.states]
        assert [state.sample for state in states] == [self.tick, self.tick]
        assert states[0].header.stamp == states[1].header.stamp
        self.tick += 1
        return states


def test_it_publishes_all_axes_under_one_clock(processes: LiveNodes, listener: Listener) -> None:
    settings = {
        'clock': 'lock_step', 'preset': PRESET, 'seed': SEED, 'rate': RATE,
        'axis_2.effects.creep': False,
    }  # fmt: skip
    processes.start('piezo_sim', 'simulator', settings)
    status = listener.listen(LoopStatus, 'loop/status', latched=True)
    driver = Driver(listener)
    plant = AxesPlant.from_preset(PRESET, RATE, SEED)
    plant.set_parameters({'axis_2.effects.creep': False})
    plant.reset()

    def both(first: float, second: float) -> None:
        states = driver.step(first, second)
        read = plant.exchange([first, second])
        for state, value in zip(states, read, strict=True):
            assert state.displacement == value or math.isnan(state.displacement + value)
        assert [state.voltage for state in states] == [first, second]

    def swing(ticks: int) -> None:
        for _ in range(ticks):
            both(20.0 * math.sin(0.3 * driver.tick), 15.0 * math.cos(0.2 * driver.tick) - 15.0)

    swing(20)
    for name, value in (
        ('effects.cross_talk_1_to_2', False),
        ('cross_talk.share_2_to_1', 0.03),
        ('axis_1.structure.natural_frequency', 600.0),
    ):
        assert listener.set_one('simulator', name, value) == ''
        plant.set_parameters({name: value})
        swing(5)
    assert 'outside' in listener.set_one('simulator', 'axis_1.actuator.gain', 1e9)
    assert 'other axes' in listener.set_one('simulator', 'preset', 'generic_bouc_wen')

    request = InjectFault.Request(fault='axis_2.sensor_dropout', duration=0.0)
    assert listener.call(InjectFault, 'simulator/inject_fault', request).success
    plant.inject('axis_2.sensor_dropout')
    states = driver.step(0.0, 0.0)
    assert math.isfinite(states[0].displacement)
    assert math.isnan(states[1].displacement)
    plant.exchange([0.0, 0.0])
    request = InjectFault.Request(fault='axis_3.sensor_dropout', duration=0.0)
    assert not listener.call(InjectFault, 'simulator/inject_fault', request).success
    listener.until(lambda: status[-1].sample == driver.tick)
    assert (status[-1].low, status[-1].high) == (-50.0, 50.0)


def test_a_tick_waits_for_all_axes_and_a_bad_command_holds_its_axis_alone(
    processes: LiveNodes, listener: Listener
) -> None:
    settings = {'clock': 'lock_step', 'preset': PRESET, 'seed': SEED, 'rate': RATE}
    processes.start('piezo_sim', 'simulator', settings)
    status = listener.listen(LoopStatus, 'loop/status', latched=True)
    driver = Driver(listener)
    driver.step(5.0, -5.0)
    driver.send(1, 6.0)
    driver.send(1, 6.0)
    listener.until(lambda: bool(status) and status[-1].sample > 0)
    before = len(status)
    listener.until(lambda: len(status) > before)
    assert status[-1].sample == 1
    states = driver.step(6.0, math.nan)
    assert [state.voltage for state in states] == [6.0, -5.0]
    listener.until(lambda: status[-1].refused == 1)
