"""Every node reports its status on /diagnostics each second, and faults immediately."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, Reference, VoltageCommand
from piezo_interfaces.srv import InjectFault

pytestmark = pytest.mark.ros

DT = 1e-3
LINKS = ('feedforward', 'attenuation', 'feedback')
LINK = {
    'limits.low': -1.2,
    'limits.high': 1.2,
    'limits.slew': 1000.0,
    'attenuation:method': 'afc',
    'attenuation:orders': [0, 1],
    'feedback:method': 'pid',
    'feedback:pid.integral': 5e3,
}


class Bench:
    """Simulates the actuator and the excitation, with arbitrary messages tick by tick."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.listener = listener
        node = listener.node
        self.commands = listener.listen(VoltageCommand, 'voltage/command')
        self.latest: dict[str, DiagnosticStatus] = {}
        self.counts: dict[str, int] = {}
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_status, 100)
        self.references = node.create_publisher(Reference, 'reference', LOOP)
        self.states = node.create_publisher(ActuatorState, 'actuator/state', LOOP)
        model = named('classical')
        file = folder / 'model.yaml'
        ModelFile(model, model.defaults()).save(file)
        processes.start('piezo_hysteresis', 'control_loop', {**LINK, 'model_file': str(file)})
        processes.start('piezo_hysteresis', 'identification')
        processes.start('piezo_hysteresis', 'gap_monitor', {'model_file': str(file)})
        processes.start('piezo_hysteresis', 'recorder', {'out': str(folder / 'bag')})
        processes.start('piezo_sim', 'simulator', {'clock': 'lock_step'}, namespace='elsewhere')
        self.tick = 0
        listener.until(lambda: self.references.get_subscription_count() == 2)
        listener.until(lambda: self.states.get_subscription_count() == 4)
        self.run(100)

    def _on_status(self, array: DiagnosticArray) -> None:
        for status in array.status:
            name = status.name.strip('/')
            self.latest[name] = status
            self.counts[name] = self.counts.get(name, 0) + 1

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.step()

    def step(self, displacement: float = math.inf) -> None:
        """Go one tick on; every link waits for it."""
        k = self.tick
        if math.isinf(displacement):
            displacement = 5e-5 * math.sin(2 * math.pi * 10.0 * k * DT)
        answered = False
        while not answered:  # an excitation repeats its last word, too
            self.references.publish(self.point(k, displacement))
            self.listener.wait_briefly(lambda: self._answered(k), 0.3)
            answered = self._answered(k)
        self.answer()

    def _answered(self, sample: int) -> bool:
        return bool(self.commands) and self.commands[-1].sample == sample

    @staticmethod
    def point(sample: int, displacement: float) -> Reference:
        phase = 2 * math.pi * 10.0 * sample * DT
        return Reference(sample=sample, displacement=displacement, frequency=10.0, phase=phase)

    def answer(self, displacement: float = math.nan) -> None:
        """Be the actuator: a state for this tick."""
        voltage = self.commands[-1].voltage
        value = 1.2e-4 * voltage if math.isnan(displacement) else displacement
        self.states.publish(ActuatorState(sample=self.tick, voltage=voltage, displacement=value))
        self.tick += 1

    def says(self, node: str, level: bytes, word: str) -> DiagnosticStatus:
        """Wait until `node` reports `level` with `word` in its sentence."""

        def said() -> bool:
            self.step()
            latest = self.latest.get(node)
            return latest is not None and latest.level == level and word in latest.message

        self.listener.until(said)
        return self.latest[node]

    def count(self, node: str, key: str) -> int:
        values = {each.key: each.value for each in self.latest[node].values}
        return int(values[key])

    def counted(self, node: str, key: str, count: int) -> None:
        """Wait until `node` reports that it has counted `count`."""
        self.listener.until(lambda: self.count(node, key) == count, 20.0)


@pytest.fixture(scope='module')
def bench(
    shared_processes: LiveNodes,
    shared_listener: Listener,
    tmp_path_factory: pytest.TempPathFactory,
) -> Bench:
    return Bench(shared_processes, shared_listener, tmp_path_factory.mktemp('faults'))


OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def test_every_node_reports_ok_each_second(bench: Bench) -> None:
    for node, word in {
        'feedforward': 'corrects the voltage',
        'attenuation': 'corrects the voltage',
        'feedback': 'corrects the voltage',
        'identification': 'samples are used',
        'recorder': 'messages are in',
        'elsewhere/simulator': 'waits for the first command',
    }.items():
        bench.listener.until(lambda node=node: node in bench.latest)
        bench.says(node, OK, word)
    assert bench.latest['elsewhere/simulator'].hardware_id == 'elsewhere'
    bench.listener.until(lambda: 'gap_monitor' in bench.latest)
    before = dict(bench.counts)
    bench.listener.until(lambda: all(bench.counts[n] >= before[n] + 2 for n in before))


def test_values_that_are_not_finite_are_held_and_reported(bench: Bench) -> None:
    for wrong in (math.nan, -math.inf):
        k = bench.tick
        if math.isnan(wrong):
            bench.step(wrong)
        else:
            bench.references.publish(bench.point(k, wrong))
            bench.listener.until(lambda k=k: bench.commands[-1].sample == k)
            bench.answer()
        bench.run(10)
    for node in LINKS:
        bench.says(node, ERROR, 'reference is not a number')
        bench.counted(node, 'refused_references', 2)

    bench.references.publish(bench.point(bench.tick, 0.0))
    bench.listener.until(lambda: bench.commands[-1].sample == bench.tick)
    bench.answer(displacement=math.inf)
    bench.run(10)
    bench.says('identification', WARN, 'not numbers')
    bench.counted('identification', 'refused', 1)
    bench.says('gap_monitor', WARN, 'not a number')
    bench.says('feedback', ERROR, 'reference')
    bench.counted('feedback', 'measured_not_finite', 1)


def test_a_fault_of_the_actuator_is_reported(bench: Bench) -> None:
    request = InjectFault.Request(fault='stuck_sensor', duration=0.0)
    assert bench.listener.call(InjectFault, 'elsewhere/simulator/inject_fault', request).success
    bench.says('elsewhere/simulator', ERROR, 'stuck_sensor')


def test_a_loop_that_begins_anew_is_followed(bench: Bench) -> None:
    bench.tick = 0
    bench.run(50)
    assert bench.commands[-1].sample == 49
