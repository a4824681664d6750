"""State of the page for one actuator; one thread writes it, others read it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from piezo_hysteresis.dashboard.controls import ParameterState
from piezo_hysteresis.dashboard.live_signals import Signals

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
    """A sweep or a discovery."""

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
    """State of an investigation at one time."""

    stage: str  # ``run``, ``judge`` or ``apply``
    number: int  # number of the experiment
    experiment: str
    why: str  # reason of its selection
    answer: str  # result of the previous one
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
        self.sweeps_offered = self.discoveries_offered = self.investigations_offered = False

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
