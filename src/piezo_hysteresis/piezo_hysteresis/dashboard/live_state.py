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
    """Gap between model and measurement.

    Attributes
    ----------
    at : float
        Time of reception [s, monotonic].
    rms, floor : float
        Gap and noise floor [m]; their ratio is `floors`.
    floors : float
        Multiples of the noise floor.
    frequency : float
        Frequency of the drive [Hz].
    orders, harmonics : tuple
        Rms at each harmonic order [m].
    beyond : bool
        Whether it is significantly above the noise floor and the known discrepancy of the model.
    family : str
        Possible causes of the gap.
    """

    at: float
    rms: float
    floor: float
    floors: float
    frequency: float
    orders: tuple[int, ...]
    harmonics: tuple[float, ...]
    beyond: bool
    family: str


@dataclass(frozen=True)
class ShownEstimate:
    """State of an identification.

    Attributes
    ----------
    at : float
        When it was received [s, monotonic].
    model, method, message : str
        Model, method and warnings.
    names, units : tuple of str
        Names and SI units of the parameters.
    values, deviations : tuple of float
        Values and standard deviations.
    one_step, free_run : float
        Rms errors [m].
    converged : bool
        Whether it has converged.
    """

    at: float
    model: str
    method: str
    message: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    one_step: float
    free_run: float
    converged: bool


@dataclass(frozen=True)
class Counters:
    """Status of a node in the loop.

    Attributes
    ----------
    at : float
        When it was received [s, monotonic].
    sample : int
        Newest tick.
    rate : float
        Ticks per second.
    counts : dict of str to int
        Counters such as late, missed, refused.
    """

    at: float
    sample: int
    rate: float
    counts: dict[str, int]


@dataclass(frozen=True)
class LogLine:
    """A message of a node in its log or diagnostics.

    Attributes
    ----------
    at : float
        When it was received [s, monotonic].
    node : str
        Name of the node.
    level : str
        ``ok``, ``warning`` or ``error``.
    text : str
        Text of the message.
    """

    at: float
    node: str
    level: str
    text: str


@dataclass(frozen=True)
class BackgroundJob:
    """A sweep or a discovery.

    Attributes
    ----------
    phase : str
        ``none``, ``asked``, ``running``, ``done`` or ``failed``.
    fraction : float
        Completed share of the work.
    text : str
        Current step, result, or reason of the failure.
    effects : tuple of (str, float)
        Named effects of a discovery with their probabilities.
    before, after : float
        Held-out gap of a discovery in multiples of the noise floor.
    report : str
        Path of the report below the served folder, '' if there is none.
    records : tuple of str
        Records of a sweep.
    since : float
        Time of the start [s, monotonic], NaN if unknown.
    """

    phase: str = 'none'
    fraction: float = 0.0
    text: str = ''
    effects: tuple[tuple[str, float], ...] = ()
    before: float = float('nan')
    after: float = float('nan')
    report: str = ''
    records: tuple[str, ...] = ()
    since: float = float('nan')

    @property
    def busy(self) -> bool:
        """Whether it is running."""
        return self.phase in ('asked', 'running')


@dataclass(frozen=True)
class InvestigationState:
    """State of an investigation at one time.

    Attributes
    ----------
    stage : str
        ``run``, ``judge`` or ``apply``.
    number : int
        Number of the experiment.
    experiment, why, answer : str
        Experiment, reason of its selection, and result of the previous one.
    chances : tuple of (str, float)
        Probability of each explanation.
    seconds : float
        Actuator time so far [s].
    """

    stage: str
    number: int
    experiment: str
    why: str
    answer: str
    chances: tuple[tuple[str, float], ...]
    seconds: float


@dataclass(frozen=True)
class NodeState:
    """A node of the namespace.

    Attributes
    ----------
    name : str
        Name without the namespace.
    present : bool
        Whether it is running.
    since : float
        Time of the last change of `present` [s, monotonic].
    parameters : dict of str to ParameterState
        Parameters by name; replaced as a whole, never changed.
    """

    name: str
    present: bool
    since: float
    parameters: dict[str, ParameterState] = field(default_factory=dict)


class Live:
    """State of the actuator in one namespace.

    Parameters
    ----------
    actuator : str
        Its namespace, '' for none.
    clock : callable
        Monotonic time [s].
    """

    def __init__(self, actuator: str, clock: Callable[[], float] = time.monotonic) -> None:
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
