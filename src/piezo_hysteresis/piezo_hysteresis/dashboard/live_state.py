"""State of the page for one actuator; one thread writes it, others read it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from piezo_hysteresis.dashboard.controls import ParameterState
from piezo_hysteresis.dashboard.live_signals import Signals

# Silence after which something counts as lost [s].
SILENCE = 2.0
KEPT = 600


@dataclass(frozen=True)
class Gap:
    """How far model and measurement are apart.

    Attributes
    ----------
    at : float
        When it was received [s, monotonic].
    rms, floor : float
        [m]; their ratio is `floors`.
    floors : float
        Multiples of the noise floor.
    frequency : float
        Of the drive [Hz].
    orders, harmonics : tuple
        Rms at each harmonic order [m].
    beyond : bool
        Whether it is significantly above the floor and what the model is known to miss.
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
        Of what, how, and warnings.
    names, units : tuple of str
        Of the parameters, SI.
    values, deviations : tuple of float
        And their standard deviations.
    one_step, free_run : float
        Rms errors [m].
    converged : bool
        Whether it has settled.
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
        Late, missed, refused and so on.
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
        Who.
    level : str
        ``ok``, ``warning`` or ``error``.
    text : str
        What.
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
        Of the whole work.
    text : str
        What is being done, what came out, or why not.
    effects : tuple of (str, float)
        Of a discovery: what was named, with its probability.
    before, after : float
        Of a discovery: held-out gap in multiples of the noise floor.
    report : str
        Path of the report below the folder that is served, '' where there is none.
    records : tuple of str
        Of a sweep: its records.
    since : float
        When it was started [s, monotonic], NaN where that is not known.
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
        """Whether it goes on."""
        return self.phase in ('asked', 'running')


@dataclass(frozen=True)
class InvestigationState:
    """State of an investigation at one time.

    Attributes
    ----------
    stage : str
        ``run``, ``judge`` or ``apply``.
    number : int
        Of the experiment.
    experiment, why, answer : str
        Which, why it was chosen, and what the one before answered.
    chances : tuple of (str, float)
        How likely each explanation is.
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
        Without its namespace.
    present : bool
        Whether it is there now.
    since : float
        Since when it is, or is not [s, monotonic].
    parameters : dict of str to ParameterState
        By name; replaced as a whole, never changed.
    """

    name: str
    present: bool
    since: float
    parameters: dict[str, ParameterState] = field(default_factory=dict)


class Live:
    """What is known of the actuator in one namespace.

    Parameters
    ----------
    actuator : str
        Its namespace, '' for none.
    clock : callable
        Seconds that only grow.
    """

    def __init__(self, actuator: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.actuator = actuator
        self.clock = clock
        self.signals = Signals()
        self.frequency = 0.0  # of the reference [Hz]
        self.record_frequency = 0.0  # of the record of a sweep that runs
        self.record = ''
        self.received: dict[str, float] = {}
        self.published = False  # whether somebody publishes the state
        self.gaps: deque[Gap] = deque(maxlen=KEPT)
        self.estimates: deque[ShownEstimate] = deque(maxlen=KEPT)
        self.counters: dict[str, Counters] = {}
        self.diagnostics: dict[str, LogLine] = {}
        self.working: dict[str, float] = {}  # when a node last said that it starts or compiles
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
        """Return for how long nothing was received [s], infinite where it never was."""
        return self.clock() - self.received.get(topic, -float('inf'))

    @property
    def parameters(self) -> dict[str, dict[str, ParameterState]]:
        """Parameters by node, of those that are there."""
        return {n.name: n.parameters for n in list(self.nodes.values()) if n.present}

    def parameter(self, node: str, name: str) -> ParameterState | None:
        """Return one parameter of a node that is there."""
        return self.parameters.get(node, {}).get(name)

    @property
    def fundamental(self) -> float:
        """Frequency of the drive [Hz]: of the reference, the record or the voltage; 0 for none."""
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
