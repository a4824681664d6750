"""A sweep laid over the ticks of the loop, and its run."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import RecordInfo
from piezo_hysteresis.records.markers import CANCELLED, FAILED, REPEATED
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


# Messages of a sweep whose actuator restarts or stops: a client can start the sweep again.
ACTUATOR_RESTARTED = 'the actuator was restarted during the sweep; run it again'
NOT_RUNNING = 'the actuator or a link of the chain is not running; start it and set mode again'

# Largest number of repetitions of a record with a lost state.
MOST_REPEATS = 3


class Markers(Protocol):
    """Publishes, and records, where records begin and end."""

    def mark(self, record: SweepRecord, sample: int) -> None:
        """Mark that a record begins at tick `sample`."""

    def end(self, judged: str, verdict: str, sample: int) -> int:
        """Mark the end of a record at tick `sample`, or reject the record `judged` and why.

        Return the number of messages that the recording has accepted so far.
        """


@dataclass(frozen=True)
class Running:
    """A record, the tick of the loop at which it begins, and its last message in the bag."""

    record: SweepRecord
    first: int
    queued: int = 0

    @property
    def last(self) -> int:
        """Tick behind its end."""
        return self.first + self.record.voltages.size


class SweepRun:
    """Voltages and markers of a running sweep."""

    def __init__(self, sweep: Sweep, markers: Markers, *, recorded: bool = False) -> None:
        self.sweep = sweep
        self.kept: list[Running] = []
        self._markers = markers
        self._recorded = recorded
        self._open: Running | None = None
        self._closed: tuple[Running, bool] | None = None  # and whether it is complete
        self._repeats: Counter[int] = Counter()
        self._stepped: int | None = None
        # the newest complete run of states: `_since` to `_newest`
        self._since, self._newest = 0, -1
        # the voltage of the newest state, and the tick at which it changed last
        self._voltage, self._moved = math.nan, -1
        self.unmoved: list[str] = []

    def add_state(self, sample: int, voltage: float, *, kept: bool = True) -> None:
        """Add the state of tick `sample`; it is in the bag unless it was dropped."""
        if voltage != self._voltage:
            self._voltage, self._moved = voltage, sample
        if not kept:
            self._since = sample + 1
        elif sample != self._newest + 1:
            self._since = sample
        self._newest = sample

    def step(self, sample: int) -> float | None:
        """Return the voltage of tick `sample` [V], None after the end of the sweep."""
        sweep = self.sweep
        if self._stepped is not None and sample > self._stepped + 1:
            self._catch_up(self._stepped, sample)
        self._stepped = sample
        if sweep.over(sample) or sweep.starting(sample) is not None:
            self._judge(sample)
            record = sweep.starting(sample)
            if record is not None:
                self._open = Running(record, sample)
                self._markers.mark(record, sample)
            elif sweep.over(sample):
                return None
        elif self._open is not None and sweep.ending(sample):
            queued = self._markers.end('', '', sample)
            self._closed = (replace(self._open, queued=queued), self._is_whole(self._open))
            self._open = None
        return sweep.voltage(sample)

    def stop(self, sample: int, why: str = CANCELLED) -> None:
        """Return to rest from tick `sample` on; the record that runs does not count."""
        self.sweep.cancel(sample)
        closed, current = self._closed, self._open
        self._closed = self._open = None
        if closed is not None and closed[1]:
            self.kept.append(closed[0])
        if current is not None:
            self._markers.end(current.record.name, why, sample)

    def take_back(self, since: int, sample: int, why: str) -> None:
        """Do not count the records that had ticks from `since` on, after all."""
        for each in [each for each in self.kept if each.last > since]:
            self.kept.remove(each)
            self._markers.end(each.record.name, why, sample)

    def drop_unwritten(self, written: int) -> list[str]:
        """Do not count records beyond the `written` messages of the bag; return their names."""
        lost = [each for each in self.kept if each.queued > written]
        self.kept = [each for each in self.kept if each.queued <= written]
        return [each.record.name for each in lost]

    def _catch_up(self, last: int, sample: int) -> None:
        """Run the first record again that began or ended between ticks `last` and `sample`."""
        way_back = self.sweep.way_back
        if self._open is not None and sample > self._open.last:
            queued = self._markers.end('', '', sample)
            self._closed = (replace(self._open, queued=queued), self._is_whole(self._open))
            self._open = None
            if self._judge(sample, way_back, last):
                return
        for tick in range(last + 1, min(sample, last + 1 + self.sweep.length)):
            record = self.sweep.starting(tick)
            if record is not None and self._repeats[record.first] < MOST_REPEATS:
                self._repeats[record.first] += 1
                self.sweep.rest(sample, way_back, record, last)
                return

    def _judge(self, sample: int, ticks: int = 0, since: int | None = None) -> bool:
        """Accept the previous record, or repeat it in `ticks` if samples were lost.

        Return whether it is repeated.
        """
        if self._closed is None:
            return False
        (closed, is_whole), self._closed = self._closed, None
        if is_whole:
            self.kept.append(closed)
        elif self._repeats[closed.record.first] < MOST_REPEATS:
            self._repeats[closed.record.first] += 1
            self._markers.end(closed.record.name, REPEATED, sample)
            self.sweep.rest(sample, ticks, closed.record, since)
            return True
        else:
            self._markers.end(closed.record.name, FAILED, sample)
            if not self._has_moved(closed):
                self.unmoved.append(closed.record.name)
        return False

    def _is_whole(self, record: Running) -> bool:
        held = self._since <= record.first and self._newest >= record.last - 1
        return (held or not self._recorded) and self._has_moved(record)

    def _has_moved(self, record: Running) -> bool:
        """Return whether the actuator changed its voltage in a record that asks for it."""
        return self._moved > record.first or not np.ptp(record.record.voltages)


def kept_message(run: SweepRun, bag: str = '') -> str:
    """Return how many records of a sweep there are, where, and which were lost and why."""
    names = [each.record.name for each in run.kept]
    lost = [each.name for each in run.sweep.records if each.name not in (*names, *run.unmoved)]
    message = counted(len(names), 'record')
    message += f' in {bag}' if bag else ''
    message += f'; states of {", ".join(lost)} were lost' if lost else ''
    if run.unmoved:
        message += (
            f'; in {", ".join(run.unmoved)} the actuator did not change its voltage: check that '
            'it takes voltage/command'
        )
    return message
