"""What the identification node does with each sample and marker."""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from piezo_hysteresis.common.stamps import SequenceFilter, StampValidator
from piezo_hysteresis.errors import IdentificationError, PiezoError
from piezo_hysteresis.identification.method_settings import pairs
from piezo_hysteresis.identification.online import online, settled
from piezo_hysteresis.identification.recursion import Estimate, OnlineMethod
from piezo_hysteresis.identification.rls import RlsByOrder, RlsSettings, by_order
from piezo_hysteresis.identification.rls_ud import KINDS, OnlineUd, UdSettings
from piezo_hysteresis.models import Model, ModelFile, Provenance, named
from piezo_hysteresis.models.modelfile import OFFSET_NOTE
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.numerics.harmonics import odd_oscillation

# Samples between two memories, and how many memories are kept: seconds of a loop at 1 kHz.
EVERY = 1024
KEPT = 6

State = TypeVar('State')


class Sample(NamedTuple):
    """A sample of an actuator as received."""

    number: int
    nanoseconds: int
    voltage: float
    displacement: float


@dataclass(frozen=True)
class Checkpoint(Generic[State]):
    """The state of a recursion before the sample with arrival number `count`."""

    count: int
    nanoseconds: int
    state: State


class RollbackBuffer(Generic[State]):
    """Remembers the last samples, and now and then the state that they acted on."""

    def __init__(self, remember: Callable[[], State]) -> None:
        self._remember = remember
        self._memories: deque[Checkpoint[State]] = deque(maxlen=KEPT)
        self._samples: deque[Sample] = deque(maxlen=EVERY * KEPT)
        self._count = 0

    @property
    def newest(self) -> int:
        """Time of the newest sample [ns], -1 if there is none."""
        return self._samples[-1].nanoseconds if self._samples else -1

    def note(self, sample: Sample) -> None:
        """Remember a sample; call it before the sample acts."""
        if self._count % EVERY == 0:
            self._memories.append(Checkpoint(self._count, self.newest, self._remember()))
        self._samples.append(sample)
        self._count += 1

    def clear(self) -> None:
        """Clear the buffer; earlier samples cannot be rolled back."""
        self._memories.clear()
        self._samples.clear()
        self._count = 0

    def back_to(self, nanoseconds: int) -> tuple[Checkpoint[State], list[Sample]] | None:
        """Return the newest checkpoint before a time and the samples since; None if too old.

        Later checkpoints are discarded with their samples; store the samples again.
        """
        while self._memories and self._memories[-1].nanoseconds >= nanoseconds:
            self._memories.pop()
        if not self._memories:
            self.clear()
            return None
        memory = self._memories.pop()
        first = len(self._samples) - (self._count - memory.count)
        since = list(islice(self._samples, first, None))
        for _ in since:
            self._samples.pop()
        self._count = memory.count
        return memory, since


# Free runs of `rls` start at the beginning of the record; longer records have none [s].
LONGEST_RUN = 60.0

# An estimate is usable if its free run leaves less than this share of the motion.
_EXPLAINED = 0.5

# Key of the estimate of all drives.
_ALL = (0.0, 0.0)

# Edges that are remembered; more never lie within the samples that are.
MOST_EDGES = 4096

# Where the forgetting factor is left to the method.
FORGETTING = {'rls': 1.0, 'rls_ud': 0.9999, 'pi_bank': 0.9999}

_RLS = ('variant', 'offset', 'harmonic', 'frequency', 'unit', 'p0')
_UD = ('voltage_range', 'displacement_range', 'natural_frequency', 'damping_ratio', 'quiet')
SETTINGS = ('method', 'per_frequency', *_RLS, 'start', *_UD)


def forgetting_of(values: Mapping[str, Any]) -> float:
    """Return the forgetting factor in force; 0 leaves it to the method."""
    return float(values['forgetting']) or FORGETTING[values['method']]


def new_method(values: Mapping[str, Any]) -> OnlineMethod:
    """Return the method that the parameters of the node describe."""
    method = values['method']
    common: dict[str, Any] = {
        'forgetting': forgetting_of(values),
        'dt': 1.0 / float(values['rate']),
    }
    settings: RlsSettings | UdSettings
    if method == 'rls':
        start = pairs([assignment for assignment in values['start'] if assignment])
        settings = RlsSettings(**{name: values[name] for name in _RLS}, start=start, **common)
    else:
        settings = UdSettings(kind=KINDS[method], **{name: values[name] for name in _UD}, **common)
    recursion = online(method, settings)
    if not 0.5 < settings.forgetting <= 1.0:
        raise IdentificationError(
            f'forgetting = {settings.forgetting:g} remembers nothing; stay above 0.5, or give 0 '
            "for the method's own"
        )
    return recursion


@dataclass(frozen=True)
class SegmentEdge:
    """Start of a record with its drive and warm-up [s]; without a name, the end of a record."""

    nanoseconds: int
    record: str
    frequency: float = 0.0
    amplitude: float = 0.0
    warm_up: float = 0.0


@dataclass
class DriveEstimate:
    """The estimate of one drive, or of all."""

    method: OnlineMethod
    frequency: float = 0.0  # of the drive [Hz]
    amplitude: float = 0.0  # [V]; 0 for all drives
    low: float = math.inf  # [m]
    high: float = -math.inf  # [m]
    order: int = 0  # its harmonic order, see `odd_oscillation`
    before: Estimate | None = None  # the last published estimate
    converged: bool = False  # whether that was stationary and usable

    @property
    def travel(self) -> float:
        """Half the range of the displacement [m]."""
        return max(0.5 * (self.high - self.low), 0.0)


class RunSinceRest(NamedTuple):
    """Samples since the actuator was last at rest."""

    voltage: list[float]
    displacement: list[float]

    def cut(self, length: int) -> RunSinceRest:
        """Return its beginning."""
        return RunSinceRest(self.voltage[:length], self.displacement[:length])


class MethodState(NamedTuple):
    """What samples act on; the run is shared, and only its beginning belongs to the state."""

    drives: dict[tuple[float, float], DriveEstimate]
    key: tuple[float, float]
    refused: int
    taken: int
    open: bool
    warm_up: float
    run: RunSinceRest
    length: int


@dataclass
class RecordSegmenter:
    """Passes the samples within records to an online method; each record starts from rest.

    Without markers all samples are one record. Samples between records are omitted, as in the
    reader of bags. Markers have their own topic and may arrive after the samples that they mark;
    the estimate is then rolled back and recomputed. Markers cut by time. The time of a sample
    follows from its index if its stamp is inconsistent with the previous stamps.
    """

    method: OnlineMethod  # the online method
    rate: float  # sampling rate [Hz]
    only_records: bool = True  # whether samples between records are omitted
    renew: Callable[[], OnlineMethod] | None = None  # returns a method without prior information
    refused: int = 0  # samples omitted because a value is not finite
    taken: int = 0  # samples passed to the method
    late: int = 0  # markers that arrived too late for a rollback
    unseen: int = 0  # records whose harmonic exceeds half the sampling rate
    intake: SequenceFilter = field(default_factory=SequenceFilter)  # checks the sample indices
    _edges: deque[SegmentEdge] = field(default_factory=deque)
    _passed: deque[SegmentEdge] = field(default_factory=lambda: deque(maxlen=MOST_EDGES))
    _open: bool = True
    _run: RunSinceRest = field(default_factory=lambda: RunSinceRest([], []))
    _useless: bool = False
    _warm_up: float = 0.0

    def __post_init__(self) -> None:
        self._key = _ALL
        self._drives = {_ALL: DriveEstimate(self.method)}
        self.stamps = StampValidator(1.0 / self.rate)
        self._rollback: RollbackBuffer[MethodState] = RollbackBuffer(self._remember)

    def mark(self, edge: SegmentEdge) -> None:
        """Note an edge; it acts on the samples from its time on, had they come already or not."""
        known = self._edges or self._passed
        # Edges arrive in order; an earlier one belongs to a restarted actuator.
        follows = not known or (edge.nanoseconds >= known[-1].nanoseconds and edge != known[-1])
        self._edges.append(edge)
        if follows and edge.nanoseconds <= self._rollback.newest:
            self._take_back(edge)

    def take(self, sample: int, nanoseconds: int, voltage: float, displacement: float) -> bool:
        """Process a sample; return False if it is omitted."""
        known = self.intake.newest
        if sample != known + 1 and self._edge_due(nanoseconds):
            self.intake.newest = known = -1  # a record may begin at any number
            self.stamps.begin()
        if not self.intake.take(sample):
            return False
        came = Sample(sample, self.stamps.true_time(sample, nanoseconds), voltage, displacement)
        if sample < known or came.nanoseconds < self._rollback.newest:
            self._reset_samples()
        self._rollback.note(came)
        return self._feed(came, restarts=sample < known)

    def _edge_due(self, nanoseconds: int) -> bool:
        return bool(self._edges) and self._edges[0].nanoseconds <= nanoseconds

    def _feed(self, sample: Sample, restarts: bool = False) -> bool:
        _, nanoseconds, voltage, displacement = sample
        if restarts and not self._edge_due(nanoseconds):
            self._rest()
        while self._edges and self._edges[0].nanoseconds <= nanoseconds:
            edge = self._edges.popleft()
            self._passed.append(edge)
            self._note_order()
            self._open, self._warm_up = bool(edge.record), edge.warm_up
            self._rest()
            self._follow(edge)
        if self.only_records and not self._open:
            return False
        if not (math.isfinite(voltage) and math.isfinite(displacement)):
            self.refused += 1
            return False
        self.method.update(voltage, displacement)
        self.taken += 1
        drive = self.drive
        drive.low, drive.high = min(drive.low, displacement), max(drive.high, displacement)
        if len(self._run.voltage) < LONGEST_RUN * self.rate:
            self._run.voltage.append(voltage)
            self._run.displacement.append(displacement)
        return True

    def _follow(self, edge: SegmentEdge) -> None:
        """Use estimate and harmonic of the drive of a record, if its marker states one."""
        if edge.record and edge.frequency > 0.0:
            if self.renew is not None:
                self._key = edge.frequency, edge.amplitude
                if self._key not in self._drives:
                    method = by_order(self.renew())
                    self._drives[self._key] = DriveEstimate(method, *self._key)
                self.method = self.drive.method
                self.method.rest()
            try:
                self.method.drive_at(edge.frequency)
            except IdentificationError:
                self.unseen += 1

    def _take_back(self, edge: SegmentEdge) -> None:
        """Recompute the estimate from the samples since an edge."""
        found = self._rollback.back_to(edge.nanoseconds)
        if found is None:
            self.late += 1
            self._passed.clear()
            return
        memory, samples = found
        state = memory.state
        self._drives, self._key = state.drives, state.key
        self.method = self.drive.method
        self.refused, self.taken, self._open = state.refused, state.taken, state.open
        self._warm_up = state.warm_up
        self._run = state.run.cut(state.length)
        again = [each for each in self._passed if each.nanoseconds > memory.nanoseconds]
        for each in again:
            self._passed.remove(each)
        self._edges.extendleft(reversed(again))
        for sample in samples:
            self._rollback.note(sample)
            self._feed(sample)

    def _remember(self) -> MethodState:
        run = self._run
        return MethodState(
            copy.deepcopy(self._drives),
            self._key,
            self.refused,
            self.taken,
            self._open,
            self._warm_up,
            run,
            len(run.voltage),
        )

    def _reset_samples(self) -> None:
        self._rollback.clear()
        self._passed.clear()

    def set_forgetting(self, forgetting: float) -> None:
        """Continue with another forgetting factor."""
        self.method.forgetting = forgetting
        self._reset_samples()

    def change(self, method: OnlineMethod) -> None:
        """Continue with another method, without prior information."""
        self.method = method
        self._key, self._drives = _ALL, {_ALL: DriveEstimate(method)}
        self._reset_samples()

    def reset(self) -> None:
        """Reset the estimates and the records."""
        self.method = self._drives[_ALL].method
        self.method.reset()
        self._open = True
        self.change(self.method)

    def settled(self, estimate: Estimate, free_run: float = math.nan) -> bool:
        """Return whether the estimate has converged since the last call and is usable.

        One whose `free_run` rms [m] exceeds half the motion explains no drive: without one, the
        motion is the noise. Where it is not known any more (NaN) the last known one counts.
        """
        drive = self.drive
        if not math.isnan(free_run):
            motion = float(np.std(self._run.displacement or [0.0]))
            self._useless = not free_run <= _EXPLAINED * motion
        self._note_order()
        before, drive.before = drive.before, estimate
        drive.converged = (
            before is not None
            and before.names == estimate.names
            and settled(before, estimate)
            and not self._useless
        )
        return drive.converged

    def _note_order(self) -> None:
        """Take the harmonic order of the drive from the record so far, once it has a period."""
        drive, moved = self.drive, self._run.displacement
        seen = np.array(moved[round(self._warm_up * self.rate) :])
        if drive.frequency > 0.0 and seen.size * drive.frequency >= self.rate:
            drive.order = odd_oscillation(seen, drive.frequency, 1.0 / self.rate)
            if isinstance(drive.method, RlsByOrder):
                drive.method.order = drive.order

    @property
    def drive(self) -> DriveEstimate:
        """The present estimate with its drive."""
        return self._drives[self._key]

    def free_run_rms(self, estimate: Estimate) -> float:
        """Return the rms free-run error over the last second [m], NaN where it is not known."""
        if isinstance(self.method, OnlineUd):
            return estimate.one_step_rms  # its predictions are those of the free run
        count = len(self._run.voltage)
        if count < 2 or count >= LONGEST_RUN * self.rate:
            return math.nan
        with np.errstate(all='ignore'):
            free = self.method.free_run(np.array(self._run.voltage))
            last = slice(-round(self.rate), None)
            error = free[last] - np.array(self._run.displacement[last])
            rms = float(np.sqrt(np.nanmean(error**2)))
        return rms if math.isfinite(rms) else math.inf

    def model(self, estimate: Estimate) -> Model | None:
        """Return the chain whose parameters the method estimates, None where there is none."""
        if isinstance(self.method, OnlineUd):
            return self.method.model()
        return named(estimate.model) if estimate.model else None

    def model_file(self, fit: str) -> ModelFile:
        """Return the estimates as they are saved: the present one, and those of the drives.

        Drives whose estimate is no usable model are left out.
        """
        self._note_order()
        points = []
        for drive in self._drives.values():
            if drive.frequency > 0.0 and drive.amplitude > 0.0:
                with suppress(PiezoError):
                    own = self._model_of(drive, fit)
                    points.append(
                        OperatingPoint(
                            drive.frequency, drive.amplitude, drive.travel, drive.order, own
                        )
                    )
        if not points:
            return self._model_of(self.drive, fit)
        largest = max(points, key=lambda point: point.travel)
        return replace(largest.model, schedule=Schedule(tuple(points)))

    def _model_of(self, drive: DriveEstimate, fit: str) -> ModelFile:
        estimate = drive.method.estimate()
        model = self.model(estimate)
        if model is None:
            raise IdentificationError('no named model has the form of V0 with a harmonic; use V1')
        deviations = {
            name: float(value)
            for name, value in zip(estimate.names, estimate.standard_deviations, strict=True)
            if math.isfinite(value)
        }
        values = {**model.defaults(), **estimate.parameters()}
        notes: dict[str, Any] = {'samples': estimate.samples}
        if not isinstance(drive.method, OnlineUd):
            notes[OFFSET_NOTE] = 1.0 / self.rate  # it takes both signals of a tick together
        provenance = Provenance(fit=fit, rate=self.rate, notes=notes)
        return ModelFile(model, values, deviations, provenance)

    def _rest(self) -> None:
        self.method.rest()
        self._run = RunSinceRest([], [])
