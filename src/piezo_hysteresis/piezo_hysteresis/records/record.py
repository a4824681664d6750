"""One experiment at a constant rate: commanded input and measured displacement."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import sqrt
from numbers import Real
from typing import Any, ClassVar, SupportsIndex, overload

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.results import Plottable
from piezo_hysteresis.common.wording import counted, missing, not_numbers
from piezo_hysteresis.errors import RecordError


@dataclass(frozen=True)
class InputUncertainty:
    """Error that a measured input still has: harmonics of the drive, and the rest."""

    rms: float  # error of one sample [V or N]
    colour: float = 0.0  # correlation of the rest from one sample to the next
    period: float = 0.0  # samples per period of the drive; 0 if it has none
    orders: tuple[int, ...] = ()  # orders of the harmonics that were estimated
    term: float = 0.0  # rms error of the constant [V or N]
    rounding: float = 0.0  # rms of a wrong size of the drive by a converter [V or N]

    @property
    def rest(self) -> float:
        """Rms error of one sample without the harmonics [V or N]."""
        terms = 1 + 2 * len(self.orders)
        return sqrt(max(self.rms**2 - terms * self.term**2 - self.rounding**2, 0.0))

    def draw(
        self,
        voltage: FloatArray,
        repeats: int,
        generator: np.random.Generator,
        of_converter: float = 0.0,
    ) -> FloatArray:
        """Return such an error of an input in the mean of so many periods, shape (n,) [V or N].

        Where noise was removed, an input that rests does so exactly: its error stays the same.
        A converter reads a drive too large or too small by the same share in each record that
        reaches as far: `of_converter` is that in deviations.
        """
        from scipy.signal import lfilter  # imports more than all the rest together

        samples = voltage.size
        white = generator.standard_normal(samples) * sqrt((1.0 - self.colour**2) / repeats)
        error = self.rest * lfilter([1.0], [1.0, -self.colour], white)
        if self.colour:
            moved = np.diff(voltage, prepend=voltage[:1]) != 0.0
            error = error[np.maximum.accumulate(np.where(moved, np.arange(samples), 0))]
        error += self.term * generator.standard_normal()
        if self.rounding:
            error += (
                of_converter * self.rounding / float(np.std(voltage)) * (voltage - voltage.mean())
            )
        for order in self.orders:
            turn = 2.0 * np.pi / self.period * np.arange(samples)
            cosine, sine = sqrt(2.0) * self.term * generator.standard_normal(2)
            error += cosine * np.cos(order * turn) + sine * np.sin(order * turn)
        return np.asarray(error)


@dataclass(frozen=True)
class RecordInfo:
    """Metadata of an experiment.

    Attributes
    ----------
    actuator : str
        Name of the actuator, to detect two actuators in one bag.
    excitation : str
        Kind of waveform: ``sine``, ``triangle``, ``multisine``, ``rest``, ... or ``unknown``.
    frequency : float
        Fundamental frequency of the excitation [Hz]; 0 if there is none.
    amplitude : float
        Amplitude of the commanded input [V]; 0 if unknown.
    warm_up : float
        Time at the start that is excluded from errors [s].
    input_unit : str
        ``V`` for a voltage, ``N`` for a force (mechanical benchmarks).
    start : str
        Initial condition: ``rest``, ``step``, ``settled`` or ``estimate``; ``auto`` if unknown.
    """

    actuator: str = ''
    excitation: str = 'unknown'
    frequency: float = 0.0
    amplitude: float = 0.0
    warm_up: float = 0.0
    input_unit: str = 'V'
    start: str = 'auto'

    @property
    def input_name(self) -> str:
        """What the input is: voltage or force."""
        return 'force' if self.input_unit == 'N' else 'voltage'


@dataclass(frozen=True, eq=False, repr=False)
class Record(Plottable):
    """One experiment at a constant rate; records are compared by identity.

    ``voltage[k]`` is commanded at tick k; ``displacement[k]`` is measured at tick k, before that
    voltage acts. ``Record(voltage, displacement, dt)`` makes one from arrays; ``fs=`` replaces
    `dt`. ``record[100:200]`` are samples, ``record[0.5:1.5]`` the interval between two times [s].

    Attributes
    ----------
    name : str
        Unique within a data set; used in every table and figure.
    dt : float
        Sampling interval [s].
    voltage : ndarray, shape (n,)
        Commanded input [V] (or force [N], see ``info.input_unit``).
    displacement : ndarray, shape (n,)
        Measured displacement [m].
    start : float
        Time of the first sample [s].
    reference : ndarray, shape (n,), or None
        Desired displacement [m], if there is one.
    info : RecordInfo
        Metadata of the experiment.
    before : ndarray, shape (m,), or None
        Commanded input of the ticks before the first sample, from rest at 0 V on, if known: models
        of a record that starts by ``step`` are first run over it.
    input_uncertainty : InputUncertainty or None
        Error of the input, if it was measured; None for a command.
    second : ndarray, shape (n,), or None
        Second channel that follows the displacement, in any unit: another sensor, or the charge.

    Raises
    ------
    RecordError
        If the arrays have different lengths, are empty or not finite, ``dt`` is not positive, or
        the warm-up is negative or not finite.
    """

    _INSTEAD: ClassVar = {
        'voltage': 'u input',
        'displacement': 'y output position',
        'time': 't',
        'rate': 'fs sampling_rate samplerate',
        'dt': 'Ts',
        'len(record)': 'n size shape',
        'record[0.5:1.5], in seconds': 'trim crop slice',
        'resample(rate)': 'decimate downsample',
        'ph.write_bag(path, [record])': 'save',
        'info.frequency': 'frequency',
        'info.amplitude': 'amplitude',
    }

    name: str
    dt: float
    voltage: FloatArray
    displacement: FloatArray
    start: float = 0.0
    reference: FloatArray | None = None
    info: RecordInfo = field(default_factory=RecordInfo)
    before: FloatArray | None = None
    input_uncertainty: InputUncertainty | None = None
    second: FloatArray | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.dt, Real):
            raise RecordError(
                f'record {self.name}: the sampling interval must be a number [s], got {self.dt!r}'
            )
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise RecordError(
                f'record {self.name}: the sampling interval must be positive, got {self.dt} s'
            )
        if not (np.isfinite(self.info.warm_up) and self.info.warm_up >= 0):
            raise RecordError(
                f'record {self.name}: the warm-up must be 0 s or more, got {self.info.warm_up} s'
            )
        columns = {'voltage': self.voltage, 'displacement': self.displacement}
        if self.reference is not None:
            columns['reference'] = self.reference
        if self.second is not None:
            columns['second'] = self.second
        for key, column in columns.items():
            try:
                array = np.ascontiguousarray(column, dtype=np.float64)
            except (TypeError, ValueError):
                raise RecordError(
                    f'record {self.name}: {key} must be an array of numbers, not of type '
                    f'{type(column).__name__}'
                ) from None
            object.__setattr__(self, key, array)
            self._check_column(key, array)

    def _check_column(self, key: str, array: FloatArray) -> None:
        if array.ndim != 1 or array.size == 0:
            raise RecordError(
                f'record {self.name}: {key} is empty; record at least a few '
                'periods of the excitation'
            )
        if array.size != np.size(self.voltage):
            raise RecordError(
                f'record {self.name}: {key} has {counted(array.size, "sample")} but voltage '
                f'has {np.size(self.voltage)}; export both from the same clock'
            )
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            raise RecordError(
                f'record {self.name}: {key} has {counted(bad.size, "value")} that '
                f'{not_numbers(bad.size)}, the first at sample {bad[0]}; cut or mend them'
            )

    def __len__(self) -> int:
        return int(self.voltage.size)

    def __getitem__(self, part: slice) -> Record:
        if not isinstance(part, slice) or part.step not in (None, 1):
            raise RecordError(
                f'record {self.name}: record[100:200] are samples and record[0.5:1.5] seconds; '
                'record.voltage[5] is one sample, record.resample(rate) another rate'
            )
        first, last, _ = slice(self._sample(part.start), self._sample(part.stop)).indices(
            len(self)
        )
        return self.section(first, last)

    def _sample(self, edge: float | None) -> int | None:
        """Return the sample of an edge, which is a number of a sample or a time [s]."""
        if isinstance(edge, float):
            return max(round((edge - self.start) / self.dt), 0)
        return edge

    def resample(self, rate: float) -> Record:
        """Return the record at another rate [Hz], see `records.sampling.resampled`."""
        from piezo_hysteresis.records.sampling import resampled

        return resampled(self, rate)

    def __repr__(self) -> str:
        info = self.info
        drive = f', {info.excitation}' if info.excitation != 'unknown' else ''
        drive += f' of {info.frequency:g} Hz' if info.frequency > 0 else ''
        return (
            f'Record {self.name}: {counted(len(self), "sample")} at {self.rate:g} Hz, '
            f'{self.duration:g} s{drive}'
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return the samples by column, each of shape (n,): ``time_s``, ``voltage_V``, ..."""
        drive = 'force_N' if self.info.input_unit == 'N' else 'voltage_V'
        found = {'time_s': self.time, drive: self.voltage, 'displacement_m': self.displacement}
        return found if self.reference is None else {**found, 'reference_m': self.reference}

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.dt

    @property
    def time(self) -> FloatArray:
        """Time of each sample [s], shape (n,)."""
        return np.asarray(self.start + np.arange(len(self)) * self.dt, np.float64)

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return len(self) * self.dt

    @property
    def warm_up_samples(self) -> int:
        """Samples at the start that errors leave out."""
        return min(round(self.info.warm_up / self.dt), len(self) - 1)

    def section(self, first: int, last: int) -> Record:
        """Return samples ``first`` to ``last - 1`` as a record of their own."""
        cut = slice(first, last)
        return replace(
            self,
            voltage=self.voltage[cut],
            displacement=self.displacement[cut],
            reference=None if self.reference is None else self.reference[cut],
            second=None if self.second is None else self.second[cut],
            start=self.start + first * self.dt,
            before=None
            if self.before is None
            else np.concatenate([self.before, self.voltage[:first]]),
        )


class RecordList(list[Record]):
    """A list of records; a single one also offers the attributes and methods of a `Record`."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith('_') or (not hasattr(Record, name) and name not in _FIELDS):
            instead = missing(name, _KNOWN, Record._INSTEAD)
            raise AttributeError(f'records have no attribute {name!r}{instead}')
        if len(self) != 1:
            raise AttributeError(
                f'{counted(len(self), "record")}: records[0].{name} is that of the first one'
            )
        return getattr(self[0], name)

    @overload
    def __getitem__(self, part: SupportsIndex) -> Record: ...

    @overload
    def __getitem__(self, part: slice) -> RecordList: ...

    def __getitem__(self, part: Any) -> Any:
        found = super().__getitem__(part)
        if isinstance(part, slice) and self and not found and len(self) == 1:
            raise RecordError('there is one record; records[0][100:200] are its samples')
        return RecordList(found) if isinstance(part, slice) else found


_FIELDS = tuple(Record.__dataclass_fields__)
_KNOWN = [*_FIELDS, *(name for name in dir(Record) if not name.startswith('_'))]
_made = Record.__init__


def _make(self: Record, *given: Any, **named: Any) -> None:
    """Take ``(name, dt, voltage, displacement, ...)`` or ``(voltage, displacement, dt, name)``."""
    if 'fs' in named:
        named['dt'] = 1.0 / named.pop('fs')
    if given and not isinstance(given[0], str):
        if len(given) > 4:
            raise RecordError('give ph.Record(voltage, displacement, dt, name), the rest by name')
        order = ('voltage', 'displacement', 'dt', 'name')
        named = {**dict(zip(order, given, strict=False)), **named}
        given = ()
    if not given:
        named.setdefault('name', 'record')
        missing = [each for each in ('voltage', 'displacement', 'dt') if each not in named]
        if missing:
            raise RecordError(
                f'a record lacks {" and ".join(missing)}; '
                'give ph.Record(voltage, displacement, dt)'
            )
    _made(self, *given, **named)


Record.__init__ = _make  # type: ignore[method-assign]
