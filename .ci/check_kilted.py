"""One message round of the nodes of this release: a reference becomes a voltage, then a state."""

from __future__ import annotations

import importlib
import sys
import time
from importlib.metadata import version
from pathlib import Path

from piezo_hysteresis.common.registry import NODES
from piezo_hysteresis.ros.client import Client
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import profiles
from piezo_interfaces.msg import ActuatorState, Reference

GAIN, DISPLACEMENT = 1e-4, 2e-5  # m/V, m
SECONDS = 60.0
OPTIONAL = {'dashboard'}  # needs tornado


def main() -> int:
    """Import every node, start two, and print what came back."""
    for name in sorted(NODES.keys() - OPTIONAL):
        importlib.import_module(NODES[name])
    assert Path(profiles()).name == 'fastdds3.xml', 'Kilted has Fast DDS 3'
    states: list[ActuatorState] = []
    with NodeProcesses() as processes:
        processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'wait_for': 2})
        processes.start(
            'piezo_hysteresis', 'feedforward', {'gain': GAIN},
            remap={'voltage/feedforward': 'voltage/command'},
        )  # fmt: skip
        with Client('kilted', processes.domain) as client:
            client.node.create_subscription(ActuatorState, 'actuator/state', states.append, LOOP)
            references = client.node.create_publisher(Reference, 'reference', LOOP)
            end = time.monotonic() + SECONDS
            while not states and time.monotonic() < end:
                references.publish(Reference(sample=0, displacement=DISPLACEMENT))
                client.wait(lambda: bool(states), 0.5, processes.check)
    if not states:
        print(f'error: no state within {SECONDS:g} s', file=sys.stderr)
        return 1
    voltage = states[0].voltage
    print(f'rclpy {version("rclpy")}: {1e6 * DISPLACEMENT:g} um became {voltage:g} V')
    return int(abs(voltage - DISPLACEMENT / GAIN) > 1e-9)


if __name__ == '__main__':
    sys.exit(main())
