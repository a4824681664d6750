"""What the page starts: a sweep, a discovery or an investigation, each a verb as child process."""

from __future__ import annotations

import json
import math
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from rclpy.action import get_action_names_and_types
from rclpy.node import Node

from piezo_hysteresis.dashboard.backend import DiscoveryOrder, InvestigationOrder, SweepOrder
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState, Live
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.investigation import FOUND, JOURNAL, SUMMARY
from piezo_hysteresis.models import NAMES
from piezo_hysteresis.nodes.messages import inside

SWEEPS, DISCOVERIES, INVESTIGATIONS = 'sweeps', 'discoveries', 'investigations'
ENDED_WITHIN = 20.0  # time in which a cancelled verb ends, with the actuator at rest [s]
_SHARE = re.compile(r'^[^:]*: (\d+) %, (.*)$')
_FAILED = 'success: false'  # of an action without success
# Feedback of the action, as the verb `call` prints it.
_SWEEP = re.compile(
    r'record: .*, frequency: (\S+), amplitude: (\S+), seconds_left: (\S+), fraction: (\S+)$'
)


class VerbJob:
    """A verb of the command line as a child process, whose state `Live` holds under a kind."""

    def __init__(self, live: Live, kind: str) -> None:
        self._live, self._kind = live, kind
        self._process: subprocess.Popen[str] | None = None
        self._reader = threading.Thread()
        self._lines: list[str] = []
        self._cancelled = False
        self._outcome: Callable[[Sequence[str]], BackgroundJob] = lambda _: BackgroundJob()

    @property
    def state(self) -> BackgroundJob:
        """State that the page shows."""
        found: BackgroundJob = getattr(self._live, self._kind)
        return found

    def write(self, state: BackgroundJob) -> None:
        """Show another state."""
        setattr(self._live, self._kind, state)

    def fail(self, reason: str) -> None:
        """End the job with a reason."""
        self.write(BackgroundJob('failed', 0.0, reason))

    def start(
        self, arguments: Sequence[str], outcome: Callable[[Sequence[str]], BackgroundJob]
    ) -> None:
        """Start a verb; `outcome` reads its result, of which it gets the lines."""
        if self._process is not None:
            return
        self._lines, self._outcome, self._cancelled = [], outcome, False
        process = self._process = subprocess.Popen(
            [sys.executable, '-m', 'piezo_hysteresis', *arguments],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self._reader = threading.Thread(
            target=self._follow, args=(process, self._lines), daemon=True
        )
        self._reader.start()
        self.write(BackgroundJob('running', 0.0, 'starts', since=self._live.clock()))

    @staticmethod
    def _follow(process: subprocess.Popen[str], lines: list[str]) -> None:
        assert process.stdout is not None
        lines.extend(line.rstrip() for line in process.stdout if line.strip())

    def watch(self, fraction: float | None = None) -> None:
        """Show the newest line, or the outcome; called about once a second."""
        if (process := self._process) is None:
            return
        code = process.poll()
        if code is None:
            share, text = _progress(self._lines[-1]) if self._lines else (None, '')
            share = share if fraction is None else fraction
            self.write(
                replace(
                    self.state,
                    fraction=self.state.fraction if share is None else share,
                    text=text or self.state.text,
                )
            )
            return
        self._process = None
        self._reader.join(ENDED_WITHIN)
        newest = self._lines[-1].strip() if self._lines else f'ended ({code})'
        if newest == 'interrupted' and self._cancelled:
            newest = 'cancelled; the actuator is at rest'
        failed = BackgroundJob('failed', 1.0, newest.removeprefix('error: '))
        answered = code == 0 or _FAILED in self._lines
        self.write(self._outcome(self._lines) if answered else failed)

    def cancel(self) -> None:
        """Interrupt the verb as Ctrl-C does."""
        if self._process is not None:
            self._cancelled = True
            self._process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Interrupt the verb and wait for its end."""
        self.cancel()
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(ENDED_WITHIN)


def _progress(line: str) -> tuple[float | None, str]:
    """Return the share that a line states, None without one, and its text."""
    if found := _SHARE.match(line):
        return float(found[1]) / 100, found[2]
    if found := _SWEEP.match(line):
        return float(found[4]), f'{found[1]} Hz at {found[2]} V, {float(found[3]):.0f} s left'
    return None, line


class Jobs:
    """The sweep, the discovery and the investigation of one actuator."""

    def __init__(self, node: Node, live: Live, folder: Path) -> None:
        self._live, self._folder = live, folder.resolve()
        self._action = f'/{live.actuator}/run_sweep' if live.actuator else '/run_sweep'
        self._recorded, self._journal = '', Path()
        self._budget = self._asked = math.inf
        self._node = node
        self.sweep = VerbJob(live, 'sweep')
        self.discovery = VerbJob(live, 'discovery')
        self.investigation = VerbJob(live, 'investigation')
        self.by_kind = {
            'sweep': self.sweep, 'discovery': self.discovery, 'investigation': self.investigation
        }  # fmt: skip

    def watch(self) -> None:
        """Update the jobs and what is offered; called about once a second."""
        self._live.sweeps_offered = self._action in dict(get_action_names_and_types(self._node))
        self._live.investigations_offered = bool(self._model())
        self.sweep.watch()
        self._explain()
        self.discovery.watch()
        if self._live.investigation.busy:
            self._live.states = states_of(self._journal)
        spent = self._live.states[-1].seconds if self._live.states else 0.0
        self.investigation.watch(min(1.0, spent / self._budget))

    def close(self) -> None:
        """Interrupt the verbs that run; an investigated actuator comes to rest."""
        self.discovery.close()
        self.investigation.close()

    def _explain(self) -> None:
        """Show the reason of a refused sweep, which its node logs."""
        state = self._live.sweep
        if state.phase == 'failed' and 'refuses the goal' in state.text:
            logged = [line for line in self._live.words if line.node == 'excitation']
            if logged and logged[-1].at >= self._asked:
                self.sweep.fail(logged[-1].text)

    # --- sweep ---------------------------------------------------------------------------------

    def run_sweep(self, order: SweepOrder) -> None:
        """Request a recorded sweep from the excitation."""
        self._recorded, self._asked = order.name, self._live.clock()
        goal = {
            'frequencies': order.frequencies,
            'amplitudes': order.amplitudes,
            'seconds': order.seconds,
            'warm_up': order.warm_up,
            'pause': order.pause,
            'bag': str(self._folder / SWEEPS / order.name),
        }
        self.sweep.start(['call', self._action, json.dumps(goal)], sweep_outcome)

    def bags(self) -> list[str]:
        """Return the finished bags, the newest first."""
        folder = self._folder / SWEEPS
        busy = self._recorded if self._live.sweep.busy else ''
        found = [p for p in folder.glob('*/') if (p / 'metadata.yaml').exists() and p.name != busy]
        return [p.name for p in sorted(found, key=lambda p: -p.stat().st_mtime)]

    # --- verbs ---------------------------------------------------------------------------------

    def run_discovery(self, order: DiscoveryOrder) -> None:
        """Start a discovery: effects that the baseline lacks in recorded bags."""
        try:
            if order.baseline not in NAMES:
                raise PiezoError(f'there is no model {order.baseline!r}')
            data = [str(inside(str(self._folder / SWEEPS), bag)) for bag in order.data]
            name = f'{order.data[0]}_{order.baseline}'
            out = inside(str(self._folder / DISCOVERIES), name)
        except PiezoError as error:
            self.discovery.fail(str(error))
            return
        verb = ['discover', *data, '--baseline', order.baseline, '--out', str(out), '--verbose']
        self.discovery.start(verb, lambda _: self._discovered(out))

    def run_investigation(self, order: InvestigationOrder) -> None:
        """Start an investigation: experiments on the actuator that find missing effects."""
        try:
            out = inside(str(self._folder / INVESTIGATIONS), order.name)
        except PiezoError as error:
            self.investigation.fail(str(error))
            return
        self._live.states, self._journal = [], out / JOURNAL
        self._budget = order.budget or math.inf
        limits = {'low': order.low, 'high': order.high} if order.low < order.high else {}
        limits |= {'slew': order.slew, 'budget': order.budget}
        options = [f'--{name}={value!r}' for name, value in limits.items()]
        options += [
            '--model',
            self._model(),
            '--out',
            str(out),
            '--namespace',
            self._live.actuator,
        ]
        self.investigation.start(['investigate', *options], lambda _: self._investigated(out))

    def _model(self) -> str:
        """Return the model file of the nodes that use one, empty if there is none."""
        for node in ('feedforward', 'gap_monitor'):
            used = self._live.parameter(node, 'model_file')
            if used is not None and used.value:
                return str(used.value)
        return ''

    def _discovered(self, out: Path) -> BackgroundJob:
        verdict = json.loads((out / 'verdict.json').read_text(encoding='utf-8'))
        effects = tuple((each['name'], each['probability']) for each in verdict['effects'])
        gaps = verdict['held_out']
        before, after = gaps['before_in_floors'], gaps['after_in_floors']
        return self._outcome(verdict['summary'], effects, before, after, out)

    def _investigated(self, out: Path) -> BackgroundJob:
        self._live.states = states_of(self._journal)
        found = json.loads((out / SUMMARY).read_text(encoding='utf-8'))
        before, after = (
            math.nan if found[name] is None else found[name]
            for name in ('before_in_floors', 'after_in_floors')
        )
        effects = tuple(found['effects'].items())
        return self._outcome(found['words'], effects, before, after, out / FOUND)

    def _outcome(
        self, summary: str, effects: Any, before: float, after: float, report: Path
    ) -> BackgroundJob:
        page = (report / 'report.html').relative_to(self._folder).as_posix()
        return BackgroundJob('done', 1.0, summary, effects, before, after, page)


def sweep_outcome(lines: Sequence[str]) -> BackgroundJob:
    """Return the result of the action, which ends the lines of the verb."""
    first = max(k for k, line in enumerate(lines) if line.startswith('success:'))
    result = yaml.safe_load('\n'.join(lines[first:]))
    phase = 'done' if result['success'] else 'failed'
    return BackgroundJob(phase, 1.0, result['message'], records=tuple(result['names']))


def states_of(journal: Path) -> list[InvestigationState]:
    """Return the beliefs before the first experiment of a journal and after each."""
    try:
        _, *lines = map(json.loads, journal.read_text(encoding='utf-8').splitlines())
    except (OSError, ValueError):  # there is none yet
        return []
    states = [
        InvestigationState(
            line['number'], line['experiment'], line['why'], line['answer'],
            tuple(line['after']['chances'].items()), line['spent'],
        )
        for line in lines
    ]  # fmt: skip
    start = tuple(lines[0]['before']['chances'].items()) if lines else ()
    return [InvestigationState(0, '', '', '', start, 0.0), *states] if lines else []
