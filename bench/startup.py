"""How long each node takes from its start to its first sample.

    python bench/startup.py [--repeat 3] [NODE ...]

For every node: the time until it publishes the first message that answers what this process says
to it (for what answers nothing: its first /diagnostics, or that it is there), and the CPU time it
has used by then, which says more on a machine that is busy. The first start of a node is not
counted: it compiles kernels and fills the caches.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from bench.quick import parsed
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, write_bag
from piezo_hysteresis.ros.client import Client
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_interfaces.msg import ActuatorState, Gap, ModelEstimate, Reference, VoltageCommand

# Executable: package, parameters, and the topic on which its first answer comes.
NODES: dict[str, tuple[str, dict[str, Any], type, str]] = {
    'simulator': ('piezo_sim', {'clock': 'lock_step'}, ActuatorState, 'actuator/state'),
    'excitation': ('piezo_hysteresis', {'mode': 'reference'}, Reference, 'reference'),
    'feedforward': ('piezo_hysteresis', {}, VoltageCommand, 'voltage/feedforward'),
    'attenuation': ('piezo_hysteresis', {'method': 'afc'}, VoltageCommand, 'voltage/command'),
    'feedback': ('piezo_hysteresis', {'method': 'pid'}, VoltageCommand, 'voltage/command'),
    'control_loop': ('piezo_hysteresis', {}, VoltageCommand, 'voltage/command'),
    'identification': ('piezo_hysteresis', {'publish_every': 1}, ModelEstimate, 'model/estimate'),
    'gap_monitor': ('piezo_hysteresis', {'window': 0.05}, Gap, 'gap'),
    'recorder': ('piezo_hysteresis', {}, DiagnosticArray, '/diagnostics'),
    'player': ('piezo_hysteresis', {'lock_step': False}, ActuatorState, '/piezo/actuator/state'),
}
WITH_MODEL = ('feedforward', 'control_loop', 'gap_monitor')


class Speaker(Client):
    """Publishes ticks until a response arrives."""

    def __init__(self, processes: NodeProcesses, kind: type, topic: str, name: str) -> None:
        super().__init__('speaker', processes.domain)
        self._answers: list[Any] = []
        qos = LATCHED if kind in (ModelEstimate, Gap) else LOOP
        self.node.create_subscription(kind, topic, self._answers.append, qos)
        inputs: dict[type, tuple[str, Callable[[int], Any]]] = {
            Reference: ('reference', lambda k: Reference(sample=k)),
            VoltageCommand: ('voltage/command', lambda k: VoltageCommand(sample=k)),
            ActuatorState: (
                'actuator/state',
                lambda k: ActuatorState(sample=k, voltage=1e-3 * k, displacement=1e-7 * k),
            ),
        }
        if name in ('attenuation', 'feedback'):
            inputs[VoltageCommand] = ('voltage/feedforward', inputs[VoltageCommand][1])
        self._says = [
            (self.node.create_publisher(kind_, name_, LOOP), make)
            for kind_, (name_, make) in inputs.items()
            if name_ != topic and name != 'player'
        ]

    def speak(self, timeout: float = 120.0) -> None:
        """Speak until the first answer."""
        end = time.monotonic() + timeout
        tick, spoken = 0, 0.0
        while not self._answers:
            if time.monotonic() > end:
                raise SystemExit('no answer came')
            heard = any(publisher.get_subscription_count() for publisher, _ in self._says)
            if heard and time.monotonic() > spoken + 0.002:
                spoken = time.monotonic()
                for publisher, make in self._says:
                    publisher.publish(make(tick))
                tick += 1
            self.spin_once(0.001)


def measure(name: str, folder: Path) -> tuple[float, float]:
    """Return wall time and CPU time from the start of a node to its first answer [s]."""
    package, settings, kind, topic = NODES[name]
    values = dict(settings)
    if name in WITH_MODEL:
        values['model_file'] = str(folder / 'model.yaml')
    if name == 'recorder':
        values['out'] = str(folder / f'bag_{time.monotonic_ns()}')
    if name == 'player':
        values['bag'] = str(folder / 'bag')
    with NodeProcesses() as processes:
        speaker = Speaker(processes, kind, topic, name)
        start = time.monotonic()
        node = processes.start(package, name, values)
        speaker.speak()
        taken = time.monotonic() - start
        fields = Path(f'/proc/{node.pid}/stat').read_text().rsplit(')', 1)[1].split()
        speaker.close()
    return taken, (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def main() -> int:
    """Measure every node and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('nodes', nargs='*', metavar='NODE', help=', '.join(NODES))
    parser.add_argument('--repeat', type=int, default=3)
    words = parsed(parser, nodes=['simulator', 'feedforward'], repeat=1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = named('classical')
        ModelFile(model, model.defaults()).save(folder / 'model.yaml')
        ramp = np.linspace(0.0, 0.5, 500)
        write_bag(folder / 'bag', [Record('r', 1e-3, ramp, 1e-4 * ramp)])
        for node in words.nodes or NODES:
            measure(node, folder)
            wall, cpu = zip(*(measure(node, folder) for _ in range(words.repeat)), strict=True)
            print(
                f'{node:15} {statistics.median(wall):6.2f} s to the first sample '
                f'({min(wall):.2f} at best), CPU {statistics.median(cpu):5.2f} s',
                flush=True,
            )
    return 0


if __name__ == '__main__':
    sys.exit(main())
