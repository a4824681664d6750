"""Bad input to the links, in one process without a middleware: what they command is safe."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter

from piezo_hysteresis.common.node_sheet import Level
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.nodes.links.control_loop import ControlLoop
from piezo_hysteresis.nodes.links.link_node import LinkNode
from piezo_hysteresis.ros.cdr_header import head_of
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.runtime import link_health

pytestmark = pytest.mark.ros

DT = 1e-3
SLEW = 200.0
RAMP = 20.0
TIMEOUT = 20
HEAD = head_of(0, 0)
SETTINGS = {
    'limits.slew': SLEW,
    'safe_ramp': RAMP,
    'watchdog': TIMEOUT * DT,
    'transition': 0.02,
    'attenuation:method': 'afc',
    'attenuation:orders': '[0, 1]',
    'feedback:method': 'pid',
    'feedback:pid.integral': 5e3,
}


class Chain:
    """The links of the control loop; the test is the actuator and the excitation."""

    def __init__(self) -> None:
        self.loop = ControlLoop()
        self.links: tuple[LinkNode, ...] = self.loop.links
        self.commands: list[tuple[int, float]] = []
        self.loop.feedback.deliver_to(lambda _, k, voltage: self.commands.append((k, voltage)))
        model = named('classical')
        self.loop.feedforward.load(ModelFile(model, model.defaults()))
        self.tick = 0

    def close(self) -> None:
        for node in self.loop.nodes:
            node.destroy_node()

    def reference(self, sample: int, displacement: float | None = None) -> None:
        phase = 2 * math.pi * 10.0 * sample * DT
        if displacement is None:
            displacement = 5e-5 * math.sin(phase)
        point = ReferencePoint(sample, displacement, 0.0, 0.0, 10.0, phase)
        for link in reversed(self.links):
            link.take_reference(HEAD, point)

    def state(self, displacement: float | None = None) -> None:
        """Go one tick on."""
        voltage = self.voltage
        value = 1.2e-4 * voltage if displacement is None else displacement
        for link in reversed(self.links):
            link.take_state(HEAD, Measured(self.tick, voltage, value))
        self.tick += 1

    def step(self, displacement: float | None = None) -> None:
        self.reference(self.tick, displacement)
        for _ in self.links:  # an excitation repeats its last word, too
            if self.voltage_of != self.tick:
                self.reference(self.tick, displacement)
        assert self.voltage_of == self.tick
        self.state()

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.step()

    @property
    def voltage_of(self) -> int:
        return self.commands[-1][0] if self.commands else -1

    @property
    def voltage(self) -> float:
        return self.commands[-1][1] if self.commands else 0.0

    def safe(self) -> None:
        """Check every command so far: finite, in range, within the slew."""
        voltages = np.array([voltage for _, voltage in self.commands])
        assert np.isfinite(voltages).all()
        assert np.abs(voltages).max() <= 1.2
        first = np.array([sample == 0 for sample, _ in self.commands])  # of an actuator at rest
        before = np.where(first, 0.0, np.roll(voltages, 1))
        assert np.abs(voltages - before).max() <= SLEW * DT * (1 + 1e-9)

    def set(self, node: LinkNode, values: dict[str, Any]) -> str:
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        return str(node.set_parameters_atomically(parameters).reason)

    def counts(self, name: str) -> list[int]:
        return [link.all_counters()[name] for link in self.links]


@pytest.fixture(scope='module')
def context() -> Iterator[None]:
    with NodeProcesses() as processes:
        words = [word for name, v in SETTINGS.items() for word in ('-p', f'{name}:={v}')]
        rclpy.init(args=['test', '--ros-args', *words], domain_id=processes.domain)
        yield
        rclpy.shutdown()


@pytest.fixture
def chain(context: None) -> Iterator[Chain]:
    links = Chain()
    links.run(320)
    yield links
    links.safe()
    links.close()


def test_all_is_well_at_first(chain: Chain) -> None:
    for link in chain.links:
        health = link.health()
        assert health.level == Level.OK, health.message
        assert health.message == 'corrects the voltage'
    assert abs(chain.voltage) > 0.01


@pytest.mark.parametrize('wrong', [math.nan, math.inf, -math.inf])
def test_a_reference_that_is_no_number_is_held(chain: Chain, wrong: float) -> None:
    before = chain.voltage
    chain.step(wrong)
    assert abs(chain.voltage - before) < 0.02
    chain.run(20)
    assert chain.counts('refused_references') == [1, 1, 1]
    for link in chain.links:
        assert link.health().level == Level.ERROR
        assert 'reference is not a number' in link.health().message


@pytest.mark.parametrize('wrong', [math.nan, math.inf])
def test_a_voltage_that_is_no_number_is_held_and_reaches_no_law(
    chain: Chain, wrong: float
) -> None:
    before = chain.voltage
    chain.loop.attenuation.take_voltage(HEAD, chain.tick, wrong)
    chain.step()
    assert chain.voltage == pytest.approx(before, abs=0.02)
    chain.run(50)
    assert chain.counts('refused') == [0, 1, 0]
    assert 'the voltage is held' in chain.loop.attenuation.health().message


def test_a_reading_that_is_not_finite_is_skipped(chain: Chain) -> None:
    for wrong in (math.nan, math.inf, -math.inf):
        chain.reference(chain.tick)
        chain.state(wrong)
        chain.run(10)
    assert chain.loop.feedback.all_counters()['measured_not_finite'] == 3
    assert chain.loop.attenuation.all_counters()['measured_not_finite'] == 3


def test_a_law_that_answers_no_number_is_started_anew(chain: Chain) -> None:
    feedback = chain.loop.feedback
    assert feedback.law is not None
    feedback.law.step = lambda *_: math.nan  # type: ignore[method-assign]
    chain.run(5)
    assert feedback.all_counters()['law_reset'] == 5
    assert feedback.health().level == Level.ERROR


def test_doubled_reordered_and_stray_input_changes_nothing(chain: Chain) -> None:
    twin = Chain()
    twin.run(320)
    for sample in (chain.tick - 1, chain.tick - 3, chain.tick + 10**6):
        chain.reference(sample, 1e-4)
        for link in chain.links[1:]:
            link.take_voltage(HEAD, sample, -1.0)
            link.take_state(HEAD, Measured(sample, 1.0, 1e-4))
    chain.run(50)
    twin.run(50)
    assert dict(chain.commands) == dict(twin.commands)
    assert chain.counts('strays') == [1, 1, 1]
    assert chain.counts('reordered') == [1, 1, 1]
    assert min(chain.counts('doubled')) >= 1
    assert 'far from the rest' in chain.loop.feedforward.health().message
    twin.close()


@pytest.mark.parametrize('gap', [1, 5, 10_000])
def test_a_gap_in_the_ticks_is_gone_over(chain: Chain, gap: int) -> None:
    chain.tick += gap
    for _ in range(6):  # an excitation repeats its last word where no answer comes
        chain.reference(chain.tick)
    chain.state()
    chain.run(50)
    assert chain.counts('missed') == [gap] * 3


def test_a_loop_that_begins_anew_begins_from_rest(chain: Chain) -> None:
    chain.tick = 0
    chain.run(100)
    assert abs(chain.commands[-100][1]) < 1e-6  # not on from the voltage of the run before
    assert [k for k, _ in chain.commands[-100:]] == list(range(100))
    assert chain.counts('reordered') == [0, 0, 0]


@pytest.mark.parametrize('pause', [300, 10_000])
def test_without_input_the_voltage_ramps_to_safety_and_comes_back(
    chain: Chain, pause: int
) -> None:
    assert chain.set(chain.loop.feedback, {'safe_voltage': -0.3}) == ''
    first, at = len(chain.commands), chain.voltage
    last = chain.tick - 1
    for _ in range(pause):
        chain.state()
    ramp = chain.commands[first:]
    samples = [k for k, _ in ramp]
    assert samples == list(range(last + TIMEOUT + 1, last + TIMEOUT + 1 + len(ramp)))
    steps = np.abs(np.diff([at, *(voltage for _, voltage in ramp)]))
    assert steps.max() <= RAMP * DT * (1 + 1e-9)
    assert chain.voltage == -0.3
    assert len(ramp) < pause - TIMEOUT  # then silent, so that the receiver may know
    assert chain.counts('stale') == [1, 1, 1]
    found = [link.health() for link in chain.links]
    # nobody publishes the reference any more; the later links are still fed by the one before
    assert sorted(each.level for each in found) == [Level.WARN, Level.WARN, Level.ERROR]
    assert all('ramped to safety' in each.message for each in found)
    chain.safe()
    for _ in range(6):
        chain.reference(chain.tick)
    chain.state()
    chain.run(200)
    assert max(voltage for _, voltage in chain.commands[-100:]) > 0.2
    assert all('ramped' not in link.health().message for link in chain.links)


def test_input_overtaken_by_the_ramp_is_not_reported(chain: Chain) -> None:
    late = chain.tick
    for _ in range(TIMEOUT + 5):
        chain.state()
    tick = chain.commands[-1][0]
    for k in range(late, chain.tick):
        chain.reference(k)
    assert chain.commands[-1][0] == tick
    assert chain.loop.feedback.all_counters()['late'] > 0
    chain.run(100)


def test_a_slow_lock_step_loop_triggers_no_watchdog(
    chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link_health, 'SILENCE', 0.0)
    for link in chain.links:
        link.health()
    assert all('has stopped' in link.health().message for link in chain.links)
    monkeypatch.undo()
    chain.run(1)
    assert chain.counts('stale') == [0, 0, 0]
    assert all(link.health().level == Level.OK for link in chain.links)


def test_the_energy_limit_slows_the_voltage_down_and_is_reported(chain: Chain) -> None:
    feedforward = chain.loop.feedforward
    limit = 2e-6
    assert chain.set(feedforward, {'energy_window': 0.05, 'energy_limit': limit}) == ''
    assert 'energy_window' in chain.set(feedforward, {'energy_window': 0.005})
    chain.run(300)
    health = feedforward.health()
    assert 'energy_limit' in health.message
    assert 0.5 * limit < float(str(health.values['mean_power_W'])) <= limit * (1 + 1e-9)
    assert feedforward.all_counters()['energy_limited'] > 50


def test_a_narrower_range_is_gone_to_at_the_slew(chain: Chain) -> None:
    while chain.voltage < 0.3:
        chain.step()
    limits = {'limits.low': -0.05, 'limits.high': 0.05, 'limits.slew': 10.0}
    before = chain.voltage
    for link in chain.links:
        assert chain.set(link, limits) == ''
    first = len(chain.commands)
    chain.run(100)
    path = [before, *(voltage for _, voltage in chain.commands[first:])]
    assert np.abs(np.diff(path)).max() <= 10.0 * DT * (1 + 1e-9)
    assert np.abs(path[-20:]).max() <= 0.05
    assert min(chain.counts('slew_limited')) > 0
