"""Sweeps and discoveries that the page starts: goals, feedback, results, recorded bags."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.node import Node

from piezo_hysteresis.common import topics
from piezo_hysteresis.dashboard.backend import DiscoveryOrder, SweepOrder
from piezo_hysteresis.dashboard.live_state import BackgroundJob, Live
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.dashboard.topic_collector import TopicCollector
from piezo_hysteresis.nodes.recording.offered_qos import offered_as_yaml
from piezo_hysteresis.nodes.recording.recorder_report import RecorderReport
from piezo_hysteresis.records.definitions import MARKER, REFERENCE, STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.action import Discover, Investigate, RunSweep

SWEEPS, DISCOVERIES = 'sweeps', 'discoveries'
FINAL_STATUS_TIMEOUTS = 0.4  # what is still on its way when a sweep ends [s]
EXPLAINED = 2.0  # within which a node that refuses says why in its log [s]
GONE = 5.0  # without the node a job is lost [s]

RECORDED = {topics.STATE: STATE, topics.REFERENCE: REFERENCE, topics.MARKER: MARKER}


def _keep(
    write: Callable[[bytes, int], bool],
    count: Callable[[bytes, bool], None] | None,
    payload: bytes,
    log_time: int,
) -> None:
    """Record one message, and count it where it is counted."""
    kept = write(payload, log_time)
    if count is not None:
        count(payload, kept)


class ActionJob:
    """A goal of one action at a time, and what becomes of it.

    Parameters
    ----------
    node, live : Node, Live
        Asks; of which actuator.
    kind, name : type, str
        The action.
    server : str
        Node that offers it.
    read, write : callable
        Get and set the `BackgroundJob` that the page shows.
    """

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
        self.on_end: Callable[[bool], None] = lambda accepted: None
        self.on_result: Callable[[Any], BackgroundJob] = lambda result: BackgroundJob(
            'done', 1.0, result.message
        )

    @property
    def offered(self) -> bool:
        """Whether a node offers the action."""
        return bool(self._client.server_is_ready())

    def send(self, goal: Any, text_of: Callable[[Any], str]) -> None:
        """Send a goal; `text_of` tells of a feedback."""

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
        sent.add_done_callback(self._judged)

    def _judged(self, future: Any) -> None:
        handle = future.result()
        if not handle.accepted:
            self._unexplained = True
            self.fail(f'{self._server} refused; its log says why', accepted=False)
            self._explain()
            return
        self._handle = handle
        self.write(BackgroundJob('running', 0.0, 'accepted', since=self._asked))
        handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        if not self.read().busy:
            return
        result = future.result().result
        why = result.message or f'{self._server} failed; its log says why'
        job = self.on_result(result) if result.success else BackgroundJob('failed', 1.0, why)
        self.on_end(getattr(result, 'samples', 1) > 0)  # else nothing was recorded
        self.write(job)

    def fail(self, reason: str, accepted: bool = True) -> None:
        """End the job with a reason."""
        self.on_end(accepted)
        self.write(BackgroundJob('failed', 0.0, reason))

    def cancel(self) -> None:
        """Ask the node to give it up."""
        if self._handle is None:
            return

        def answered(future: Any) -> None:
            response: CancelGoal.Response = future.result()
            if response.return_code != CancelGoal.Response.ERROR_NONE and self.read().busy:
                text = f'{self.read().text}; it cannot be cancelled'
                self.write(replace(self.read(), text=text))

        self._handle.cancel_goal_async().add_done_callback(answered)

    def watch(self) -> None:
        """Notice a node that died, and the reason of a refusal; called about once a second."""
        self._explain()
        if not self.read().busy or self.offered:
            self._missed_since = math.inf
            return
        now = self._live.clock()
        self._missed_since = min(self._missed_since, now)
        if now - self._missed_since > GONE:
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
    """The sweep and the discovery of one actuator.

    Parameters
    ----------
    node : Node
        Asks.
    live : Live
        Of which actuator.
    ear : TopicCollector
        Hears what is recorded.
    report : RecorderReport
        Tells the excitation what has been.
    folder : Path
        Where bags and reports go.
    later : callable
        Runs something after so many seconds.
    """

    def __init__(
        self,
        node: Node,
        live: Live,
        ear: TopicCollector,
        report: RecorderReport,
        folder: Path,
        later: Callable[[float, Callable[[], None]], None],
    ) -> None:
        self._live, self._ear, self._folder, self._later = live, ear, folder, later
        self._report = report
        self._recorder: Recorder | None = None
        self.sweep = ActionJob(
            node, live, RunSweep, 'run_sweep', 'excitation',
            lambda: live.sweep, lambda job: setattr(live, 'sweep', job),
        )  # fmt: skip
        self.sweep.on_end = self._end_recording
        self.sweep.on_result = self._swept
        self.discovery = ActionJob(
            node, live, Discover, 'discover', 'discovery',
            lambda: live.discovery, lambda job: setattr(live, 'discovery', job),
        )  # fmt: skip
        self.discovery.on_result = lambda result: what_was_found(result, folder)

    def watch(self) -> None:
        """Look who offers what; called about once a second."""
        self._live.sweeps_offered = self.sweep.offered
        self._live.discoveries_offered = self.discovery.offered
        self.sweep.watch()
        self.discovery.watch()

    # --- sweep ---------------------------------------------------------------------------------

    def run_sweep(self, order: SweepOrder) -> None:
        """Record and run a sweep."""
        try:
            self._record(self._folder / SWEEPS / order.name)
        except PiezoError as error:
            self._live.sweep = BackgroundJob('failed', 0.0, str(error))
            return
        goal = RunSweep.Goal(
            frequencies=list(order.frequencies),
            amplitudes=list(order.amplitudes),
            seconds=order.seconds,
            warm_up=order.warm_up,
            pause=order.pause,
        )
        self.sweep.send(goal, _swept_so_far)

    def _record(self, bag: Path) -> None:
        if self._recorder is not None:
            raise PiezoError('another sweep is being recorded; wait for it or cancel it')
        recorder = Recorder(bag)
        counted = {topics.STATE: self._report.on_state, topics.MARKER: self._report.on_marker}
        for short, kind in RECORDED.items():
            definition, type_hash = definition_of(kind)
            number = recorder.add_topic(
                self._ear.topic(short), kind, definition=definition, type_hash=type_hash,
                qos=offered_as_yaml(LOOP),
            )  # fmt: skip
            sink = partial(_keep, partial(recorder.write, number), counted.get(short))
            self._ear.channels[short].sinks.append(sink)
        self._recorder = recorder
        self._report.begin(recorder)

    def confirm(self) -> None:
        """Tell the excitation what has been recorded since the last word."""
        self._report.tell_news()

    def _end_recording(self, accepted: bool) -> None:
        if self._recorder is None:
            return
        if accepted:
            self._later(FINAL_STATUS_TIMEOUTS, self._close)
        else:
            bag = self._recorder.path
            self._close()
            shutil.rmtree(bag, ignore_errors=True)  # of a sweep that never ran

    def _close(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            for short in RECORDED:
                self._ear.channels[short].sinks.clear()
            self._report.end()
            recorder.close()

    def _swept(self, result: RunSweep.Result) -> BackgroundJob:
        assert self._recorder is not None
        text = f'{result.message}, recorded as {self._recorder.path.name}'
        records = tuple(zip(result.names, result.recorded_by, strict=False))
        return BackgroundJob('done', 1.0, text, records=records)

    # --- discovery -----------------------------------------------------------------------------

    def run_discovery(self, order: DiscoveryOrder) -> None:
        """Find what the baseline misses in recorded bags."""
        base = self._folder.resolve()
        out = f'{order.data[0]}_{order.baseline}'
        goal = Discover.Goal(
            data=[str(base / SWEEPS / bag) for bag in order.data],
            baseline=order.baseline,
            out=str(base / DISCOVERIES / out),
        )
        self.discovery.send(goal, _discovered_so_far)

    def bags(self) -> list[str]:
        """Return the recorded bags, the newest first, without the one being written."""
        folder = self._folder / SWEEPS
        busy = self._recorder.path.name if self._recorder else ''
        found = [p for p in folder.glob('*/') if (p / 'metadata.yaml').exists() and p.name != busy]
        return [p.name for p in sorted(found, key=lambda p: -p.stat().st_mtime)]

    def close(self) -> None:
        """Finish a recording that is under way."""
        self._close()


def _swept_so_far(feedback: RunSweep.Feedback) -> str:
    at = f'{feedback.frequency:g} Hz at {feedback.amplitude:g} V'
    return f'{at}, {feedback.seconds_left:.0f} s left'


def _discovered_so_far(feedback: Discover.Feedback) -> str:
    return feedback.detail or feedback.stage


def what_was_found(result: Discover.Result | Investigate.Result, folder: Path) -> BackgroundJob:
    """Return the end of a discovery or an investigation; its report where `folder` holds it."""
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
