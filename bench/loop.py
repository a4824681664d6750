"""The control loop, as four processes and as two, against rings of bare relays, in one run.

Two axes in one `control_loop`, with decoupling and attenuation of both, are compared with one.

    python bench/loop.py [--samples 8000] [--executor auto]

A ring has as many processes as the loop it is compared with and moves one message per hop over DDS
in lock-step with the same executor; the loop also computes the plant, the inverse and the
attenuation. Prints percentiles of the round trip, their ratios, and the CPU time per sample of all
processes once they run. A mean would be decided by a few stalls of the machine.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from rclpy.node import Node
from rclpy.task import Future

from bench.quick import parsed
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.common.registry import inside
from piezo_hysteresis.compensation.link import Measured
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.nodes.excitation.excitation import Excitation
from piezo_hysteresis.nodes.links.control_loop import ControlLoop
from piezo_hysteresis.nodes.links.coupled_loop import CoupledControlLoop
from piezo_hysteresis.ros.processes import NodeProcesses, ros_arguments
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.ros.running import run_node, run_nodes
from piezo_interfaces.msg import VoltageCommand

WARM_UP = 500
# Reference of the loop: [Hz], [m], seconds over which it is eased in; and the seed of the plant.
FREQUENCY, AMPLITUDE, EASED, SEED = 23.0, 5e-5, 1.0, 7
# Sampling rate of two axes [Hz]; in lock-step it is no speed.
RATE = 10_000.0


# Links of the loop with their parameters.
LINKS: dict[str, dict[str, Any]] = {
    'feedforward': {},
    'attenuation': {'method': 'afc', 'orders': [0, 1, 3]},
}


class Clocked:
    """Records each round; reports the end of the warm-up and the result to the parent."""

    def __init__(self, rounds: int, stop: Future) -> None:
        self._rounds, self._stop = rounds, stop
        self.times: list[float] = []
        self._errors: list[float] = []

    def tick(self, error: float = 0.0) -> None:
        """One round is over, and the loop tracked with this error [m]."""
        self.times.append(time.perf_counter())
        self._errors.append(error)
        if len(self.times) == WARM_UP:
            print('warm', flush=True)
        elif len(self.times) == self._rounds:
            print('done', flush=True)
            sys.stdin.readline()  # until the parent has read the clocks
            np.savetxt(sys.stdout, np.column_stack([self.times, self._errors]))
            sys.stdout.flush()
            self._stop.set_result(True)


class Relay(Node):
    """Passes a number on; the first of the ring counts the rounds."""

    def __init__(self, place: int, hops: int, rounds: int) -> None:
        super().__init__(f'relay_{place}')
        self.stop = Future()
        self._place = place
        self._message = VoltageCommand()
        self._clocked = Clocked(rounds, self.stop)
        self._ring = self.create_publisher(VoltageCommand, f'ring_{(place + 1) % hops}', LOOP)
        self.create_subscription(VoltageCommand, f'ring_{place}', self._on_message, LOOP)
        if place == 0:
            self.create_timer(0.2, self._begin)

    def _begin(self) -> None:
        if len(self._clocked.times) < 2 and self._ring.get_subscription_count():
            self._message.sample = 0
            self._ring.publish(self._message)

    def _on_message(self, message: VoltageCommand) -> None:
        if self._place:
            self._ring.publish(message)
        elif message.sample == len(self._clocked.times):
            self._clocked.tick()
            if not self.stop.done():
                self._message.sample = len(self._clocked.times)
                self._ring.publish(self._message)


class Pacer(Node):
    """Sends a tick around the ring at every period, and notes how long each was under way."""

    def __init__(self, hops: int, ticks: int, rate: float) -> None:
        super().__init__('relay_0')
        self.stop = Future()
        self._message = VoltageCommand()
        self._sent: list[float] = []
        self._trips = np.full(ticks, np.nan)
        self._end = time.monotonic() + 60.0 + 2 * ticks / rate
        self._ring = self.create_publisher(VoltageCommand, f'ring_{1 % hops}', LOOP)
        self.create_subscription(VoltageCommand, 'ring_0', self._on_message, LOOP)
        self.create_timer(1.0 / rate, self._tick)

    def _tick(self) -> None:
        if self.stop.done():
            return  # the timer may fire once more before the executor stops
        # The first tick goes around until it comes back: by then all relays are there.
        if self._sent and np.isnan(self._trips[0]):
            self._sent.clear()
        self._message.sample = len(self._sent)
        self._sent.append(time.monotonic())
        self._ring.publish(self._message)
        if len(self._sent) == self._trips.size or time.monotonic() > self._end:
            np.savetxt(sys.stdout, self._trips)
            sys.stdout.flush()
            self.stop.set_result(True)

    def _on_message(self, message: VoltageCommand) -> None:
        if message.sample < len(self._sent) and np.isnan(self._trips[message.sample]):
            self._trips[message.sample] = time.monotonic() - self._sent[message.sample]


class ClockedExcitation(Excitation):
    """The excitation of the loop, which notes when each state arrives and how far off it is."""

    def __init__(self, rounds: int, *, wired: bool = True, axis: int = 0) -> None:
        super().__init__(wired=wired, axis=axis)
        self._clocked = Clocked(rounds, self.stop)

    def take_state(self, head: bytes, measured: Measured, payload: bytes) -> None:
        """Note the round, and respond."""
        experiment = self._experiment
        wanted = experiment.point(measured.sample).displacement if experiment else math.nan
        self._clocked.tick(measured.displacement - wanted)
        if not self.stop.done():
            super().take_state(head, measured, payload)


@contextmanager
def relays(hops: int, rounds: int, environment: dict[str, str]) -> Iterator[list[int]]:
    """Run all relays but the first; yield their process numbers."""
    command = [sys.executable, __file__, '--relay']
    running = [
        subprocess.Popen([*command, str(place), str(hops), str(rounds)], env=environment)
        for place in range(1, hops)
    ]
    try:
        yield [process.pid for process in running]
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait()


class Run(NamedTuple):
    """What a ring or a loop did."""

    times: FloatArray  # when each round was over [s]
    errors: FloatArray  # measured minus desired displacement of each [m]; 0 in a ring
    cpu: float  # CPU time of all processes per round [s]


def clock(command: Sequence[str], environment: dict[str, str], others: Sequence[int]) -> Run:
    """Run the process that counts the rounds."""
    with subprocess.Popen(
        [sys.executable, __file__, *command],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as first:
        assert first.stdin is not None
        assert first.stdout is not None
        pids = [first.pid, *others]
        used: dict[str, float] = {}
        for line in first.stdout:
            used[line.strip()] = sum(_cpu(pid) for pid in pids)
            if 'done' in used:
                break
        if 'done' not in used:
            raise SystemExit(f'{" ".join(command)} ended early')
        first.stdin.write('\n')
        first.stdin.flush()
        times, errors = np.loadtxt(first.stdout).T
    return Run(times, errors, (used['done'] - used['warm']) / (len(times) - WARM_UP))


def _cpu(pid: int) -> float:
    """Return the CPU time of a process so far [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def ring(hops: int, rounds: int) -> Run:
    """Run a bare ring."""
    with NodeProcesses() as group:
        environment = dict(group.environment)
        with relays(hops, rounds, environment) as others:
            return clock(['--relay', '0', str(hops), str(rounds)], environment, others)


def paced_ring(hops: int, ticks: int, rate: float) -> Any:
    """Return how long each of `ticks` was on its way around bare relays [s]; NaN: never back."""
    with NodeProcesses() as group:
        environment = dict(group.environment)
        with relays(hops, ticks, environment):
            command = [sys.executable, __file__, '--pacer', str(hops), str(ticks), str(rate)]
            done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f'the ring failed: {done.stderr}')
    return np.array([float(line) for line in done.stdout.split()])


def loop(
    links: dict[str, dict[str, Any]], rounds: int, model: Path, *, together: bool = False
) -> Run:
    """Run the real loop: `links` as processes, or `together` with the excitation in one."""
    readers = 1 if together else 2
    with NodeProcesses() as group:
        simulated = {'clock': 'lock_step', 'wait_for': readers, 'seed': SEED}
        started = [group.start('piezo_sim', 'simulator', simulated)]
        settings: dict[str, dict[str, Any]] = {
            **links,
            'feedforward': {'model_file': str(model), **links.get('feedforward', {})},
            'excitation': {
                'mode': 'reference', 'frequency': FREQUENCY, 'reference.amplitude': AMPLITUDE,
                'ramp': EASED, 'wait_for': readers, 'deadline': 600.0,
            },
        }  # fmt: skip
        own = settings['excitation']
        if together:
            own = inside(settings)
        else:
            started += [group.start('piezo_hysteresis', name, settings[name]) for name in links]
        kind = '--control-loop' if together else '--excitation'
        command = [kind, str(rounds), *ros_arguments(own)]
        return clock(command, dict(group.environment), [node.pid for node in started])


def scanner() -> ModalModel:
    """Return a model of two axes with what one of a stage has: three modes, plays, powers."""
    layout = ModalLayout(2, 2, 3, voltage_plays=(0.4, 3.0, 10.0, 30.0), powers=(2, 3))
    vector = layout.zeros()
    found = layout.named(vector)
    found['log_omega'][:] = np.log(2.0 * np.pi * np.array([240.0, 620.0, 930.0]))
    found['log_damping'][:] = np.log([0.03, 0.02, 0.01])
    found['shape'][...] = [[0.0, 1.0, 0.03], [1.0, 0.0, -0.03]]
    found['voltage_weights'][:4] = 0.1
    output = np.zeros((len(layout.signal_names), 2))
    output[:3] = 1e-7 * np.array([[0.03, 1.3], [1.5, -0.03], [1.3, 1.3]])
    return ModalModel(layout, vector, output, 10.0, 1.0 / RATE)


def two_axes(rounds: int, model: Path) -> Run:
    """Run the loop of two axes: excitations, laws and limits of both in one process."""
    with NodeProcesses() as group:
        simulated = {
            'preset': 'xy_scanner', 'clock': 'lock_step', 'wait_for': 1, 'seed': SEED, 'rate': RATE
        }  # fmt: skip
        started = group.start('piezo_sim', 'simulator', simulated)
        own: dict[str, Any] = {'rate': RATE, 'coupled:model_file': str(model)}
        for axis in (1, 2):
            own |= inside({
                f'voltage_{axis}': {
                    'limits.low': -50.0, 'limits.high': 50.0, 'limits.slew': 1e6
                },
                f'excitation_{axis}': {
                    'mode': 'reference', 'frequency': FREQUENCY + axis, 'ramp': EASED,
                    'reference.amplitude': 2e-6, 'deadline': 600.0,
                },
            })  # fmt: skip
        command = ['--two-axes', str(rounds), *ros_arguments(own)]
        return clock(command, dict(group.environment), [started.pid])


def coupled_nodes(rounds: int) -> tuple[Node, ...]:
    """Return the nodes of the loop of two axes, of which the first excitation is clocked."""

    def excitation(axis: int) -> Excitation:
        if axis == 1:
            return ClockedExcitation(rounds, wired=False, axis=axis)
        return Excitation(wired=False, axis=axis)

    loop = CoupledControlLoop(excitation)
    loop.excitations[0].stop.add_done_callback(lambda _: loop.coupled.stop.set_result(True))
    return loop.nodes


def report(name: str, measured: Run) -> tuple[float, float]:
    """Print latency and CPU of one run; return median and 99th percentile of a round trip [us]."""
    steps, cpu = np.diff(measured.times[WARM_UP:]), measured.cpu
    p50, p99, p999 = (float(p) for p in np.percentile(steps, [50, 99, 99.9]) * 1e6)
    print(
        f'{name:34} round trip p50 {p50:6.0f}  p99 {p99:6.0f}  p99.9 {p999:6.0f} us'
        f'   CPU {1e6 * cpu:5.0f} us/sample',
        flush=True,
    )
    return p50, p99


def main() -> int:
    """Run all in turn and print the ratios."""
    if '--relay' in sys.argv:
        place, hops, rounds = (int(word) for word in sys.argv[-3:])
        return run_node(lambda: Relay(place, hops, rounds), [])
    if '--pacer' in sys.argv:
        hops, ticks = (int(word) for word in sys.argv[-3:-1])
        return run_node(lambda: Pacer(hops, ticks, float(sys.argv[-1])), [])
    if '--excitation' in sys.argv:
        rounds = int(sys.argv[2])
        return run_node(lambda: ClockedExcitation(rounds), sys.argv[3:])
    if '--two-axes' in sys.argv:
        return run_nodes(lambda: coupled_nodes(int(sys.argv[2])), sys.argv[3:])
    if '--control-loop' in sys.argv:
        rounds = int(sys.argv[2])
        return run_nodes(
            lambda: ControlLoop(lambda: ClockedExcitation(rounds, wired=False)).nodes, sys.argv[3:]
        )
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--samples', type=int, default=8000)
    parser.add_argument('--executor', default='auto', choices=('auto', 'events', 'default'))
    words = parsed(parser, samples=WARM_UP + 200)
    os.environ['PIEZO_EXECUTOR'] = words.executor
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'model.yaml'
        model = named('bouc_wen_mode')
        ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(file)
        bare = {
            hops: report(f'ring of {hops} relays', ring(hops, words.samples)) for hops in (4, 3)
        }
        four = report('loop of four processes', loop(LINKS, words.samples, file))
        two = report('simulator and control_loop', loop(LINKS, words.samples, file, together=True))
        several = Path(folder) / 'scanner.yaml'
        scanner().save(several)
        both = report('the same of two axes', two_axes(words.samples, several))
    for name, real, other in (
        ('four processes / ring of four', four, bare[4]),
        ('control_loop / ring of three', two, bare[3]),
        ('control_loop / four processes', two, four),
    ):
        print(
            f'{name:34} {real[0] / other[0]:.2f} of its median round trip, '
            f'{real[1] / other[1]:.2f} of its 99 %'
        )
    print(f'two axes / one axis: {two[0] / both[0]:.2f} of its samples per second (median)')
    return 0


if __name__ == '__main__':
    sys.exit(main())
