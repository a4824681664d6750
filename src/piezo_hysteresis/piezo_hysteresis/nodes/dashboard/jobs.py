"""What the page starts: sweeps of the excitation, and verbs as child processes."""

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

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.node import Node

from piezo_hysteresis.dashboard.backend import DiscoveryOrder, InvestigationOrder, SweepOrder
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState, Live
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.investigation import FOUND, JOURNAL, SUMMARY
from piezo_hysteresis.models import NAMES
from piezo_hysteresis.nodes.messages import inside
from piezo_interfaces.action import RunSweep

SWEEPS, DISCOVERIES, INVESTIGATIONS = 'sweeps', 'discoveries', 'investigations'
EXPLAINED = 2.0  # time in which a refusing node logs the reason [s]
TIMEOUT = 5.0  # time without the node after which a job is aborted [s]
ENDED_WITHIN = 20.0  # time in which a cancelled verb ends, with the actuator at rest [s]
_SHARE = re.compile(r'^[^:]*: (\d+) %, (.*)$')


class _Job:
    """A job of the page, whose state `Live` holds under its kind."""

    def __init__(self, live: Live, kind: str) -> None:
        self._live, self._kind = live, kind

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


class SweepJob(_Job):
    """Client of the action ``run_sweep`` of the excitation, with one goal at a time."""

    def __init__(self, node: Node, live: Live) -> None:
        super().__init__(live, 'sweep')
        prefix = f'/{live.actuator}/' if live.actuator else '/'
        self._client = ActionClient(node, RunSweep, f'{prefix}run_sweep')
        self._handle: Any = None
        self._missed_since = math.inf
        self._asked = 0.0
        self._unexplained = False

    @property
    def offered(self) -> bool:
        """Whether a node offers the action."""
        return bool(self._client.server_is_ready())

    def send(self, goal: RunSweep.Goal) -> None:
        """Send a goal."""
        self._handle = None
        self._asked = self._live.clock()
        self._missed_since = math.inf
        sent = self._client.send_goal_async(goal, feedback_callback=self._on_feedback)
        sent.add_done_callback(self._on_response)

    def _on_feedback(self, message: Any) -> None:
        if self.state.phase == 'running':
            now: RunSweep.Feedback = message.feedback
            at = f'{now.frequency:g} Hz at {now.amplitude:g} V'
            text = f'{at}, {now.seconds_left:.0f} s left'
            self.write(replace(self.state, fraction=now.fraction, text=text))

    def _on_response(self, future: Any) -> None:
        handle = future.result()
        if not handle.accepted:
            self._unexplained = True
            self.fail('excitation refused; see its log')
            self._explain()
            return
        self._handle = handle
        self.write(BackgroundJob('running', 0.0, 'accepted', since=self._asked))
        handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        if not self.state.busy:
            return
        result: RunSweep.Result = future.result().result
        why = result.message or 'excitation failed; see its log'
        done = BackgroundJob('done', 1.0, result.message, records=tuple(result.names))
        self.write(done if result.success else BackgroundJob('failed', 1.0, why))

    def cancel(self) -> None:
        """Cancel the goal."""
        if self._handle is None:
            return

        def answered(future: Any) -> None:
            response: CancelGoal.Response = future.result()
            if response.return_code != CancelGoal.Response.ERROR_NONE and self.state.busy:
                self.write(replace(self.state, text=f'{self.state.text}; it cannot be cancelled'))

        self._handle.cancel_goal_async().add_done_callback(answered)

    def watch(self) -> None:
        """Check for an ended node and for the reason of a refusal; called about once a second."""
        self._explain()
        if not self.state.busy or self.offered:
            self._missed_since = math.inf
            return
        now = self._live.clock()
        self._missed_since = min(self._missed_since, now)
        if now - self._missed_since > TIMEOUT:
            self.fail('excitation has gone; start it again')

    def _explain(self) -> None:
        if not self._unexplained:
            return
        now = self._live.clock()
        lines = [
            w for w in self._live.words if w.node == 'excitation' and w.at >= self._asked - 0.1
        ]
        if lines:
            self.write(replace(self.state, text=lines[-1].text))
        self._unexplained = not lines and now - self._asked < EXPLAINED


class VerbJob(_Job):
    """A verb of the command line as a child process: its newest line, and its outcome."""

    def __init__(self, live: Live, kind: str) -> None:
        super().__init__(live, kind)
        self._process: subprocess.Popen[str] | None = None
        self._reader = threading.Thread()
        self._newest = ['']  # line
        self._outcome: Callable[[], BackgroundJob] = BackgroundJob

    def start(self, arguments: Sequence[str], outcome: Callable[[], BackgroundJob]) -> None:
        """Start a verb; `outcome` reads its result."""
        if self._process is not None:
            return
        self._newest, self._outcome = [''], outcome
        process = self._process = subprocess.Popen(
            [sys.executable, '-m', 'piezo_hysteresis', *arguments],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self._reader = threading.Thread(
            target=self._follow, args=(process, self._newest), daemon=True
        )
        self._reader.start()
        self.write(BackgroundJob('running', 0.0, 'starts', since=self._live.clock()))

    @staticmethod
    def _follow(process: subprocess.Popen[str], newest: list[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            newest[0] = line.strip() or newest[0]

    def watch(self, fraction: float | None = None) -> None:
        """Show the newest line, or the outcome; called about once a second."""
        if (process := self._process) is None:
            return
        code, line = process.poll(), self._newest[0]
        if code is None:
            found = _SHARE.match(line)
            share = float(found[1]) / 100 if found else self.state.fraction
            text = found[2] if found else line or self.state.text
            share = share if fraction is None else fraction
            self.write(replace(self.state, fraction=share, text=text))
            return
        self._process = None
        self._reader.join(ENDED_WITHIN)
        line = self._newest[0]
        failed = BackgroundJob('failed', 1.0, line.removeprefix('error: ') or f'ended ({code})')
        self.write(self._outcome() if code == 0 else failed)

    def cancel(self) -> None:
        """Interrupt the verb as Ctrl-C does."""
        if self._process is not None:
            self._process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Interrupt the verb and wait for its end."""
        self.cancel()
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(ENDED_WITHIN)


class Jobs:
    """The sweep, the discovery and the investigation of one actuator."""

    def __init__(self, node: Node, live: Live, folder: Path) -> None:
        self._live, self._folder = live, folder.resolve()
        self._recorded, self._journal = '', Path()
        self._budget = math.inf
        self.sweep = SweepJob(node, live)
        self.discovery = VerbJob(live, 'discovery')
        self.investigation = VerbJob(live, 'investigation')
        self.by_kind: dict[str, SweepJob | VerbJob] = {
            'sweep': self.sweep, 'discovery': self.discovery, 'investigation': self.investigation
        }  # fmt: skip

    def watch(self) -> None:
        """Update the jobs and what is offered; called about once a second."""
        self._live.sweeps_offered = self.sweep.offered
        self._live.investigations_offered = bool(self._model())
        self.sweep.watch()
        self.discovery.watch()
        if self._live.investigation.busy:
            self._live.states = states_of(self._journal)
        spent = self._live.states[-1].seconds if self._live.states else 0.0
        self.investigation.watch(min(1.0, spent / self._budget))

    def close(self) -> None:
        """Interrupt the verbs that run; an investigated actuator comes to rest."""
        self.discovery.close()
        self.investigation.close()

    # --- sweep ---------------------------------------------------------------------------------

    def run_sweep(self, order: SweepOrder) -> None:
        """Request a recorded sweep from the excitation."""
        if self._live.sweep.phase == 'running':
            reason = 'another sweep is being recorded; wait for it or cancel it'
            self._live.sweep = BackgroundJob('failed', 0.0, reason)
            return
        self._recorded = order.name
        goal = RunSweep.Goal(
            frequencies=list(order.frequencies),
            amplitudes=list(order.amplitudes),
            seconds=order.seconds,
            warm_up=order.warm_up,
            pause=order.pause,
            bag=str(self._folder / SWEEPS / order.name),
        )
        self.sweep.send(goal)

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
        self.discovery.start(verb, lambda: self._discovered(out))

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
        self.investigation.start(['investigate', *options], lambda: self._investigated(out))

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
