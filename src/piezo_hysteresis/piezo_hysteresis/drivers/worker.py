"""A thread that owns a controller: it looks at it now and then, and runs one sweep at a time."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.drivers.controller import Controller
from piezo_hysteresis.drivers.driver_sweep import measured, planned_sweep, write_measured
from piezo_hysteresis.drivers.wires import ConnectionLostError, DriverError
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.records import Record
from piezo_hysteresis.runtime.sweep_plan import SweepRecord

#: Time between two tries to connect [s].
RETRY = 1.0
_LOOK = 0.05  # how often it is looked whether a pause should end [s]
_REST = 30.0  # timeout until the actuator is at rest [s]


class _Stopped(Exception):
    """The sweep was cancelled, or the thread closes."""


@dataclass(frozen=True)
class ControllerSweep:
    """A sweep to run."""

    bag: Path  # to be written
    frequencies: list[float]  # [Hz]
    amplitudes: list[float]  # [V]
    seconds: float  # length of each record [s]
    warm_up: float = 0.0  # [s]
    pause: float = 0.0  # the pause after it [s]
    waveform: str = 'sine'
    options: str = ''
    actuator: str = ''


@dataclass(frozen=True)
class SweepProgress:
    """How a sweep stands."""

    record: str  # that is running
    frequency: float  # of the record [Hz]
    amplitude: float  # [V]
    seconds_left: float  # remaining time of the sweep [s]
    fraction: float  # its finished share


class SweepOutcome(NamedTuple):
    """What became of a sweep."""

    records: list[Record]  # those that are complete; they are in the bag
    rate: float  # sampling rate of the records [Hz]
    reason: str = ''  # why it failed, empty where not
    is_cancelled: bool = False  # whether it was cancelled; the output is at rest


@dataclass
class _Job:
    order: ControllerSweep
    progress: Callable[[SweepProgress], None]
    stopped: Callable[[], bool]
    future: Future[SweepOutcome] = field(default_factory=Future)


class ControllerThread:
    """Connects, and reconnects after a loss; there is no motion before a sweep is requested.

    If the connection is lost after such a request, the output is stopped and ramped to 0 V as soon
    as the controller responds again.
    """

    def __init__(
        self,
        connect: Callable[[], Controller],
        on_state: Callable[[float, float], None],  # [V] [m]
        every: float = 0.1,  # [s]
    ) -> None:
        self._connect, self._on_state, self._every = connect, on_state, every
        self.problem, self.doing, self.losses = 'not connected yet', '', 0
        self._controller: Controller | None = None
        self._was_driving = False
        self._jobs: queue.Queue[_Job] = queue.Queue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='controller', daemon=True)
        self._thread.start()

    def check(self, order: ControllerSweep) -> str:
        """Return why a sweep would be refused, else an empty text; from any thread."""
        controller = self._controller
        if controller is None:
            return self.problem
        try:
            _planned(controller, order)
        except PiezoError as error:
            return str(error)
        return ''

    def run(
        self,
        order: ControllerSweep,
        progress: Callable[[SweepProgress], None] = lambda progress: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Future[SweepOutcome]:
        """Run a sweep in the thread; from any thread."""
        job = _Job(order, progress, stopped)
        self._jobs.put(job)
        return job.future

    def close(self) -> None:
        """Stop what runs, go to 0 V where something was driven, and disconnect."""
        self._closing.set()
        self._thread.join(_REST)

    def _serve(self) -> None:
        while not self._closing.is_set():
            if self._controller is None and not self._connected():
                self._closing.wait(RETRY)
                continue
            try:
                job = self._jobs.get(timeout=self._every)
            except queue.Empty:
                self._look()
                continue
            job.future.set_result(self._swept(job))
        while not self._jobs.empty():
            self._jobs.get().future.set_result(SweepOutcome([], 0.0, 'the driver ends'))
        self._leave()

    def _connected(self) -> bool:
        try:
            self._controller = self._connect()
            if self._was_driving:
                self._controller.stop(is_ours=True)
                self._controller.release()
                self._was_driving = False
        except PiezoError as error:
            self._lose(error)
            return False
        self.problem = ''
        return True

    def _lose(self, error: PiezoError) -> None:
        self.problem = str(error)
        if self._controller is not None:
            self._was_driving |= self._controller.is_claimed
            self._controller.disconnect()
            self._controller = None
            self.losses += 1

    def _leave(self) -> None:
        if self._controller is None:
            return
        try:
            if self._controller.is_claimed:
                self._controller.stop()
        except DriverError as error:
            self.problem = str(error)
        finally:
            self._controller.disconnect()

    def _look(self) -> None:
        assert self._controller is not None
        try:
            state = self._controller.state()
        except DriverError as error:
            self._lose(error)
            return
        if state is not None:
            self._on_state(*state)

    def _swept(self, job: _Job) -> SweepOutcome:
        """Run a sweep and write the complete records."""
        controller = self._controller
        assert controller is not None
        records: list[Record] = []
        reason, is_cancelled = '', False
        try:
            controller.open_loop()
            self._measure(controller, job, records)
        except _Stopped:
            is_cancelled = True
        except PiezoError as error:
            reason = str(error)
            if isinstance(error, ConnectionLostError):
                self._lose(error)
        finally:
            self.doing = ''
        if self._controller is not None:
            try:
                if (reason or is_cancelled) and controller.is_claimed:
                    controller.stop()
                controller.release()
            except ConnectionLostError as error:
                self._lose(error)
                reason = reason or str(error)
            except DriverError as error:
                controller.release()
                reason = f'{reason}; {error}'.removeprefix('; ')
        rate = records[0].rate if records else 0.0
        if records:
            try:
                job.order.bag.parent.mkdir(parents=True, exist_ok=True)
                write_measured(job.order.bag, records, controller.about())
            except (PiezoError, OSError) as error:
                reason, records = f'{reason}; {reason_of(error)}'.removeprefix('; '), []
        return SweepOutcome(records, rate, reason, is_cancelled and not reason)

    def _measure(self, controller: Controller, job: _Job, records: list[Record]) -> None:
        order = job.order
        planned, divider = _planned(controller, order)
        length = order.seconds + order.pause
        for k, each in enumerate(planned):
            began, name = time.monotonic(), each.name
            self.doing = name

            def watch(k: int = k, name: str = name, began: float = began) -> None:
                if self._closing.is_set() or job.stopped():
                    raise _Stopped
                info = planned[k].info
                share = min(1.0, (time.monotonic() - began) / length)
                left = len(planned) - k - share
                job.progress(
                    SweepProgress(
                        name, info.frequency, info.amplitude, left * length,
                        1.0 - left / len(planned),
                    )
                )  # fmt: skip
                state = controller.state()
                if state is not None:
                    self._on_state(*state)

            watch()
            info = replace(each.info, actuator=order.actuator)
            records.append(measured(controller, name, each.voltages, info, divider, watch))
            end = time.monotonic() + order.pause
            while k + 1 < len(planned) and time.monotonic() < end:
                watch()
                time.sleep(_LOOK)


def _planned(controller: Controller, order: ControllerSweep) -> tuple[list[SweepRecord], int]:
    return planned_sweep(
        controller, order.frequencies, order.amplitudes, order.seconds,
        order.warm_up, order.waveform, order.options,
    )  # fmt: skip
