"""Sweeps and discoveries that the page starts: goals, feedback, results, recorded bags."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.node import Node

from piezo_hysteresis.dashboard.backend import DiscoveryOrder, InvestigationOrder, SweepOrder
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState, Live
from piezo_interfaces.action import Discover, Investigate, RunSweep

SWEEPS, DISCOVERIES = 'sweeps', 'discoveries'
EXPLAINED = 2.0  # time in which a refusing node logs the reason [s]
TIMEOUT = 5.0  # time without the node after which a job is aborted [s]


class ActionJob:
    """Client of one action, with one goal at a time and its outcome."""

    def __init__(
        self,
        node: Node,
        live: Live,
        kind: Any,
        name: str,
        server: str,
        read: Callable[[], BackgroundJob],
        write: Callable[[BackgroundJob], None],
    ) -> None:
        prefix = f'/{live.actuator}/' if live.actuator else '/'
        self._client = ActionClient(node, kind, prefix + name)
        self._live, self._server, self._name = live, server, name
        self.read, self.write = read, write
        self._handle: Any = None
        self._missed_since = math.inf
        self._asked = 0.0
        self._unexplained = False
        self.on_result: Callable[[Any], BackgroundJob] = lambda result: BackgroundJob(
            'done', 1.0, result.message
        )

    @property
    def offered(self) -> bool:
        """Whether a node offers the action."""
        return bool(self._client.server_is_ready())

    def send(self, goal: Any, text_of: Callable[[Any], str]) -> None:
        """Send a goal; `text_of` formats the feedback."""

        def on_feedback(message: Any) -> None:
            if self.read().phase == 'running':
                self.write(
                    replace(
                        self.read(),
                        fraction=message.feedback.fraction,
                        text=text_of(message.feedback),
                    )
                )

        self._handle = None
        self._asked = self._live.clock()
        self._missed_since = math.inf
        sent = self._client.send_goal_async(goal, feedback_callback=on_feedback)
        sent.add_done_callback(self._on_response)

    def _on_response(self, future: Any) -> None:
        handle = future.result()
        if not handle.accepted:
            self._unexplained = True
            self.fail(f'{self._server} refused; see its log')
            self._explain()
            return
        self._handle = handle
        self.write(BackgroundJob('running', 0.0, 'accepted', since=self._asked))
        handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        if not self.read().busy:
            return
        result = future.result().result
        why = result.message or f'{self._server} failed; see its log'
        job = self.on_result(result) if result.success else BackgroundJob('failed', 1.0, why)
        self.write(job)

    def fail(self, reason: str) -> None:
        """End the job with a reason."""
        self.write(BackgroundJob('failed', 0.0, reason))

    def cancel(self) -> None:
        """Cancel the goal."""
        if self._handle is None:
            return

        def answered(future: Any) -> None:
            response: CancelGoal.Response = future.result()
            if response.return_code != CancelGoal.Response.ERROR_NONE and self.read().busy:
                text = f'{self.read().text}; it cannot be cancelled'
                self.write(replace(self.read(), text=text))

        self._handle.cancel_goal_async().add_done_callback(answered)

    def watch(self) -> None:
        """Check for an ended node and for the reason of a refusal; called about once a second."""
        self._explain()
        if not self.read().busy or self.offered:
            self._missed_since = math.inf
            return
        now = self._live.clock()
        self._missed_since = min(self._missed_since, now)
        if now - self._missed_since > TIMEOUT:
            self.fail(f'{self._server} has gone; start it again')

    def _explain(self) -> None:
        if not self._unexplained:
            return
        now = self._live.clock()
        lines = [
            w for w in self._live.words if w.node == self._server and w.at >= self._asked - 0.1
        ]
        if lines:
            self.write(replace(self.read(), text=lines[-1].text))
        self._unexplained = not lines and now - self._asked < EXPLAINED


class Jobs:
    """The sweep and the discovery of one actuator."""

    def __init__(self, node: Node, live: Live, folder: Path) -> None:
        self._live, self._folder = live, folder
        self._recorded = ''
        self.sweep = ActionJob(
            node, live, RunSweep, 'run_sweep', 'excitation',
            lambda: live.sweep, lambda job: setattr(live, 'sweep', job),
        )  # fmt: skip
        self.sweep.on_result = _swept
        self.discovery = ActionJob(
            node, live, Discover, 'discover', 'discovery',
            lambda: live.discovery, lambda job: setattr(live, 'discovery', job),
        )  # fmt: skip
        self.discovery.on_result = lambda result: what_was_found(result, folder)

    def watch(self) -> None:
        """Update the available services; called about once a second."""
        self._live.sweeps_offered = self.sweep.offered
        self._live.discoveries_offered = self.discovery.offered
        self.sweep.watch()
        self.discovery.watch()

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
            bag=str(self._folder.resolve() / SWEEPS / order.name),
        )
        self.sweep.send(goal, _swept_so_far)

    # --- discovery -----------------------------------------------------------------------------

    def run_discovery(self, order: DiscoveryOrder) -> None:
        """Start a discovery: effects that the baseline lacks in recorded bags."""
        base = self._folder.resolve()
        out = f'{order.data[0]}_{order.baseline}'
        goal = Discover.Goal(
            data=[str(base / SWEEPS / bag) for bag in order.data],
            baseline=order.baseline,
            out=str(base / DISCOVERIES / out),
        )
        self.discovery.send(goal, _discovered_so_far)

    def bags(self) -> list[str]:
        """Return the finished bags, the newest first."""
        folder = self._folder / SWEEPS
        busy = self._recorded if self._live.sweep.busy else ''
        found = [p for p in folder.glob('*/') if (p / 'metadata.yaml').exists() and p.name != busy]
        return [p.name for p in sorted(found, key=lambda p: -p.stat().st_mtime)]


def _swept(result: RunSweep.Result) -> BackgroundJob:
    return BackgroundJob('done', 1.0, result.message, records=tuple(result.names))


def _swept_so_far(feedback: RunSweep.Feedback) -> str:
    at = f'{feedback.frequency:g} Hz at {feedback.amplitude:g} V'
    return f'{at}, {feedback.seconds_left:.0f} s left'


def _discovered_so_far(feedback: Discover.Feedback) -> str:
    return feedback.detail or feedback.stage


def what_was_found(result: Discover.Result | Investigate.Result, folder: Path) -> BackgroundJob:
    """Return the outcome of a discovery or investigation, with its report in `folder`."""
    report, base = Path(result.report).resolve(), folder.resolve()
    return BackgroundJob(
        'done',
        1.0,
        result.message,
        tuple(zip(result.effects, result.probabilities, strict=False)),
        result.before_in_floors,
        result.after_in_floors,
        report.relative_to(base).as_posix() if base in report.parents else '',
    )


INVESTIGATIONS = 'investigations'


class InvestigationJob(ActionJob):
    """An investigation of one actuator at a time."""

    def __init__(self, node: Node, live: Live, folder: Path) -> None:
        super().__init__(
            node, live, Investigate, 'investigate', 'discovery',
            lambda: live.investigation, lambda job: setattr(live, 'investigation', job),
        )  # fmt: skip
        self._page, self._folder = live, folder
        self.on_result = lambda result: what_was_found(result, folder)

    def run(self, order: InvestigationOrder) -> None:
        """Start an investigation: experiments on the actuator that find missing effects."""
        self._page.states = []
        goal = Investigate.Goal(
            low=order.low,
            high=order.high,
            slew=order.slew,
            budget=order.budget,
            out=str(self._folder.resolve() / INVESTIGATIONS / order.name),
            apply=True,
        )
        self.send(goal, self._progress)

    def _progress(self, feedback: Investigate.Feedback) -> str:
        if feedback.names:
            self._page.states = [*self._page.states, belief_of(feedback)]
        doing = {'judge': 'judges', 'run': 'runs', 'apply': 'uses what was found, runs'}
        word = doing.get(feedback.stage, 'looks what can be asked')
        return f'{word} {feedback.experiment}'.strip()


def belief_of(feedback: Investigate.Feedback) -> InvestigationState:
    """Return the content of a feedback message, for the page."""
    return InvestigationState(
        feedback.stage,
        feedback.number,
        feedback.experiment,
        feedback.why,
        feedback.answer,
        tuple(zip(feedback.names, feedback.chances, strict=True)),
        feedback.seconds,
    )
