"""The four-process control loop against a ring of four bare relays, in one run.

    python bench/loop.py [--samples 8000] [--executor auto]

Both move one message per hop over DDS in lock-step with the same executor; the loop also computes
the plant, the inverse and the attenuation. Prints samples per second, their ratio, round-trip
percentiles and CPU per sample of the loop.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from piezo_hysteresis.models import ModelFile, named
from piezo_interfaces.msg import ActuatorState, VoltageCommand
from piezo_ros_common.processes import NodeProcesses
from piezo_ros_common.qos import LOOP
from piezo_ros_common.running import run_node

HOPS = 4
WARM_UP = 500


class Relay(Node):
    """Passes a number on; the first of the ring counts the rounds."""

    def __init__(self, place: int, rounds: int) -> None:
        super().__init__(f'relay_{place}')
        self.stop = Future()
        self._place = place
        self._rounds = rounds
        self._message = VoltageCommand()
        self._times: list[float] = []
        self._ring = self.create_publisher(VoltageCommand, f'ring_{(place + 1) % HOPS}', LOOP)
        self.create_subscription(VoltageCommand, f'ring_{place}', self._on_message, LOOP)
        if place == 0:
            self.create_timer(0.2, self._begin)

    def _begin(self) -> None:
        if len(self._times) < 2 and self._ring.get_subscription_count():
            self._message.sample = 0
            self._ring.publish(self._message)

    def _on_message(self, message: VoltageCommand) -> None:
        if self._place:
            self._ring.publish(message)
            return
        if message.sample != len(self._times):
            return
        self._times.append(time.perf_counter())
        if len(self._times) >= self._rounds:
            np.savetxt(sys.stdout, np.array(self._times))
            sys.stdout.flush()
            self.stop.set_result(True)
            return
        self._message.sample = len(self._times)
        self._ring.publish(self._message)


def ring(rounds: int, domain: int) -> np.ndarray:
    """Return the times of the rounds of a bare ring [s]."""
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    command = [sys.executable, __file__, '--relay']
    relays = [
        subprocess.Popen([*command, str(place), str(rounds)], env=environment)
        for place in range(1, HOPS)
    ]
    try:
        first = subprocess.run(
            [*command, '0', str(rounds)], env=environment, capture_output=True, check=True,
            text=True, timeout=300,
        )  # fmt: skip
    finally:
        for relay in relays:
            relay.terminate()
        for relay in relays:
            relay.wait()
    return np.array([float(line) for line in first.stdout.split()])


def loop(rounds: int, domain: int, folder: Path) -> tuple[np.ndarray, float]:
    """Return the times of the states of the real loop [s] and its CPU time per sample [s]."""
    model = named('bouc_wen_mode')
    file = folder / 'model.yaml'
    ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(file)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with NodeProcesses(domain) as processes:
        processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'wait_for': 3})
        processes.start('piezo_hysteresis', 'feedforward', {'model_file': str(file)})
        processes.start('piezo_hysteresis', 'attenuation', {'method': 'afc', 'orders': [0, 1, 3]})
        times = _watch(processes, rounds)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)
    return times, used / rounds


def _watch(processes: NodeProcesses, rounds: int) -> np.ndarray:
    """Start the excitation and note when each state arrives."""
    context = Context()
    rclpy.init(context=context, domain_id=processes.domain)
    node = Node('watch', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    times: list[float] = []
    node.create_subscription(
        ActuatorState, 'actuator/state', lambda _: times.append(time.perf_counter()), LOOP
    )
    processes.start(
        'piezo_hysteresis',
        'excitation',
        {'mode': 'reference', 'frequency': 23.0, 'duration': rounds / 1000.0, 'wait_for': 2},
    )
    while len(times) < rounds:
        executor.spin_once(timeout_sec=1.0)
        processes.check()
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)
    return np.array(times)


def report(name: str, times: np.ndarray) -> float:
    """Print rate and latency of one run; return samples per second."""
    steps = np.diff(times[WARM_UP:])
    rate = 1.0 / float(steps.mean())
    p50, p99, p999 = np.percentile(steps, [50, 99, 99.9]) * 1e6
    print(
        f'{name:12} {rate:8.0f} samples/s   p50 {p50:6.0f}  p99 {p99:6.0f}  p99.9 {p999:6.0f} us'
    )
    return rate


def main() -> int:
    """Run both in turn and print the ratio."""
    if '--relay' in sys.argv:
        place, rounds = int(sys.argv[-2]), int(sys.argv[-1])
        return run_node(lambda: Relay(place, rounds), [])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--samples', type=int, default=8000)
    parser.add_argument('--executor', default='auto', choices=('auto', 'events', 'default'))
    words = parser.parse_args()
    os.environ['PIEZO_EXECUTOR'] = words.executor
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    import tempfile

    domain = 1 + os.getpid() % 90
    with tempfile.TemporaryDirectory() as folder:
        loop(WARM_UP + 500, domain, Path(folder))  # kernels compiled and cached
        bare = report('bare ring', ring(words.samples, domain + 1))
        times, cpu = loop(words.samples, domain + 2, Path(folder))
        real = report('control loop', times)
    print(
        f'ratio {real / bare:.2f}; CPU per sample of the loop {1e6 * cpu:.0f} us (with start-up)'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
