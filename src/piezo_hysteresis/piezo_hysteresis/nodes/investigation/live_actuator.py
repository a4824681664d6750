"""The running nodes as the actuator of an investigation: each experiment is a sweep."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from math import inf, isfinite
from pathlib import Path
from typing import TypeVar

from piezo_hysteresis.common import topics
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.nodes.investigation.node_requests import (
    Cancelled,
    Neighbourhood,
    Unanswered,
    waited,
)
from piezo_hysteresis.nodes.investigation.sweeper import Circumstances, Sweeper
from piezo_hysteresis.nodes.messages import inside
from piezo_hysteresis.ros.client import Client
from piezo_hysteresis.ros.qos import LATCHED
from piezo_interfaces.msg import LoopStatus

T = TypeVar('T')

# Time in which an actuator that publishes its range is received [s].
_RECEIVED_WITHIN = 5.0


class LiveActuator(Client):
    """Client node, alive within a `with` block; it spins while a thread investigates."""

    def __init__(self, namespace: str, out: str) -> None:
        super().__init__('_investigate', namespace=namespace)
        self._out, self._status = out, LoopStatus()
        self._received, self._stopped = threading.Event(), threading.Event()
        self._sweeper = Sweeper(self.node, lambda: self._status.sample, f'{namespace}/{out}')
        self._neighbours = Neighbourhood(self.node)
        self.node.create_subscription(LoopStatus, topics.LOOP_STATUS, self._on_status, LATCHED)

    def _on_status(self, message: LoopStatus) -> None:
        self._status = message
        self._received.set()

    def served(self, work: Callable[[], T]) -> T:
        """Return what `work` returns, in a thread; Ctrl-C and SIGTERM cancel it, at rest."""
        result: Future[T] = Future()

        def task() -> None:
            try:
                result.set_result(work())
            except BaseException as error:  # passed to the waiting thread
                result.set_exception(error)

        before = {
            number: signal.signal(number, lambda *_: self._stopped.set())
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            threading.Thread(target=task, name='investigation', daemon=True).start()
            self.wait(result.done)
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        return result.result()

    def check(self) -> None:
        """Raise if the investigation was cancelled."""
        if self._stopped.is_set():
            raise Cancelled('cancelled; the actuator is at rest and the journal is kept')

    def folder(self) -> Path:
        """Return the folder of the results, below that of the excitation, which records there."""
        return inside(str(self._neighbours.excitation('folder', self._stopped.is_set)), self._out)

    def range(self) -> tuple[float, float]:
        """Return the range of the voltage [V] that the actuator publishes, else (0, 0)."""
        waited(self._received.is_set, self._stopped.is_set, _RECEIVED_WITHIN)
        return self._status.low, self._status.high

    def rate(self) -> float:
        """Return the ticks per second of the excitation [Hz]."""
        return float(self._neighbours.excitation('rate', self._stopped.is_set))

    @contextmanager
    def prepared(self, rate: float, slew: float) -> Iterator[None]:
        """End the experiment that runs; afterwards the excitation is as before.

        The excitation keeps the smaller of its own slew limit and `slew` [V/s].
        """
        stopped = self._stopped.is_set
        before = str(self._neighbours.excitation('mode', stopped))
        usual = float(self._neighbours.excitation('slew', stopped))
        least = min(slew, usual or inf)
        held = least if isfinite(least) else 0.0
        self._under = Circumstances(
            rate,
            slew,
            lambda: self._neighbours.set_excitation(stopped, mode='idle', slew=held),
            stopped,
        )
        self._under.ready()
        try:
            yield
        finally:
            try:
                self._neighbours.set_excitation(slew=usual, mode=before)
            except Unanswered as error:  # the result, or the failure, is still reported
                self.node.get_logger().warning(f'the excitation stays idle: {error}')

    def run(self, experiment: PlannedExperiment, bag: Path) -> bool:
        """Run an experiment and record it in a new bag; return whether it was at rest before."""
        return self._sweeper.run(experiment, bag, self._under)

    def apply(self, model: ModelFile) -> str:
        """Load a model into the running nodes."""
        return self._neighbours.use(model, self._stopped.is_set)
