"""The simulator node in lock-step against the plant it wraps, step for step, bit for bit."""

from __future__ import annotations

import math
from typing import Any

import pytest
from listening import Driver, Listener
from live_nodes import LiveNodes
from std_srvs.srv import Trigger

from piezo_interfaces.msg import LoopStatus
from piezo_interfaces.srv import InjectFault, LoadPreset
from piezo_sim.plant import Plant

pytestmark = pytest.mark.ros

PRESET, SEED, RATE = 'fdk_pzba_00030', 3, 1000.0
STROKE = 1.3e-4


class Twin:
    """The simulator process, and a plant in this process to which the same is done."""

    def __init__(self, processes: LiveNodes, listener: Listener) -> None:
        settings = {'clock': 'lock_step', 'preset': PRESET, 'seed': SEED, 'effects.creep': True}
        processes.start('piezo_sim', 'simulator', settings)
        self.listener = listener
        self.driver = Driver(listener)
        self.status = listener.listen(LoopStatus, 'loop/status', latched=True)
        self.plant = Plant.from_preset(PRESET, RATE, SEED)
        self.plant.set_parameters({'effects.creep': True})
        self.plant.reset()

    def step(self, voltage: float) -> float:
        """Drive both for a tick; return the reading, which is the same."""
        read = self.driver.step(voltage).displacement
        expected = self.plant.exchange(voltage)
        assert read == expected or (math.isnan(read) and math.isnan(expected))
        return float(read)

    def swing(self, ticks: int = 20) -> None:
        """Drive both with something that leaves no state untouched."""
        for _ in range(ticks):
            self.step(0.8 * math.sin(0.3 * self.driver.tick))

    def set(self, name: str, value: Any) -> None:
        """Set a parameter of both, which must be accepted."""
        assert self.listener.set_one('simulator', name, value) == ''
        self.plant.set_parameters({name: value})

    def refusal(self, name: str, value: Any) -> str:
        """Return why the simulator refuses a value."""
        before = self.listener.get_parameter('simulator', name)
        reason = self.listener.set_one('simulator', name, value)
        assert self.listener.get_parameter('simulator', name) == before
        return reason


@pytest.fixture(scope='module')
def twin(shared_processes: LiveNodes, shared_listener: Listener) -> Twin:
    return Twin(shared_processes, shared_listener)


def test_changed_parameters_act_on_the_next_sample(twin: Twin) -> None:
    twin.swing()
    before = twin.step(0.5), twin.step(0.5)
    twin.set('structure.natural_frequency', 90.0)
    twin.set('sensor.offset', 2e-5)
    after = twin.step(0.5)
    assert after != pytest.approx(before[1], abs=1e-6)
    twin.set('sensor.offset', 6e-6)
    twin.swing()


def test_an_integer_is_accepted_for_a_float(twin: Twin) -> None:
    assert twin.listener.set_one('simulator', 'structure.natural_frequency', 70) == ''
    assert twin.listener.get_parameter('simulator', 'structure.natural_frequency') == 70.0
    twin.plant.set_parameters({'structure.natural_frequency': 70.0})
    twin.swing()


def test_effects_are_switched_while_running_without_a_jump(twin: Twin) -> None:
    noisy = ('noise', 'flicker', 'quantisation', 'sensor_noise', 'drop_outs', 'dropouts')
    for name, on in twin.plant.effects.items():
        if on and name in noisy:
            twin.set(f'effects.{name}', False)
    jumps = {}
    for effect in twin.plant.effect_table:
        switch = f'effects.{effect.name}'
        if effect.name in noisy or effect.name.startswith('noise'):
            continue
        for value in (not twin.plant.effects[effect.name], twin.plant.effects[effect.name]):
            before = twin.plant.displacement
            twin.set(switch, value)
            jumps[switch, value] = abs(twin.plant.displacement - before)
            twin.step(0.5)
    assert len(jumps) > 40
    assert max(jumps.values()) < 1e-12, max(jumps, key=jumps.__getitem__)
    twin.set('effects.noise', True)


@pytest.mark.parametrize(
    ('name', 'value', 'words'),
    [
        ('structure.damping_ratio', -0.1, ('structure.damping_ratio', '-0.1')),
        ('structure.natural_frequency', math.nan, ('structure.natural_frequency',)),
        ('structure.natural_frequency', math.inf, ('structure.natural_frequency',)),
        ('structure.natural_frequency', '68 Hz', ('type float', "'68 Hz'")),
        ('effects.creep', 1.0, ('type bool', '1.0')),
        ('amplifier.range_low', 6.0, ('amplifier.range',)),
        ('structure.nonsense', 1.0, ('structure.nonsense',)),
        ('speed_factor', 0.0, ('speed_factor', 'above 0')),
        ('rate', 500.0, ('rate', 'read-only')),
        ('preset', 'no_such_actuator', ('no_such_actuator', PRESET)),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(
    twin: Twin, name: str, value: float | str, words: Any
) -> None:
    reason = twin.refusal(name, value)
    assert reason
    assert '\n' not in reason
    assert all(word in reason for word in words), reason
    twin.swing(5)


def test_bad_commands_are_held_and_counted(twin: Twin) -> None:
    twin.step(0.25)
    for bad in (math.nan, math.inf, 5.5):
        state = twin.driver.step(bad)
        assert state.voltage == 0.25
        assert state.displacement == twin.plant.exchange(0.25)
    twin.listener.until(lambda: twin.status[-1].refused == 3)
    assert twin.status[-1].missed == 0


def test_a_repeated_command_returns_the_next_tick_without_a_step(twin: Twin) -> None:
    twin.step(0.1)
    count, doubled = len(twin.driver.states), twin.status[-1].doubled
    twin.driver.send(twin.driver.tick - 1, 0.9)
    twin.listener.until(lambda: twin.status[-1].doubled == doubled + 1)
    assert twin.status[-1].sample == twin.driver.tick
    twin.step(0.2)
    assert len(twin.driver.states) == count + 1


@pytest.mark.parametrize('fault', ['sensor_dropout', 'stuck_sensor', 'amplifier_trip'])
def test_faults_begin_and_end_on_request(twin: Twin, fault: str) -> None:
    twin.swing(5)
    request = InjectFault.Request(fault=fault, duration=0.004)
    answer = twin.listener.call(InjectFault, 'simulator/inject_fault', request)
    assert answer.success, answer.message
    twin.plant.inject(fault, 0.004)
    read = [twin.step(0.5 + 0.01 * k) for k in range(8)]
    if fault == 'sensor_dropout':
        assert [math.isnan(each) for each in read] == [True] * 4 + [False] * 4
    if fault == 'stuck_sensor':
        assert len(set(read[:4])) == 1
    assert all(math.isfinite(each) for each in read[4:])


def test_an_unknown_fault_is_refused(twin: Twin) -> None:
    for request in (
        InjectFault.Request(fault='meteorite'),
        InjectFault.Request(fault='stuck_sensor', duration=math.nan),
    ):
        answer = twin.listener.call(InjectFault, 'simulator/inject_fault', request)
        assert not answer.success
        assert answer.message
    twin.swing(3)


def test_reset_and_presets(twin: Twin) -> None:
    twin.swing()
    answer = twin.listener.call(Trigger, 'simulator/reset', Trigger.Request())
    assert answer.success
    twin.plant.reset()
    twin.swing()

    request = LoadPreset.Request(preset='awaiting_first_heartbeat_of')
    answer = twin.listener.call(LoadPreset, 'simulator/load_preset', request)
    assert not answer.success
    assert PRESET in answer.message
    twin.swing(3)

    request = LoadPreset.Request(preset='smooth_reference')
    answer = twin.listener.call(LoadPreset, 'simulator/load_preset', request)
    assert answer.success, answer.message
    twin.plant = Plant.from_preset('smooth_reference', RATE, SEED)
    twin.swing()
    for name, value in twin.plant.parameters.items():
        assert twin.listener.get_parameter('simulator', name) == value
    assert twin.listener.get_parameter('simulator', 'preset') == 'smooth_reference'
