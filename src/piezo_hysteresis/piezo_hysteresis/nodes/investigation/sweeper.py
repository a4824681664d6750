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

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.investigation.experiments import PlannedExperiment
from piezo_hysteresis.nodes.investigation.in_thread import in_thread_of
from piezo_hysteresis.nodes.investigation.neighbours_asked import Unanswered, waited
from piezo_hysteresis.nodes.investigation.sweep_bag import SweepBag
from piezo_hysteresis.nodes.investigation.sweep_goals import SweepGoals
from piezo_interfaces.action import RunSweep

# What is still on its way when a sweep ends [s].
FINAL_STATUS_TIMEOUTS = 0.4
# How long an excitation or an actuator may be away, between two looks whether it is there [s].
AWAY, LOOK = 60.0, 1.0
# How often an experiment is started at least before it is given up.
TRIES = 3
# Longer than a record the sweep may take: recorders are waited for, and slow machines [s].
LATE = 120.0
# Least time in which an actuator that was left elsewhere is brought to rest [s], and the share of
# the slew that this may have.
BACK, BELOW = 0.5, 0.9
# An actuator that keeps its own pace has made a tick after so long [s].
PACED = 0.5
# Voltages below this share of the amplitude of an experiment are rest.
AT_REST = 1e-3
# A sweep that takes so much longer than its record was restarted in its middle [s].
RESTARTED = 1.5


@dataclass(frozen=True)
class Circumstances:
    """Under which experiments are run.

    Attributes
    ----------
    rate : float
        Ticks per second [Hz].
    slew : float
        Fastest change of the voltage [V/s].
    ready : callable
        Makes the excitation ready for sweeps.
    stopped : callable
        Tells whether it was given up.
    """

    rate: float
    slew: float
    ready: Callable[[], None]
    stopped: Callable[[], bool]


class Sweeper:
    """Runs experiments by the action ``run_sweep``, and is the recorder of their bags.

    Parameters
    ----------
    node : Node
        That asks; it spins in another thread.
    reached : callable
        Returns the tick that the actuator says it waits for, or has come to.
    """

    def __init__(self, node: Node, reached: Callable[[], int]) -> None:
        self._node, self._reached = node, reached
        self._goals, self._bag = SweepGoals(node), SweepBag(node)

    def run(self, experiment: PlannedExperiment, bag: Path, under: Circumstances) -> bool:
        """Run an experiment into a new bag, again where excitation or actuator were started anew.

        Returns whether it went at the first try, so that the actuator had been at rest until then.

        Raises
        ------
        Cancelled
            If it was stopped; the actuator is at rest then.
        PiezoError
            If it cannot be run.
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
        in_thread_of(self._node, lambda: self._bag.begin(bag))
        try:
            if again:
                self._come_to_rest(AT_REST * experiment.amplitude, under)
            result = self._sweep(experiment, under)
            time.sleep(FINAL_STATUS_TIMEOUTS)
        finally:
            in_thread_of(self._node, self._bag.close)
        if self._node.get_fully_qualified_name() not in ', '.join(result.recorded_by).split(', '):
            raise Unanswered('the recorder missed some of the record')
        return bool(result.samples <= (experiment.seconds + RESTARTED) * under.rate)

    def _sweep(self, experiment: PlannedExperiment, under: Circumstances) -> RunSweep.Result:
        goal = RunSweep.Goal(
            frequencies=[experiment.frequency],
            amplitudes=[experiment.amplitude],
            seconds=experiment.seconds,
            warm_up=experiment.prelude,
            waveform=experiment.spec['kind'],
            options=json.dumps({'parts': experiment.spec['parts']}),
        )
        return self._done(goal, under)

    def _done(self, goal: RunSweep.Goal, under: Circumstances) -> RunSweep.Result:
        result = self._goals.run(goal, under.stopped, 10.0 * goal.seconds + LATE)
        if not result.success:
            away = 'anew' in result.message or 'not running' in result.message
            raise (Unanswered if away else PiezoError)(result.message)
        return result

    def _come_to_rest(self, at_rest: float, under: Circumstances) -> None:
        """Bring an actuator to rest that lost its excitation in motion.

        One that keeps its own pace does so by itself; one that waits for each tick stands where
        it was, unless it was started anew.
        """
        before = self._bag.newest
        waited(lambda: False, under.stopped, PACED)
        now = self._bag.newest
        if before is None or now is None:
            return
        if now[0] != before[0]:
            waited(lambda: abs((self._bag.newest or now)[1]) <= at_rest, under.stopped, AWAY)
        elif self._reached() >= now[0] and abs(now[1]) > at_rest:
            slow = abs(now[1]) / (BELOW * under.slew) if isfinite(under.slew) else BACK
            back = max(BACK, slow)
            lines = {'times': [0.0, back], 'values': [now[1], 0.0]}
            goal = RunSweep.Goal(frequencies=[0.0], amplitudes=[abs(now[1])], seconds=back)
            goal.waveform, goal.options = 'lines', json.dumps(lines)
            self._done(goal, under)

    def close(self) -> None:
        """End a sweep that is under way, which brings the actuator to rest, and its recording."""
        self._goals.end()
        self._bag.close()
