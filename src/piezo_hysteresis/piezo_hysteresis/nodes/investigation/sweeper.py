"""Runs one experiment and records it: the goals of ``run_sweep``, and a bag."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from hashlib import blake2b
from math import isfinite
from pathlib import Path
from typing import Any

from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default
from rclpy.subscription import Subscription

from piezo_hysteresis.common import topics
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.nodes.investigation.node_requests import (
    TIMEOUT,
    CancellableClient,
    Cancelled,
    Unanswered,
)
from piezo_hysteresis.nodes.messages import STATE
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.runtime.sweep_plan import ACTUATOR_RESTARTED, NOT_RUNNING
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState

ACTION = 'run_sweep'
_STARTED = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)
_RUNNING = (*_STARTED, GoalStatus.STATUS_CANCELING)
# Timeout until the actuator is at rest, on a slow machine [s].
RESTS_WITHIN = 60.0
# Time until a request is repeated [s].
_ASK_AGAIN = 1.0
# Time in which messages that wait are received [s].
_RECEIVING = 0.2
# Bytes of an identifier; half of them identify the client.
_HALF = 8
# Period of the check of a server [s].
_WATCHED_EVERY = 0.2


class ActionWatch:
    """Detects that an action server has ended, also if another one has replaced it.

    A killed process remains in the graph for a while, and a quick restart is not visible there;
    but the new endpoints have other identifiers.
    """

    def __init__(self, node: Node, client: ActionClient, name: str) -> None:
        self._node, self._client = node, client
        self._topic = node.resolve_topic_name(f'{name}/_action/status')
        self._known: frozenset[bytes] = frozenset()
        self._due, self._lost = 0.0, False

    def begin(self) -> None:
        """Store the present server."""
        self._known, self._lost = self._there(), False

    @property
    def lost(self) -> bool:
        """Whether the stored server has ended or was replaced, according to the last check."""
        if not self._lost and time.monotonic() >= self._due:
            there = self._there()
            self._lost = bool(there - self._known) or not there & self._known
            self._lost |= not self._client.server_is_ready()
            self._due = time.monotonic() + _WATCHED_EVERY
        return self._lost

    def _there(self) -> frozenset[bytes]:
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return frozenset(bytes(info.endpoint_gid) for info in infos)


class SweepGoals:
    """One goal at a time.

    Every goal contains the name of its client. A client that finds a goal with its own name that
    it has not sent was killed and started again: that goal is orphaned and is cancelled, which
    brings the actuator to rest.
    """

    def __init__(self, client: CancellableClient, name: str) -> None:
        self._waits = client
        node = self._node = client.node
        self._mark = blake2b(name.encode(), digest_size=_HALF).digest()
        self._own: bytes | None = None
        self._asked: set[bytes] = set()
        self._running: frozenset[bytes] = frozenset()
        self._client = ActionClient(node, RunSweep, ACTION)
        self._watch = ActionWatch(node, self._client, ACTION)
        self._ender = node.create_client(CancelGoal, f'{ACTION}/_action/cancel_goal')
        node.create_subscription(
            GoalStatusArray,
            f'{ACTION}/_action/status',
            self._on_status,
            qos_profile_action_status_default,
        )

    def run(self, goal: RunSweep.Goal, timeout: float) -> RunSweep.Result:
        """Run a sweep to its end and return its result."""
        if not self._waits.waited(self._client.server_is_ready):
            raise Unanswered('no excitation is running: start it, and investigate again')
        self._end_stale()
        self._watch.begin()
        try:
            return self._run(goal, timeout)
        except PiezoError:
            self._asked.discard(self._own or b'')  # it is orphaned
            raise
        finally:
            self._own = None

    def _run(self, goal: RunSweep.Goal, timeout: float) -> RunSweep.Result:
        sent = self._send(goal)
        # a client that cancels now must wait for the response: an accepted sweep must be ended
        self._waits.wait(lambda: sent.done() or self._watch.lost, TIMEOUT)
        if not sent.done():
            raise self._lost('the excitation does not answer')
        handle: Any = sent.result()
        if not handle.accepted:
            raise PiezoError(self._refusal())
        ended = handle.get_result_async()
        try:
            self._waits.waited(lambda: ended.done() or self._watch.lost, timeout)
        except Cancelled:
            self._rest(ended)
            raise
        if not ended.done():
            self._end(self._own)
            raise self._lost('the excitation has gone')
        result: RunSweep.Result = ended.result().result
        return result

    def _send(self, goal: RunSweep.Goal) -> Any:
        self._own = self._mark + os.urandom(_HALF)
        self._asked.add(self._own)
        return self._client.send_goal_async(goal, goal_uuid=_identity(self._own).goal_id)

    def _lost(self, words: str) -> Unanswered:
        """Discard the goals of an excitation that has ended; a running one reports them again."""
        if self._watch.lost:
            self._running = frozenset()
        return Unanswered(words)

    def _refusal(self) -> str:
        if self._running - {self._own}:
            return 'another sweep is running: cancel it or wait for its end, and investigate again'
        return 'the excitation refused the experiment; see its log'

    def _rest(self, ended: Any) -> None:
        """Wait until a sweep that was stopped has brought the actuator to rest."""
        self._end(self._own)
        self._waits.wait(lambda: ended.done() or self._watch.lost, RESTS_WITHIN)
        if not ended.done():
            raise PiezoError(
                'cancelled, but the excitation does not say that the actuator is at rest'
            )

    def _end(self, goal: bytes | None) -> None:
        """End a running sweep, if it is one."""
        if goal is not None:
            self._ender.call_async(CancelGoal.Request(goal_info=_identity(goal)))

    # --- orphaned goals of an earlier process with this name -----------------------------------

    def _on_status(self, message: GoalStatusArray) -> None:
        """Store the running goals, and cancel orphaned ones."""
        goals = {bytes(each.goal_info.goal_id.uuid): each.status for each in message.status_list}
        self._running = frozenset(goal for goal, state in goals.items() if state in _RUNNING)
        for goal in self._left():
            if goals[goal] in _STARTED:
                self._node.get_logger().warning('cancelling an orphaned sweep goal')
                self._end(goal)

    def _left(self) -> list[bytes]:
        return [each for each in self._running - self._asked if each.startswith(self._mark)]

    def _end_stale(self) -> None:
        """Cancel orphaned sweeps until there are none."""
        self._waits.waited(lambda: False, _RECEIVING)  # goals that were reported while it computed
        end = time.monotonic() + RESTS_WITHIN
        while left := self._left():
            if time.monotonic() > end:
                raise Unanswered('the excitation does not end an orphaned sweep')
            for goal in left:  # the previous request may be lost
                self._end(goal)
            self._waits.waited(lambda: not self._left(), _ASK_AGAIN)


def _identity(goal: bytes) -> GoalInfo:
    found = GoalInfo()
    found.goal_id.uuid = list(goal)
    return found


# Longest absence of an excitation or actuator, and the period of the checks [s].
AWAY, LOOK = 60.0, 1.0
# Least number of attempts of an experiment before it fails.
TRIES = 3
# Time that a sweep may take in addition to its record: it may be repeated on slow machines [s].
LATE = 120.0
# Shortest time of the return to rest from another voltage [s], and its share of the slew limit.
BACK, BELOW = 0.5, 0.9
# A free-running actuator has advanced by a tick after this time [s].
PACED = 0.5
# Voltages below this share of the amplitude of an experiment are rest.
AT_REST = 1e-3
# A sweep that exceeds its record by this time was restarted [s].
RESTARTED = 1.5


class Sweeper:
    """Runs experiments by the action ``run_sweep``, which records them."""

    def __init__(self, client: CancellableClient, reached: Callable[[], int], name: str) -> None:
        self._client, self._node, self._reached = client, client.node, reached
        self._goals, self._newest = SweepGoals(client, name), b''

    def prepare(self, rate: float, slew: float, ready: Callable[[], None]) -> None:
        """Note the ticks per second [Hz], the fastest change [V/s], and what precedes a sweep."""
        self._rate, self._slew, self._ready = rate, slew, ready
        ready()

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        """Run an experiment into a new bag; repeat it after a restart of excitation or actuator.

        Returns whether the first attempt succeeded, so that the actuator was at rest before.
        """
        tries, first_loss = 0, 0.0
        while True:
            try:
                self._ready()
                return self._once(experiment, bag, tries > 0) and tries == 0
            except Unanswered as lost:
                tries += 1
                now = time.monotonic()
                first_loss = first_loss or now
                if tries >= TRIES and now - first_loss > AWAY:
                    raise
                self._node.get_logger().warning(f'{lost}; the experiment is run again')
                self._client.waited(lambda: False, LOOK)

    def _once(self, experiment: PlannedExperiment, bag: Path, again: bool) -> bool:
        shutil.rmtree(bag, ignore_errors=True)
        inlet = self._receive()
        try:
            if again:
                self._come_to_rest(AT_REST * experiment.amplitude)
            result = self._sweep(experiment, bag)
        finally:
            self._node.destroy_subscription(inlet)
        if not result.names:
            raise Unanswered('the excitation missed some of the record')
        return bool(result.samples <= (experiment.seconds + RESTARTED) * self._rate)

    def _receive(self) -> Subscription:
        """Store the newest state; it determines how the actuator comes to rest."""

        def keep(payload: bytes) -> None:
            self._newest = payload

        return self._node.create_subscription(ActuatorState, topics.STATE, keep, LOOP, raw=True)

    def _reached_last(self) -> tuple[int, float] | None:
        """Return tick and voltage [V] of the last received state, None if there was none."""
        if not self._newest:
            return None
        _, (sample, voltage, _) = STATE.decode(self._newest)
        return sample, voltage

    def _sweep(self, experiment: PlannedExperiment, bag: Path) -> RunSweep.Result:
        goal = RunSweep.Goal(
            frequencies=[experiment.frequency],
            amplitudes=[experiment.amplitude],
            seconds=experiment.seconds,
            warm_up=experiment.prelude,
            waveform=experiment.spec['kind'],
            options=json.dumps({'parts': experiment.spec['parts']}),
            bag=str(bag.resolve()),
        )
        return self._done(goal)

    def _done(self, goal: RunSweep.Goal) -> RunSweep.Result:
        result = self._goals.run(goal, 10.0 * goal.seconds + LATE)
        if not result.success:
            away = any(each in result.message for each in (ACTUATOR_RESTARTED, NOT_RUNNING))
            raise (Unanswered if away else PiezoError)(result.message)
        return result

    def _come_to_rest(self, at_rest: float) -> None:
        """Bring an actuator to rest that lost its excitation in motion.

        A free-running actuator returns by itself; one in lock-step stays where it was, unless it
        was restarted.
        """
        before = self._reached_last()
        self._client.waited(lambda: False, PACED)
        now = self._reached_last()
        if before is None or now is None:
            return
        if now[0] != before[0]:
            self._client.waited(lambda: abs((self._reached_last() or now)[1]) <= at_rest, AWAY)
        elif self._reached() >= now[0] and abs(now[1]) > at_rest:
            slow = abs(now[1]) / (BELOW * self._slew) if isfinite(self._slew) else BACK
            back = max(BACK, slow)
            lines = {'times': [0.0, back], 'values': [now[1], 0.0]}
            goal = RunSweep.Goal(frequencies=[0.0], amplitudes=[abs(now[1])], seconds=back)
            goal.waveform, goal.options = 'lines', json.dumps(lines)
            self._done(goal)
