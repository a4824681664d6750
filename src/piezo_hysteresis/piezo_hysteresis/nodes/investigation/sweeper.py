"""Runs one experiment on the actuator and records it: a sweep of one record, and a bag."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from rclpy.node import Node
from rclpy.subscription import Subscription

from piezo_hysteresis.common import topics
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.nodes.investigation.node_requests import Unanswered, in_thread_of, waited
from piezo_hysteresis.nodes.investigation.sweep_goals import SweepGoals
from piezo_hysteresis.nodes.messages import STATE
from piezo_hysteresis.ros.qos import LOOP
from piezo_hysteresis.runtime.sweep_run import ACTUATOR_RESTARTED, NOT_RUNNING
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState

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


@dataclass(frozen=True)
class Circumstances:
    """Conditions of the experiments."""

    rate: float  # ticks per second [Hz]
    slew: float  # fastest change of the voltage [V/s]
    ready: Callable[[], None]  # makes the excitation ready for sweeps
    stopped: Callable[[], bool]  # returns whether it was cancelled


class Sweeper:
    """Runs experiments by the action ``run_sweep``, which records them."""

    def __init__(self, node: Node, reached: Callable[[], int]) -> None:
        self._node, self._reached = node, reached
        self._goals, self._newest = SweepGoals(node), b''

    def run(self, experiment: PlannedExperiment, bag: Path, under: Circumstances) -> bool:
        """Run an experiment into a new bag; repeat it after a restart of excitation or actuator.

        Returns whether the first attempt succeeded, so that the actuator was at rest before.
        """
        tries, first_loss = 0, 0.0
        while True:
            try:
                under.ready()
                return self._once(experiment, bag, under, tries > 0) and tries == 0
            except Unanswered as lost:
                tries += 1
                now = time.monotonic()
                first_loss = first_loss or now
                if tries >= TRIES and now - first_loss > AWAY:
                    raise
                self._node.get_logger().warning(f'{lost}; the experiment is run again')
                waited(lambda: False, under.stopped, LOOK)

    def _once(
        self, experiment: PlannedExperiment, bag: Path, under: Circumstances, again: bool
    ) -> bool:
        shutil.rmtree(bag, ignore_errors=True)
        node, inlets = self._node, list[Subscription]()
        in_thread_of(node, lambda: inlets.append(self._receive()))
        try:
            if again:
                self._come_to_rest(AT_REST * experiment.amplitude, under)
            result = self._sweep(experiment, bag, under)
        finally:
            in_thread_of(node, lambda: node.destroy_subscription(inlets[0]))
        if not result.names:
            raise Unanswered('the excitation missed some of the record')
        return bool(result.samples <= (experiment.seconds + RESTARTED) * under.rate)

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

    def _sweep(
        self, experiment: PlannedExperiment, bag: Path, under: Circumstances
    ) -> RunSweep.Result:
        goal = RunSweep.Goal(
            frequencies=[experiment.frequency],
            amplitudes=[experiment.amplitude],
            seconds=experiment.seconds,
            warm_up=experiment.prelude,
            waveform=experiment.spec['kind'],
            options=json.dumps({'parts': experiment.spec['parts']}),
            bag=str(bag.resolve()),
        )
        return self._done(goal, under)

    def _done(self, goal: RunSweep.Goal, under: Circumstances) -> RunSweep.Result:
        result = self._goals.run(goal, under.stopped, 10.0 * goal.seconds + LATE)
        if not result.success:
            away = any(each in result.message for each in (ACTUATOR_RESTARTED, NOT_RUNNING))
            raise (Unanswered if away else PiezoError)(result.message)
        return result

    def _come_to_rest(self, at_rest: float, under: Circumstances) -> None:
        """Bring an actuator to rest that lost its excitation in motion.

        A free-running actuator returns by itself; one in lock-step stays where it was, unless it
        was restarted.
        """
        before = self._reached_last()
        waited(lambda: False, under.stopped, PACED)
        now = self._reached_last()
        if before is None or now is None:
            return
        if now[0] != before[0]:
            waited(lambda: abs((self._reached_last() or now)[1]) <= at_rest, under.stopped, AWAY)
        elif self._reached() >= now[0] and abs(now[1]) > at_rest:
            slow = abs(now[1]) / (BELOW * under.slew) if isfinite(under.slew) else BACK
            back = max(BACK, slow)
            lines = {'times': [0.0, back], 'values': [now[1], 0.0]}
            goal = RunSweep.Goal(frequencies=[0.0], amplitudes=[abs(now[1])], seconds=back)
            goal.waveform, goal.options = 'lines', json.dumps(lines)
            self._done(goal, under)

    def close(self) -> None:
        """End a running sweep, which brings the actuator to rest."""
        self._goals.end()
