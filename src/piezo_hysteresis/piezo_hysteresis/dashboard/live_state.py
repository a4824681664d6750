"""State of one actuator on the page: newest samples of all topics, jobs, parameters."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.dashboard.controls import ParameterState

# Messages of one writer are ordered; a larger step back is a restart of the writer.
REORDERED = 64
CAPACITY = 1 << 17
NANO = 1e-9
# Smallest number of samples over which the sampling interval is measured.
INTERVALS = 1000


@dataclass(frozen=True)
class State:
    """One tick of an actuator."""

    sample: int  # number of the tick
    stamp: int  # its time [ns]
    voltage: float  # voltage [V]
    displacement: float  # displacement [m]


@dataclass(frozen=True)
class Window:
    """The last samples, one per tick; missing ones are NaN."""

    first: int  # number of the first sample
    dt: float  # sampling interval [s]
    voltage: FloatArray  # signals [V], shape (n,)
    displacement: FloatArray  # [m], shape (n,)
    reference: FloatArray  # [m], shape (n,)

    def __len__(self) -> int:
        return int(self.voltage.size)

    @property
    def newest(self) -> int:
        """Number of the last sample."""
        return self.first + len(self) - 1

    @property
    def error(self) -> FloatArray:
        """Measured minus desired displacement [m], NaN where there is no reference."""
        return self.displacement - self.reference

    @property
    def tracked(self) -> bool:
        """Whether the samples of the last 0.1 s have a reference."""
        recent = self.reference[-max(2, round(0.1 / self.dt)) :]
        return bool(np.any(np.isfinite(recent)))

    def last(self, seconds: float) -> Window:
        """Return the end of the window."""
        n = min(len(self), max(1, round(seconds / self.dt)))
        cut = slice(len(self) - n, None)
        return Window(
            self.first + len(self) - n,
            self.dt,
            self.voltage[cut],
            self.displacement[cut],
            self.reference[cut],
        )


class Signals:
    """Buffer of the newest samples, written by one thread and read by others."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._lock = threading.Lock()
        self._capacity = capacity
        self._clear()

    def _clear(self) -> None:
        self._newest = -1
        self._dt = 1e-3
        self._anchors: list[tuple[int, int]] = []
        self._number = np.full(self._capacity, -1, np.int64)
        self._stamp = np.zeros(self._capacity, np.int64)
        self._voltage = np.zeros(self._capacity)
        self._displacement = np.zeros(self._capacity)
        self._referred = np.full(self._capacity, -1, np.int64)
        self._reference = np.zeros(self._capacity)

    @property
    def newest(self) -> int:
        """Number of the newest sample, -1 before the first."""
        return self._newest

    @property
    def rate(self) -> float:
        """Sampling rate [Hz] from the time stamps."""
        return 1.0 / self._dt

    def add_states(self, states: Sequence[State]) -> None:
        """Add samples of the actuator, in order."""
        with self._lock:
            for state in states:
                if state.sample < self._newest - REORDERED:
                    self._clear()
                if not self._anchors:
                    self._anchors = [(state.sample, state.stamp)] * 2
                slot = state.sample % self._capacity
                self._number[slot] = state.sample
                self._stamp[slot] = state.stamp
                self._voltage[slot] = state.voltage
                self._displacement[slot] = state.displacement
                self._newest = max(self._newest, state.sample)
            if states:
                self._measure_interval()

    def add_references(self, samples: Sequence[int], displacements: Sequence[float]) -> None:
        """Add desired displacements [m], which arrive a tick before their states."""
        with self._lock:
            for sample, displacement in zip(samples, displacements, strict=True):
                slot = sample % self._capacity
                self._referred[slot] = sample
                self._reference[slot] = displacement

    def _measure_interval(self) -> None:
        """Measure the interval from the newest stamp and one 1000 to 2000 samples before it."""
        newest = self._newest, int(self._stamp[self._newest % self._capacity])
        (sample, stamp), later = self._anchors
        if newest[0] > sample and newest[1] > stamp:
            self._dt = NANO * (newest[1] - stamp) / (newest[0] - sample)
        if newest[0] - later[0] > INTERVALS:
            self._anchors = [later, newest]

    def window(self, seconds: float) -> Window:
        """Return the last `seconds`, as far as available; at most half of the buffer."""
        with self._lock:
            size = min(max(1, round(seconds / self._dt)), self._capacity // 2)
            count = min(size, self._newest + 1)
            first = self._newest + 1 - count
            numbers: IntArray = np.arange(first, first + count, dtype=np.int64)
            slots = numbers % self._capacity
            here = self._number[slots] == numbers
            referred = self._referred[slots] == numbers
            return Window(
                first,
                self._dt,
                np.where(here, self._voltage[slots], np.nan),
                np.where(here, self._displacement[slots], np.nan),
                np.where(referred, self._reference[slots], np.nan),
            )


# Time without messages after which a source is lost [s].
SILENCE = 2.0
KEPT = 600


@dataclass(frozen=True)
class Gap:
    """Gap between model and measurement."""

    at: float  # time of reception [s, monotonic]
    rms: float  # gap
    floor: float  # noise floor [m]; their ratio is `floors`
    floors: float  # multiples of the noise floor
    frequency: float  # frequency of the drive [Hz]
    orders: tuple[int, ...]  # [m]
    harmonics: tuple[float, ...]  # [m]
    beyond: bool
    family: str  # possible causes of the gap


@dataclass(frozen=True)
class ShownEstimate:
    """State of an identification."""

    at: float  # when it was received [s, monotonic]
    model: str
    method: str
    message: str  # warnings
    names: tuple[str, ...]
    units: tuple[str, ...]  # SI units of the parameters
    values: tuple[float, ...]
    deviations: tuple[float, ...]  # standard deviations
    one_step: float  # [m]
    free_run: float  # [m]
    converged: bool  # whether it has converged


@dataclass(frozen=True)
class Counters:
    """Status of a node in the loop."""

    at: float  # when it was received [s, monotonic]
    sample: int  # newest tick
    rate: float  # ticks per second
    counts: dict[str, int]  # counters such as late, missed, refused


@dataclass(frozen=True)
class LogLine:
    """A message of a node in its log or diagnostics."""

    at: float  # when it was received [s, monotonic]
    node: str  # name of the node
    level: str  # ``ok``, ``warning`` or ``error``
    text: str  # text of the message


@dataclass(frozen=True)
class BackgroundJob:
    """A sweep, a discovery or an investigation."""

    phase: str = 'none'  # ``none``, ``asked``, ``running``, ``done`` or ``failed``
    fraction: float = 0.0  # completed share of the work
    text: str = ''  # current step, result, or reason of the failure
    effects: tuple[tuple[str, float], ...] = ()
    before: float = float('nan')
    after: float = float('nan')
    report: str = ''  # path of the report below the served folder, '' if there is none
    records: tuple[str, ...] = ()  # records of a sweep
    since: float = float('nan')  # time of the start [s, monotonic], NaN if unknown

    @property
    def busy(self) -> bool:
        """Whether it is running."""
        return self.phase in ('asked', 'running')


@dataclass(frozen=True)
class InvestigationState:
    """State of an investigation after an experiment."""

    number: int  # number of the experiment, 0 before the first
    experiment: str
    why: str  # reason of its selection
    answer: str  # its result
    chances: tuple[tuple[str, float], ...]  # probability of each explanation
    seconds: float  # actuator time so far [s]


@dataclass(frozen=True)
class NodeState:
    """A node of the namespace."""

    name: str  # name without the namespace
    present: bool  # whether it is running
    since: float  # time of the last change of `present` [s, monotonic]
    parameters: dict[str, ParameterState] = field(default_factory=dict)  # parameters by name


class Live:
    """State of the actuator in one namespace."""

    def __init__(self, actuator: str, clock: Callable[[], float] = time.monotonic) -> None:
        # clock [s]
        self.actuator = actuator
        self.clock = clock
        self.signals = Signals()
        self.frequency = 0.0  # of the reference [Hz]
        self.record_frequency = 0.0  # of the record of a sweep that runs
        self.record = ''
        self.received: dict[str, float] = {}
        self.published = False  # whether the state is published
        self.gaps: deque[Gap] = deque(maxlen=KEPT)
        self.estimates: deque[ShownEstimate] = deque(maxlen=KEPT)
        self.counters: dict[str, Counters] = {}
        self.diagnostics: dict[str, LogLine] = {}
        self.working: dict[str, float] = {}  # when a node last reported that it starts or compiles
        self.words: deque[LogLine] = deque(maxlen=50)
        self.nodes: dict[str, NodeState] = {}
        self.sweep = BackgroundJob()
        self.discovery = BackgroundJob()
        self.investigation = BackgroundJob()
        self.states: list[InvestigationState] = []  # of the newest investigation
        self.sweeps_offered = self.investigations_offered = False

    def note(self, topic: str) -> None:
        """Note that something was received."""
        self.received[topic] = self.clock()

    def silence(self, topic: str) -> float:
        """Return the time since the last message [s], infinite if there was none."""
        return self.clock() - self.received.get(topic, -float('inf'))

    @property
    def parameters(self) -> dict[str, dict[str, ParameterState]]:
        """Parameters by node, of the running nodes."""
        return {n.name: n.parameters for n in list(self.nodes.values()) if n.present}

    def parameter(self, node: str, name: str) -> ParameterState | None:
        """Return one parameter of a running node."""
        return self.parameters.get(node, {}).get(name)

    @property
    def fundamental(self) -> float:
        """Frequency of the drive [Hz], of the reference, the record or the voltage; 0 for none."""
        if self.silence('reference') < SILENCE:
            return self.frequency
        if self.record:
            return self.record_frequency
        mode, frequency = (self.parameter('excitation', name) for name in ('mode', 'frequency'))
        if mode and frequency and mode.value == 'voltage':
            return float(frequency.value)  # type: ignore[arg-type]
        return 0.0

    @property
    def resonance(self) -> float:
        """Natural frequency in the parameters of the nodes [Hz], 0 if unknown."""
        for estimate in list(self.estimates)[-1:]:
            if 'natural_frequency' in estimate.names:
                return estimate.values[estimate.names.index('natural_frequency')]
        for node, name in (
            ('gap_monitor', 'model.natural_frequency'),
            ('feedforward', 'model.natural_frequency'),
            ('attenuation', 'plant.natural_frequency'),
            ('feedback', 'plant.natural_frequency'),
        ):
            found = self.parameter(node, name)
            if found and isinstance(found.value, float) and found.value > 0.0:
                return found.value
        return 0.0
