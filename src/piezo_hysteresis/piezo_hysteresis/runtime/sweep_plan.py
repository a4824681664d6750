"""A sweep laid over the ticks of the loop: record after record, rest in between."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import RecordInfo
from piezo_hysteresis.waveforms import Waveform, WaveformError, from_spec, has_setting

# After a record the voltage goes back to rest over this time [s].
RETURN = 0.1

# Every voltage of a sweep is kept, so it must not be endless.
LARGEST = 20_000_000
MOST_RECORDS = 1000
# Above the voltage of every piezo amplifier [V].
HIGHEST = 1e5


@dataclass(frozen=True)
class SweepRecord:
    """One record of a sweep."""

    name: str  # unique within the sweep
    info: RecordInfo  # content of the marker
    first: int  # tick of the sweep at which it starts
    voltages: FloatArray  # voltage of each tick [V], shape (n,)

    @property
    def last(self) -> int:
        """Tick behind its end."""
        return self.first + self.voltages.size


class Sweep:
    """Every record of a sweep, and the voltage of every tick."""

    def __init__(
        self,
        frequencies: Sequence[float],  # [Hz]
        amplitudes: Sequence[float],  # [V]
        seconds: float,  # [s]
        rate: float,  # [Hz]
        *,
        warm_up: float = 0.0,  # [s]
        pause: float = 0.0,  # [s]
        waveform: str = 'sine',
        options: Mapping[str, object] | None = None,
    ) -> None:
        _check(frequencies, amplitudes, seconds, rate, warm_up, pause)
        self.rate = rate
        self.records: list[SweepRecord] = []
        self._start: int | None = None
        self._cancelled_at: tuple[int, float] | None = None
        self._left_at, self._left_voltage, self._again, self._left_ticks = 0, 0.0, 0, 1
        gap = self.gap = round((RETURN + pause) * rate)
        first = 0
        for amplitude in amplitudes:
            for frequency in frequencies:
                settings = {'frequency': frequency, 'amplitude': amplitude, 'duration': seconds}
                shape = waveform_of(waveform, settings, options or {}, rate)
                info = RecordInfo(
                    excitation=waveform, frequency=frequency, amplitude=amplitude, warm_up=warm_up
                )
                name = f'{waveform}_{frequency:g}Hz_{amplitude:g}V'
                record = SweepRecord(name, info, first, _voltages(shape, seconds, rate))
                self.records.append(record)
                first = record.last + gap
        self.length = first
        self._largest, self._change = _pace(self.records)
        slow = self._largest / self._change if self._change > 0.0 else 0.0
        self.way_back = max(round(RETURN * rate), math.ceil(slow))

    def start(self, sample: int, voltage: float = 0.0) -> None:
        """Start the sweep at tick `sample` of the loop.

        If the sweep would step from the present `voltage` [V], the actuator is first brought to
        rest.
        """
        self._start = sample
        if abs(voltage) > self._change:
            share = abs(voltage) / self._largest if self._largest > 0.0 else 1.0
            self._left_ticks = math.ceil(max(share, 1.0) * self.way_back)
            self._left_at, self._left_voltage = sample, voltage
            self._again = self._start = sample + self._left_ticks

    def rest(self, sample: int, ticks: int, record: SweepRecord, since: int | None = None) -> None:
        """Go to rest from tick `sample` on, and begin `record` (again) `ticks` later.

        The voltage is that of tick `since`, by default of the one before.
        """
        self._left_at = sample
        self._left_voltage = self.voltage(sample - 1 if since is None else since)
        self._left_ticks = self.way_back
        self._again = sample + ticks
        self._start = self._again - record.first

    def cancel(self, sample: int) -> None:
        """Return to rest from tick `sample` on."""
        if self._cancelled_at is None:
            self._cancelled_at = (sample, self.voltage(sample - 1))

    def over(self, sample: int) -> bool:
        """Return whether tick `sample` is after the end."""
        if self._cancelled_at is not None:
            return sample >= self._cancelled_at[0] + self.way_back
        return not self._rests(sample) and self._place(sample) >= self.length

    def starting(self, sample: int) -> SweepRecord | None:
        """Return the record that starts at tick `sample`."""
        place = self._place(sample)
        if self._cancelled_at is not None or self._rests(sample):
            return None
        return next((record for record in self.records if record.first == place), None)

    def ending(self, sample: int) -> bool:
        """Return whether `sample` is the first tick behind a record."""
        if self._cancelled_at is not None:
            return sample == self._cancelled_at[0]
        return not self._rests(sample) and any(
            record.last == self._place(sample) for record in self.records
        )

    def running(self, sample: int) -> SweepRecord:
        """Return the record that tick `sample` belongs to, or that follows it."""
        place = self._place(sample)
        return next((r for r in self.records if place < r.last), self.records[-1])

    def voltage(self, sample: int) -> float:
        """Return the voltage of tick `sample` [V]."""
        if self._cancelled_at is not None and sample >= self._cancelled_at[0]:
            return _back(sample, *self._cancelled_at, self.way_back)
        if self._rests(sample):
            return _back(sample, self._left_at, self._left_voltage, self._left_ticks)
        place = self._place(sample)
        for record in self.records:
            if place < record.first:
                return 0.0
            if place < record.last:
                return float(record.voltages[place - record.first])
            ended = (place - record.last + 1) / round(RETURN * self.rate)
            if ended < 1.0:
                return float(record.voltages[-1]) * (1.0 - ended)
        return 0.0

    def seconds_left(self, sample: int) -> float:
        """Return the time until the end [s]."""
        return max(0.0, (self.length - self._place(sample)) / self.rate)

    @property
    def extremes(self) -> tuple[float, float]:
        """Least and greatest voltage [V]."""
        least = min(float(np.min(record.voltages)) for record in self.records)
        return min(0.0, least), max(
            0.0, *(float(np.max(record.voltages)) for record in self.records)
        )

    def _rests(self, sample: int) -> bool:
        return self._left_at <= sample < self._again

    def _place(self, sample: int) -> int:
        return sample - (self._start or 0)


def waveform_of(
    kind: str, settings: Mapping[str, float], options: Mapping[str, object], rate: float
) -> Waveform:
    """Return the waveform called `kind` with those of `settings` that it has."""
    known = {name: value for name, value in settings.items() if has_setting(kind, name)}
    merged = {**known, **options}
    for name in ('frequency', 'highest'):
        value = merged.get(name, 0.0)
        if isinstance(value, int | float) and value >= 0.5 * rate:
            raise WaveformError(
                f'{name} = {value:g} Hz cannot be sampled at {rate:g} Hz: stay below '
                f'{0.5 * rate:g} Hz'
            )
    return from_spec({'kind': kind, **merged})


def narrowed(low: float, high: float, least: float, most: float) -> str:
    """Return the range of an actuator, and the remedy for a drive of `low` .. `high` [V]."""
    takes = f'the actuator takes {least:g} .. {most:g} V'
    if high - low > most - least:
        return f'{takes}: ask for a smaller amplitude'
    shift = 0.5 * (least + most - low - high)
    return (
        f'{takes}: add an offset of {shift:g} V (options "{{offset: {shift:g}}}" of a sweep, '
        'voltage.offset in mode voltage)'
    )


def parse_options(text: str) -> dict[str, object]:
    """Return the settings of a waveform that were written as YAML; none for no text."""
    try:
        options = plain_yaml.load(text) if text.strip() else {}
    except yaml.YAMLError as error:
        raise WaveformError(f'the options are no YAML: {" ".join(str(error).split())}') from None
    if not isinstance(options, dict) or not all(isinstance(name, str) for name in options):
        raise WaveformError(f'the options are a mapping such as {{seed: 3}}, got {text!r}')
    return options


def _voltages(waveform: Waveform, seconds: float, rate: float) -> FloatArray:
    time = np.arange(round(seconds * rate), dtype=np.float64) * (1.0 / rate)
    return np.asarray(waveform.sample(time).value, dtype=np.float64)


def _back(sample: int, since: int, voltage: float, ticks: int) -> float:
    """Return the voltage on the way from `voltage` to rest, left at tick `since`, in `ticks`."""
    return voltage * max(0.0, 1.0 - (sample - since + 1) / ticks)


def _pace(records: Sequence[SweepRecord]) -> tuple[float, float]:
    """Return the largest voltage of records, and its largest change from tick to tick [V]."""
    largest = max(float(np.max(np.abs(record.voltages))) for record in records)
    changes = (np.diff(record.voltages, prepend=0.0, append=0.0) for record in records)
    return largest, max(float(np.max(np.abs(change))) for change in changes)


def _check(
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    seconds: float,
    rate: float,
    warm_up: float,
    pause: float,
) -> None:
    if not frequencies or not amplitudes:
        raise RecordError('a sweep needs at least one frequency and one amplitude')
    fields = {
        'frequencies': frequencies, 'amplitudes': amplitudes, 'seconds': [seconds],
        'rate': [rate], 'warm_up': [warm_up], 'pause': [pause],
    }  # fmt: skip
    for name, numbers in fields.items():
        for number in numbers:
            if not (math.isfinite(number) and number >= 0):
                raise RecordError(f'{name} of a sweep must be finite and not below 0: {number:g}')
    if max(amplitudes) > HIGHEST:
        raise RecordError(f'amplitudes of a sweep must not exceed {HIGHEST:g} V')
    records = len(frequencies) * len(amplitudes)
    if records > MOST_RECORDS:
        raise RecordError(f'a sweep of more than {MOST_RECORDS} records: give fewer')
    if (seconds + pause + RETURN) * rate * records > LARGEST:
        longest = 'seconds' if seconds > pause else 'pause'
        raise RecordError(
            f'a sweep of more than {LARGEST} samples: give fewer records or less {longest}'
        )
    if round(seconds * rate) < 2:
        raise RecordError(f'records of {seconds:g} s at {rate:g} Hz are empty: give more seconds')
    if warm_up >= seconds:
        raise RecordError(f'a warm-up of {warm_up:g} s leaves nothing of records of {seconds:g} s')
