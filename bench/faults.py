"""A fault campaign over the live loop: every node dies and freezes, every message goes wrong.

    python bench/faults.py [--trials 100] [--seed 0] [--out out/faults.json] [--only NAME ...]

Eight processes run in real time: simulator, excitation, feedforward, attenuation, feedback,
identification, gap monitor, recorder. At random moments each node is killed (SIGKILL), ended
(SIGTERM, and SIGINT twice as `ros2 launch` does) and started again, or frozen (SIGSTOP, SIGCONT),
`--trials` times each; the simulator's own faults are injected, and a rogue publisher sends what is
not a number, doubled, reordered, stale or from another time. A twin of each link writes to the
same topics for a while. Nodes are started in a random order. `--rate`, `--clock lock_step` and
`--subscribers 20` make the loop another one. An observer measures whether the applied
voltage stayed within its limits and slew, the time until the node was received and the loop
tracked again, and whether a running recorder lost a published sample.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.faults_watch import Watch
from bench.live_loop import NODES, Crowd, Loop, Setting, end_on_terminate, wait_until
from bench.live_observer import Observer
from bench.quick import parsed
from bench.rogue import FAULTS, TARGETS, Rogue
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_interfaces.srv import InjectFault

# Signal, and after how many seconds it is sent again.
ENDINGS: dict[str, tuple[int, float | None]] = {
    'kill': (signal.SIGKILL, None),
    'terminate': (signal.SIGTERM, None),
    'interrupt': (signal.SIGINT, 0.05),
}
FREEZE = 'freeze'
TWIN = 'twin'
LINKS = ('excitation', 'feedforward', 'attenuation', 'feedback')
INJECTED = ('sensor_dropout', 'stuck_sensor', 'amplifier_trip')
MESSAGES = 20
TIMEOUT = 90.0


@dataclass
class Trial:
    """What one fault did."""

    target: str  # the node or topic
    fault: str  # what happened to it
    beyond: float = 0.0  # how far the applied voltage left its limits [V]
    jump: float = 0.0
    command_jump: float = 0.0
    received: float | None = None  # time from the restart until the node was received [s]
    back: float | None = None  # until the loop tracked again [s]
    code: int | None = None  # exit code of a node that was asked to end
    traceback: bool = False  # whether it printed one
    lost: int = 0  # samples that a recorder lost, its last unflushed moment after SIGKILL left out
    unflushed: float = 0.0  # that moment [s]

    @property
    def faults(self) -> list[str]:
        """Everything that is wrong with it; empty where all is as it should be."""
        found = {
            'limits': self.beyond > 0.0,
            'jump': self.jump > 1.0 + 1e-9,
            'not back': self.back is None,
            'not heard': self.received is None and self.target in NODES,
            f'code {self.code}': self.fault in ('terminate', 'interrupt') and self.code != 0,
            'traceback': self.traceback,
            f'{self.lost} lost': self.lost > 0,
        }
        return [words for words, wrong in found.items() if wrong]


@dataclass
class Campaign:
    """Runs trials one after the other on one loop."""

    loop: Loop  # what runs
    observer: Observer  # who listens
    rogue: Rogue  # who disturbs
    watch: Watch  # who judges
    random: np.random.Generator  # chooses every moment and length
    trials: list[Trial] = field(default_factory=list)  # what was done so far

    def run(self, target: str, fault: str) -> Trial:
        """Disturb the running loop once, at a random moment, and say what it did."""
        time.sleep(float(self.random.uniform(0.0, 1.0 / self.loop.setting.frequency)))
        trial = Trial(target, fault)
        first = self.watch.mark()
        if fault in ENDINGS:
            started = self._end_and_restart(trial)
        elif fault == FREEZE:
            started = self._freeze(target)
        elif fault == TWIN:
            started = self._doubled(target)
        elif fault in INJECTED:
            request = InjectFault.Request(fault=fault, duration=0.3)
            self.observer.call(InjectFault, 'simulator/inject_fault', request)
            started = time.monotonic() + 0.3
        else:
            self.rogue.talk(target, fault, MESSAGES)
            wait_until(lambda: self.rogue.silent(target), TIMEOUT)
            started = time.monotonic()
        trial.back, trial.received = self.watch.back(started, target, TIMEOUT)
        trial.beyond, trial.jump, trial.command_jump = self.watch.voltage(first)
        self.trials.append(trial)
        if target == 'recorder' and fault in ENDINGS:
            self.watch.discard(started - 1.0)  # no bag reaches further back
        if trial.back is None:
            words = {name: node.tail() for name, node in self.loop.running.items()}
            print(
                f'{target} {fault}: not back, {self.watch.state()}; last words: {words}',
                flush=True,
            )
            self._start_all_anew()
        return trial

    def _end_and_restart(self, trial: Trial) -> float:
        number, again = ENDINGS[trial.fault]
        asked = time.monotonic()
        trial.code, text = self.loop.end(trial.target, number, again)
        trial.traceback = 'Traceback' in text
        if trial.target == 'recorder':
            killed = number == signal.SIGKILL
            trial.lost, trial.unflushed = self.watch.lost(self.loop.bags[-1], asked, killed)
        # Immediately, or after the timeouts of the other nodes.
        time.sleep(float(self.random.choice([0.0, self.random.uniform(0.0, 1.0)])))
        self.loop.start(trial.target)
        return time.monotonic()

    def _freeze(self, target: str) -> float:
        node = self.loop.running[target]
        node.signal(signal.SIGSTOP)
        time.sleep(float(self.random.uniform(0.02, 1.0)))
        node.signal(signal.SIGCONT)
        return time.monotonic()

    def _doubled(self, target: str) -> float:
        """Let two nodes write to the topics of one for a second or two."""
        twin = self.loop.start_twin(target)
        time.sleep(float(self.random.uniform(2.0, 4.0)))  # it takes one to start
        self.loop.end_twin(twin)
        return time.monotonic()

    def _start_all_anew(self) -> None:
        for name in NODES:
            if name in self.loop.running:
                self.loop.end(name, signal.SIGKILL)
        self.begin()

    def begin(self) -> None:
        """Start every node and wait until the loop tracks."""
        started = time.monotonic()
        for name in self.random.permutation(list(NODES)):
            self.loop.start(str(name))
        if not self.watch.settle(started, 2.0 * TIMEOUT):
            silent = [n for n in NODES if self.observer.seen.received.get(n, 0.0) < started]
            raise SystemExit(f'the loop does not run; silent are: {", ".join(silent) or "none"}')


KINDS = (
    *((name, fault) for name in NODES for fault in (*ENDINGS, FREEZE)),
    *((name, TWIN) for name in LINKS),
    *(('simulator', fault) for fault in INJECTED),
    *((topic, fault) for topic in TARGETS for fault in FAULTS),
)


def plan(trials: int, seed: int, only: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Return targets and faults in a random order, `trials` times each."""
    everything = [kind for kind in KINDS if not only or not set(only).isdisjoint(kind)] * trials
    np.random.default_rng(seed).shuffle(everything)
    return [(str(target), str(fault)) for target, fault in everything]


def show(trials: Sequence[Trial]) -> None:
    """Print the table: one line per target and fault."""
    print(
        f'{"target":20}{"fault":16}{"n":>4}{"jump":>6}{"cmd":>6}{"received s (p50 max)":>19}'
        f'{"back s (p50 p95 max)":>22}{"lost":>5}  wrong'
    )
    groups: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        groups.setdefault((trial.target, trial.fault), []).append(trial)
    for (target, fault), group in sorted(groups.items()):
        received = np.array([t.received for t in group if t.received is not None] or [np.nan])
        back = np.array([t.back for t in group if t.back is not None] or [np.nan])
        p50, p95 = np.percentile(back, [50, 95])
        wrong = sorted({words for t in group for words in t.faults})
        count = sum(bool(t.faults) for t in group)
        print(
            f'{target:20}{fault:16}{len(group):>4}{max(t.jump for t in group):6.2f}'
            f'{max(t.command_jump for t in group):6.1f}'
            f'{np.median(received):12.2f}{received.max():7.2f}'
            f'{p50:9.2f}{p95:7.2f}{back.max():6.2f}{sum(t.lost for t in group):>5}'
            f'  {f"{count}: " + ", ".join(wrong) if wrong else "-"}'
        )


def main() -> int:
    """Run the campaign; the exit code states whether every trial succeeded."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--trials', type=int, default=100, help='of each fault on each target')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--most', type=int, help='trials of all')
    parser.add_argument('--minutes', type=float, default=1e9, help='end after so long')
    names = sorted({word for kind in KINDS for word in kind})
    parser.add_argument('--only', nargs='*', default=(), choices=names, metavar='TARGET|FAULT')
    parser.add_argument('--rate', type=float, default=Setting.rate, help='of the loop [Hz]')
    parser.add_argument('--clock', choices=('real_time', 'lock_step'), default=Setting.clock)
    parser.add_argument('--subscribers', type=int, default=0, help='more, of actuator/state')
    parser.add_argument('--out', type=Path, default=Path('out/faults.json'))
    words = parsed(parser, trials=1, most=4)
    end_on_terminate()
    end = time.monotonic() + 60.0 * words.minutes
    with (
        tempfile.TemporaryDirectory() as folder,
        NodeProcesses() as processes,
        contextlib.closing(Observer(processes)) as observer,
    ):
        crowd = Crowd(processes, words.subscribers)
        loop = Loop(processes, Path(folder), Setting(rate=words.rate, clock=words.clock))
        watch = Watch(observer.seen, loop.setting)
        random = np.random.default_rng(words.seed)
        campaign = Campaign(loop, observer, Rogue(observer), watch, random)
        campaign.begin()
        wanted = plan(words.trials, words.seed, words.only)[: words.most]
        for target, fault in wanted:
            trial = campaign.run(target, fault)
            if trial.faults:
                print(f'{target} {fault}: {", ".join(trial.faults)}', flush=True)
            if sys.stderr.isatty():
                print(f'\r{len(campaign.trials)} of {len(wanted)}', end='', file=sys.stderr)
            if time.monotonic() > end:
                break
        crowd.close()
    show(campaign.trials)
    wrong = [trial for trial in campaign.trials if trial.faults]
    print(f'{len(campaign.trials)} trials, {len(wrong)} went wrong; load {os.getloadavg()[0]:.1f}')
    words.out.parent.mkdir(parents=True, exist_ok=True)
    words.out.write_text(json.dumps([asdict(t) for t in campaign.trials], indent=1) + '\n')
    return 1 if wrong and not words.quick else 0


if __name__ == '__main__':
    sys.exit(main())
