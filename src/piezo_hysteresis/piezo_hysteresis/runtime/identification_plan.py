"""What the identification node does with each sample and marker."""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.common.stamps import SequenceFilter, StampValidator
from piezo_hysteresis.errors import IdentificationError, PiezoError
from piezo_hysteresis.identification.method_settings import pairs
from piezo_hysteresis.identification.online import RECURSIONS, settled
from piezo_hysteresis.identification.recursion import Estimate, OnlineMethod
from piezo_hysteresis.identification.rls import BY_ORDER, OnlineRls
from piezo_hysteresis.models import ModelFile, Provenance
from piezo_hysteresis.models.modelfile import OFFSET_NOTE
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.numerics.harmonics import odd_oscillation

# Samples between two copies of the state, and how many are kept: seconds of a loop at 1 kHz.
EVERY = 1024
KEPT = 6

# Free runs of `rls` start at the beginning of the record; longer records have none [s].
LONGEST_RUN = 60.0

# An estimate is usable if its free run leaves less than this share of the motion.
_EXPLAINED = 0.5

# Key of the estimate of all drives.
_ALL = (0.0, 0.0)

# Edges that are remembered; more never lie within the samples that are.
MOST_EDGES = 4096

# Parameters of the node that describe its method; the settings of the methods have their names.
_OF_METHODS = {f.name for each in RECURSIONS.values() for f in fields(each.Settings)}
SETTINGS = {'method', 'per_frequency', *_OF_METHODS} - {'forgetting', 'dt'}


def forgetting_of(values: Mapping[str, Any]) -> float:
    """Return the forgetting factor in force; 0 leaves it to the method."""
    return float(values['forgetting']) or RECURSIONS[values['method']].Settings.forgetting


def new_method(values: Mapping[str, Any]) -> OnlineMethod:
    """Return the method that the parameters of the node describe."""
    method, forgetting = RECURSIONS[values['method']], forgetting_of(values)
    given = {f.name: values[f.name] for f in fields(method.Settings) if f.name in values}
    given |= {'forgetting': forgetting, 'dt': 1.0 / float(values['rate'])}
    if 'start' in given:
        given['start'] = pairs([assignment for assignment in given['start'] if assignment])
    recursion = method(method.Settings(**given))
    if not 0.5 < forgetting <= 1.0:
        raise IdentificationError(
            f'forgetting = {forgetting:g} remembers nothing; stay above 0.5, or give 0 for the '
            "method's own"
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


class DriveEstimate:
    """The estimate of one drive, or of all.

    Which harmonic order a drive has is known only from its record: with `by_order`, the papers'
    RLS also runs with the third and the fifth, so that the estimate is the one of `identify`
    whenever the order becomes known.
    """

    def __init__(
        self, method: OnlineMethod, frequency: float = 0.0, amplitude: float = 0.0
    ) -> None:
        self.rows = {0: method}  # by harmonic order
        self.frequency = frequency  # of the drive [Hz]
        self.amplitude = amplitude  # [V]; 0 for all drives
        self.low, self.high = math.inf, -math.inf  # [m]
        self.order = 0  # its harmonic order, see `odd_oscillation`
        self.before: Estimate | None = None  # the last published estimate

    @property
    def method(self) -> OnlineMethod:
        """The recursion of the harmonic order of the drive."""
        return self.rows.get(self.order, self.rows[0])

    @property
    def travel(self) -> float:
        """Half the range of the displacement [m]."""
        return max(0.5 * (self.high - self.low), 0.0)

    def by_order(self) -> None:
        """Add the harmonics of the drive where RLS has a named model for each."""
        method = self.rows[0]
        if not isinstance(method, OnlineRls):
            return
        plain = method.settings
        if plain.variant == 'V1' and plain.harmonic == 0 and not plain.start:
            for order in filter(None, BY_ORDER):
                with suppress(IdentificationError):  # above half the rate
                    settings = replace(plain, harmonic=order, frequency=self.frequency)
                    self.rows[order] = OnlineRls(settings)


@dataclass
class SegmenterState:
    """What samples and markers act on; lists of the run since rest only grow."""

    drives: dict[tuple[float, float], DriveEstimate]
    key: tuple[float, float] = _ALL
    open: bool = True
    warm_up: float = 0.0  # [s]
    refused: int = 0  # samples omitted because a value is not finite
    taken: int = 0  # samples passed to the method
    voltage: list[float] = field(default_factory=list)  # since the actuator was at rest [V]
    displacement: list[float] = field(default_factory=list)  # [m]


class ReceivedSample(NamedTuple):
    """A sample of an actuator as received."""

    nanoseconds: int
    voltage: float  # [V]
    displacement: float  # [m]


class Checkpoint(NamedTuple):
    """A copy of the state, and the samples that came after it."""

    before: int  # time of the last sample before [ns]
    state: SegmenterState
    length: int  # of the run since rest at that time
    samples: list[ReceivedSample]


class RecordSegmenter:
    """Passes the samples within records to an online method; each record starts from rest.

    Without markers all samples are one record. Samples between records are omitted, as in the
    reader of bags. Markers have their own topic and may arrive after the samples that they mark;
    the state is then the copy from before them, and the samples since are processed again.
    Markers cut by time. The time of a sample follows from its index if its stamp is inconsistent
    with the previous stamps.
    """

    def __init__(
        self,
        method: OnlineMethod,
        rate: float,  # sampling rate [Hz]
        only_records: bool = True,  # whether samples between records are omitted
        renew: Callable[[], OnlineMethod] | None = None,  # returns a method without prior
    ) -> None:
        self.rate, self.only_records, self.renew = rate, only_records, renew
        self.late = 0  # markers that arrived too late
        self.unseen = 0  # records whose harmonic exceeds half the sampling rate
        self.intake = SequenceFilter()  # checks the sample indices
        self.stamps = StampValidator(1.0 / rate)
        self._edges: deque[SegmentEdge] = deque()
        self._passed: deque[SegmentEdge] = deque(maxlen=MOST_EDGES)
        self._past: deque[Checkpoint] = deque(maxlen=KEPT)
        self._useless = False
        self.state = SegmenterState({_ALL: DriveEstimate(method)})

    @property
    def drive(self) -> DriveEstimate:
        """The present estimate with its drive."""
        return self.state.drives[self.state.key]

    @property
    def method(self) -> OnlineMethod:
        """The recursion of the present drive."""
        return self.drive.method

    def mark(self, edge: SegmentEdge) -> None:
        """Note an edge; it acts on the samples from its time on, had they come already or not."""
        known = self._edges or self._passed
        # Edges arrive in order; an earlier one belongs to a restarted actuator.
        follows = not known or (edge.nanoseconds >= known[-1].nanoseconds and edge != known[-1])
        self._edges.append(edge)
        if follows and edge.nanoseconds <= self._newest:
            self._take_back(edge)

    def take(self, sample: int, nanoseconds: int, voltage: float, displacement: float) -> bool:
        """Process a sample; return False if it is omitted."""
        known = self.intake.newest
        if sample != known + 1 and self._edge_due(nanoseconds):
            self.intake.newest = known = -1  # a record may begin at any number
            self.stamps.begin()
        if not self.intake.take(sample):
            return False
        time = self.stamps.true_time(sample, nanoseconds)
        came = ReceivedSample(time, voltage, displacement)
        if sample < known or came.nanoseconds < self._newest:
            self._discard_past()
        return self._feed(came, restarts=sample < known)

    @property
    def _newest(self) -> int:
        """Time of the newest sample that can be processed again [ns], -1 if there is none."""
        return self._past[-1].samples[-1].nanoseconds if self._past else -1

    def _remember(self, sample: ReceivedSample) -> None:
        """Keep a sample before it acts, and every so often the state."""
        if not self._past or len(self._past[-1].samples) == EVERY:
            state = replace(self.state, drives=copy.deepcopy(self.state.drives))
            self._past.append(Checkpoint(self._newest, state, len(state.voltage), []))
        self._past[-1].samples.append(sample)

    def _edge_due(self, nanoseconds: int) -> bool:
        return bool(self._edges) and self._edges[0].nanoseconds <= nanoseconds

    def _feed(self, sample: ReceivedSample, restarts: bool = False) -> bool:
        self._remember(sample)
        nanoseconds, voltage, displacement = sample
        if restarts and not self._edge_due(nanoseconds):
            self._rest()
        while self._edges and self._edges[0].nanoseconds <= nanoseconds:
            edge = self._edges.popleft()
            self._passed.append(edge)
            self._note_order()
            self.state.open, self.state.warm_up = bool(edge.record), edge.warm_up
            self._rest()
            self._follow(edge)
        state = self.state
        if self.only_records and not state.open:
            return False
        if not (math.isfinite(voltage) and math.isfinite(displacement)):
            state.refused += 1
            return False
        drive = self.drive
        for method in drive.rows.values():
            method.update(voltage, displacement)
        state.taken += 1
        drive.low, drive.high = min(drive.low, displacement), max(drive.high, displacement)
        if len(state.voltage) < LONGEST_RUN * self.rate:
            state.voltage.append(voltage)
            state.displacement.append(displacement)
        return True

    def _follow(self, edge: SegmentEdge) -> None:
        """Use estimate and harmonic of the drive of a record, if its marker states one."""
        if not edge.record or edge.frequency <= 0.0:
            return
        if self.renew is not None:
            key = self.state.key = edge.frequency, edge.amplitude
            if key not in self.state.drives:
                self.state.drives[key] = DriveEstimate(self.renew(), *key)
                self.drive.by_order()
            self._rest_drive()
        try:
            for method in self.drive.rows.values():
                method.drive_at(edge.frequency)
        except IdentificationError:
            self.unseen += 1

    def _take_back(self, edge: SegmentEdge) -> None:
        """Return to the state before an edge, and process the samples since again."""
        samples: list[ReceivedSample] = []
        past = None
        while self._past and (past is None or past.before >= edge.nanoseconds):
            past = self._past.pop()
            samples = past.samples + samples
        if past is None or past.before >= edge.nanoseconds:
            self.late += 1
            self._passed.clear()
            return
        voltage, displacement = past.state.voltage, past.state.displacement
        self.state = replace(
            past.state, voltage=voltage[: past.length], displacement=displacement[: past.length]
        )
        again = [each for each in self._passed if each.nanoseconds > past.before]
        for each in again:
            self._passed.remove(each)
        self._edges.extendleft(reversed(again))
        for sample in samples:
            self._feed(sample)

    def _discard_past(self) -> None:
        self._past.clear()
        self._passed.clear()

    def set_forgetting(self, forgetting: float) -> None:
        """Continue with another forgetting factor, that of every drive."""
        for drive in self.state.drives.values():
            for method in drive.rows.values():
                method.forgetting = forgetting
        self._discard_past()

    def change(self, method: OnlineMethod) -> None:
        """Continue with another method, without prior information."""
        state = self.state
        state.key, state.drives = _ALL, {_ALL: DriveEstimate(method)}
        self._discard_past()

    def reset(self) -> None:
        """Reset the estimates and the records."""
        method = self.state.drives[_ALL].method
        method.reset()
        self.state.open = True
        self.change(method)

    def settled(self, estimate: Estimate, free_run: float = math.nan) -> bool:
        """Return whether the estimate has converged since the last call and is usable.

        One whose `free_run` rms [m] exceeds half the motion explains no drive: without one, the
        motion is the noise. Where it is not known any more (NaN) the last known one counts.
        """
        drive = self.drive
        if not math.isnan(free_run):
            motion = float(np.std(self.state.displacement or [0.0]))
            self._useless = not free_run <= _EXPLAINED * motion
        self._note_order()
        before, drive.before = drive.before, estimate
        return (
            before is not None
            and before.names == estimate.names
            and settled(before, estimate)
            and not self._useless
        )

    def _note_order(self) -> None:
        """Take the harmonic order of the drive from the record so far, once it has a period."""
        drive = self.drive
        seen = np.array(self.state.displacement[round(self.state.warm_up * self.rate) :])
        if drive.frequency > 0.0 and seen.size * drive.frequency >= self.rate:
            drive.order = odd_oscillation(seen, drive.frequency, 1.0 / self.rate)

    def free_run_rms(self, estimate: Estimate) -> float:
        """Return the rms free-run error over the last second [m], NaN where it is not known."""
        if self.method.predicts_freely:
            return estimate.one_step_rms
        count = len(self.state.voltage)
        if count < 2 or count >= LONGEST_RUN * self.rate:
            return math.nan
        with np.errstate(all='ignore'):
            free = self.method.free_run(np.array(self.state.voltage))
            last = slice(-round(self.rate), None)
            error = free[last] - np.array(self.state.displacement[last])
            rms = float(np.sqrt(np.nanmean(error**2)))
        return rms if math.isfinite(rms) else math.inf

    def model_file(self, fit: str) -> ModelFile:
        """Return the estimates as they are saved: the present one, and those of the drives.

        Drives whose estimate is no usable model are left out.
        """
        self._note_order()
        points = []
        for drive in self.state.drives.values():
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
        model = drive.method.model()
        if model is None:
            raise IdentificationError('no named model has the form of V0 with a harmonic; use V1')
        deviations = {
            name: float(value)
            for name, value in zip(estimate.names, estimate.standard_deviations, strict=True)
            if math.isfinite(value)
        }
        values = {**model.defaults(), **estimate.parameters()}
        notes: dict[str, Any] = {'samples': estimate.samples}
        if not drive.method.predicts_freely:
            notes[OFFSET_NOTE] = 1.0 / self.rate  # it takes both signals of a tick together
        provenance = Provenance(fit=fit, rate=self.rate, notes=notes)
        return ModelFile(model, values, deviations, provenance)

    def _rest(self) -> None:
        self._rest_drive()
        self.state.voltage, self.state.displacement = [], []

    def _rest_drive(self) -> None:
        for method in self.drive.rows.values():
            method.rest()
