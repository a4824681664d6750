"""The control loop in real time at 1 kHz for minutes: lost, late, latency, CPU.

    python bench/real_time.py [--minutes 2] [--rate 1000] [--together] [--yardstick 30]

Simulator, excitation, feedforward and attenuation run as processes; with `--together` all but the
simulator run in one, `control_loop`. A tick is late where its command was not there when the
actuator took the tick: after the time of the next tick, in terms of the state that it answers. A
sample is lost where no command for it ever came, or an observer that is connected for all of the
run did not receive it; commands that a link gave up because its watchdog had stepped in are
counted apart. Latency is the time from the state to the command that answers it, by the stamps of
the middleware at the two writers, on one machine. CPU time is that of the processes.

What the machine allows is measured in the same run: how often a bare loop that only sleeps until
the next tick wakes more than a period late, and how often a tick that bare relays pass around, as
many as the loop has processes, is not back within a period.
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bench.live_loop import end_on_terminate
from bench.loop import paced_ring
from bench.quick import parsed
from piezo_hysteresis.common import topics
from piezo_hysteresis.common.registry import inside
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.running import prepare
from piezo_interfaces.msg import ActuatorState, LoopStatus, VoltageCommand

Message = TypeVar('Message')

SETTLE = 3.0
TICKS_PER_SECOND = os.sysconf('SC_CLK_TCK')
SEPARATE = ('excitation', 'feedforward', 'attenuation')
TOGETHER = ('control_loop',)
# Time between two lines while it runs [s].
SAYS_EVERY = 15.0


@dataclass(frozen=True)
class Figures:
    """What a run showed."""

    seconds: float  # length of the run
    samples: int  # ticks of the actuator in it
    lost: int  # samples without a command, or that the observer did not receive
    given_up: int  # commands that came so late that the watchdog of a link had answered for them
    late: int  # samples whose command came too late
    late_percent: float  # of all samples
    overruns: int  # ticks that the actuator itself took late, because it was not scheduled in time
    p50: float  # [us]
    p99: float  # [us]
    p999: float  # [us]
    cpu: float  # CPU time of all processes per sample [us]
    load: float  # load of the machine during the run, without this loop where it was idle before
    sleeper_percent: float = math.nan
    ring_percent: float = math.nan  # ticks that bare relays did not bring around within a period


class Stopwatch(Node):
    """Notes when states and commands were written; drained now and then, never spun."""

    def __init__(self) -> None:
        super().__init__('stopwatch')
        self.states: dict[int, int] = {}
        self.commands: dict[int, int] = {}
        self.counts: dict[str, int] = {}
        self.given_up = dict.fromkeys(('feedforward', 'attenuation'), 0)
        self._inlets: list[tuple[Subscription, Callable[[Any, int], None]]] = []
        self._listen(ActuatorState, topics.STATE, LOOP, self._on_state)
        self._listen(VoltageCommand, topics.VOLTAGE_COMMAND, LOOP, self._on_command)
        self._listen(LoopStatus, topics.LOOP_STATUS, LATCHED, self._on_status)
        for name in self.given_up:
            note = functools.partial(self._on_link, name)
            self._listen(LoopStatus, f'{name}/status', LATCHED, note)

    def _listen(
        self,
        kind: type[Message],
        topic: str,
        qos: QoSProfile,
        note: Callable[[Message, int], None],
    ) -> None:
        self._inlets.append((self.create_subscription(kind, topic, _unused, qos), note))

    def tally(self) -> dict[str, int]:
        """Return what actuator and links have counted so far."""
        return {**self.counts, 'given_up': sum(self.given_up.values())}

    def drain(self) -> None:
        """Take in what has come."""
        for subscription, note in self._inlets:
            with subscription.handle:
                while got := subscription.handle.take_message(subscription.msg_type, False):
                    message, info = got
                    note(message, info['source_timestamp'])

    def _on_state(self, message: ActuatorState, written: int) -> None:
        self.states[message.sample] = written

    def _on_command(self, message: VoltageCommand, written: int) -> None:
        self.commands.setdefault(message.sample, written)

    def _on_status(self, message: LoopStatus, _: int) -> None:
        more = dict(zip(message.names, message.counts, strict=True))
        self.counts = {'late': message.late, 'missed': message.missed, **more}

    def _on_link(self, name: str, message: LoopStatus, _: int) -> None:
        self.given_up[name] = message.late


def _unused(_: object) -> None:
    """Never called: the messages are taken from the queue."""


def cpu_seconds(pids: list[int]) -> float:
    """Return the CPU time that processes have used so far [s]."""
    total = 0
    for pid in pids:
        words = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
        total += int(words[11]) + int(words[12])
    return total / TICKS_PER_SECOND


def run(seconds: float, rate: float, together: bool, folder: Path) -> Figures:
    """Run the loop in real time for so long."""
    model = named('bouc_wen_mode')
    file = folder / 'model.yaml'
    ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(file)
    reference = {'mode': 'reference', 'frequency': 10.0, 'reference.amplitude': 8e-5}
    own: dict[str, dict[str, object]] = {
        'excitation': {**reference, 'deadline': 60.0},
        'feedforward': {'model_file': str(file)},
        'attenuation': {'method': 'afc', 'orders': [0, 1, 3]},
    }
    own['control_loop'] = inside({node: own[node] for node in SEPARATE})
    with NodeProcesses() as processes:
        os.environ['ROS_DOMAIN_ID'] = str(processes.domain)
        prepare()
        rclpy.init()
        watch = Stopwatch()
        processes.start('piezo_sim', 'simulator', {'rate': rate})
        for name in TOGETHER if together else SEPARATE:
            processes.start('piezo_hysteresis', name, {'rate': rate, **own[name]})
        serve = functools.partial(_serve, watch, processes)
        serve(60.0, lambda: bool(watch.commands))
        serve(SETTLE)
        first = max(watch.states) + 1
        before = watch.tally()
        pids = [node.pid for node in processes.nodes]
        cpu, started = cpu_seconds(pids), time.monotonic()
        while (left := started + seconds - time.monotonic()) > 0.0:
            serve(min(left, SAYS_EVERY))
            so_far = watch.tally()['late'] - before['late']
            passed, ticks = time.monotonic() - started, max(watch.states) - first
            print(f'{passed:.0f} s: {ticks} ticks, {so_far} late', flush=True)
        cpu, took = cpu_seconds(pids) - cpu, time.monotonic() - started
        last = max(watch.states)
        serve(1.5)  # the counters, and what is under way
        after = watch.tally()
        watch.destroy_node()
        rclpy.shutdown()
    grown = {name: after[name] - before.get(name, 0) for name in after}
    return figures(watch, range(first, last + 1), grown, cpu, took)


def _serve(
    watch: Stopwatch,
    processes: NodeProcesses,
    seconds: float,
    condition: Callable[[], bool] = lambda: False,
) -> None:
    """Listen for so long, or until `condition` holds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and not condition():
        time.sleep(0.05)
        watch.drain()
        processes.check()


def bare_sleeper(seconds: float, rate: float) -> float:
    """Return how many wake-ups of a loop that does nothing are a period late [%]."""
    late, ticks = 0, round(seconds * rate)
    started = time.monotonic()
    for k in range(ticks):
        time.sleep(max(0.0, started + k / rate - time.monotonic()))
        late += time.monotonic() > started + (k + 1) / rate
    return 100.0 * late / ticks


def bare_ring(seconds: float, rate: float, hops: int) -> float:
    """Return how many ticks bare relays do not bring around within a period [%]."""
    trips = paced_ring(hops, round(seconds * rate), rate)
    return 100.0 * float(np.mean(~(trips <= 1.0 / rate)))


def figures(
    watch: Stopwatch, ticks: range, grown: dict[str, int], cpu: float, took: float
) -> Figures:
    """Sum a run up over the samples `ticks`."""
    states, commands = watch.states, watch.commands
    answered = [k for k in ticks if k in commands and k - 1 in states]
    unseen = sum(1 for k in ticks if k not in states or k not in commands)
    latency = np.array([commands[k] - states[k - 1] for k in answered]) / 1e3
    p50, p99, p999 = (float(p) for p in np.percentile(latency, [50, 99, 99.9]))
    n = len(ticks)
    late, given_up = grown['late'], grown['given_up']
    return Figures(
        took, n, max(0, unseen - given_up), given_up, late, 100.0 * late / n, grown['overruns'],
        p50, p99, p999, 1e6 * cpu / n, os.getloadavg()[1],
    )  # fmt: skip


def main() -> int:
    """Run it and print the figures; the exit code states whether the goals are reached."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=2.0)
    parser.add_argument('--yardstick', type=float, default=30.0, help='of what is bare [s]')
    parser.add_argument('--rate', type=float, default=1000.0, help='sampling rate [Hz]')
    parser.add_argument(
        '--together', action='store_true', help='all but the actuator in one process'
    )
    parser.add_argument('--out', type=Path, default=Path('out/real_time.json'))
    words = parsed(parser, minutes=0.05, yardstick=1.0)
    end_on_terminate()
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        found = run(60.0 * words.minutes, words.rate, words.together, Path(folder))
    found = replace(
        found,
        sleeper_percent=bare_sleeper(words.yardstick, words.rate),
        ring_percent=bare_ring(
            words.yardstick, words.rate, 1 + len(TOGETHER if words.together else SEPARATE)
        ),
    )
    print(
        f'{found.samples} samples in {found.seconds:.1f} s at {words.rate:g} Hz: {found.lost} '
        f'lost, {found.given_up} given up, {found.late} late ({found.late_percent:.3f} %), '
        f'{found.overruns} overruns\n'
        f'latency p50 {found.p50:.0f}  p99 {found.p99:.0f}  p99.9 {found.p999:.0f} us; '
        f'CPU {found.cpu:.0f} us per sample; load {before:.1f} before, {found.load:.1f} at '
        'the end\n'
        f'on this machine a bare sleeping loop is a period late {found.sleeper_percent:.3f} % of '
        f'the time, a ring of bare relays {found.ring_percent:.3f} %'
    )
    words.out.parent.mkdir(parents=True, exist_ok=True)
    words.out.write_text(json.dumps(asdict(found), indent=2) + '\n')
    return 0 if words.quick or (found.lost == 0 and found.late_percent <= 0.1) else 1


if __name__ == '__main__':
    sys.exit(main())
