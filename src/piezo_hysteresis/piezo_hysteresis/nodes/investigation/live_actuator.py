"""The running nodes as the actuator of an investigation: each experiment is a sweep."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf, isfinite
from pathlib import Path
from typing import Self

from piezo_hysteresis.common import topics
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.investigation.node_requests import (
    CancellableClient,
    Neighbourhood,
    Unanswered,
)
from piezo_hysteresis.nodes.investigation.sweeper import Sweeper
from piezo_hysteresis.nodes.messages import inside
from piezo_hysteresis.ros.qos import LATCHED
from piezo_interfaces.msg import LoopStatus

# Time in which an actuator that publishes its range is received [s].
_RECEIVED_WITHIN = 5.0


class LiveActuator(CancellableClient):
    """Client node, alive within a `with` block; Ctrl-C and SIGTERM cancel its work, at rest."""

    def __init__(self, namespace: str, out: str) -> None:
        super().__init__('_investigate', namespace)
        self._out, self._status = out, LoopStatus()
        self._received = False
        self._sweeper = Sweeper(self, lambda: self._status.sample, f'{namespace}/{out}')
        self._neighbours = Neighbourhood(self)
        self.node.create_subscription(LoopStatus, topics.LOOP_STATUS, self._on_status, LATCHED)

    def __enter__(self) -> Self:
        def cancel(*_: object) -> None:
            self.cancelled = True

        self._before = {
            number: signal.signal(number, cancel) for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self.close()

    def _on_status(self, message: LoopStatus) -> None:
        self._status, self._received = message, True

    def folder(self) -> Path:
        """Return the folder of the results, below that of the excitation, which records there."""
        return inside(str(self._neighbours.excitation('folder')), self._out)

    def range(self) -> tuple[float, float]:
        """Return the range of the voltage [V] that the actuator publishes, else (0, 0)."""
        self.waited(lambda: self._received, _RECEIVED_WITHIN)
        return self._status.low, self._status.high

    def rate(self) -> float:
        """Return the ticks per second of the excitation [Hz]."""
        return float(self._neighbours.excitation('rate'))

    @contextmanager
    def prepared(self, rate: float, slew: float) -> Iterator[None]:
        """End the experiment that runs; afterwards the excitation is as before.

        The excitation keeps the smaller of its own slew limit and `slew` [V/s].
        """
        before = str(self._neighbours.excitation('mode'))
        usual = float(self._neighbours.excitation('slew'))
        least = min(slew, usual or inf)
        held = least if isfinite(least) else 0.0
        self._sweeper.prepare(
            rate, slew, lambda: self._neighbours.set_excitation(mode='idle', slew=held)
        )
        try:
            yield
        finally:
            self.cancelled = False  # the excitation is as before, also after a cancellation
            try:
                self._neighbours.set_excitation(slew=usual, mode=before)
            except Unanswered as error:  # the result, or the failure, is still reported
                self.node.get_logger().warning(f'the excitation stays idle: {error}')

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        """Run an experiment and record it in a new bag; return whether it was at rest before."""
        return self._sweeper.run(experiment, bag)

    def apply(self, model: ModelFile) -> str:
        """Load a model into the running nodes."""
        return self._neighbours.use(model)
