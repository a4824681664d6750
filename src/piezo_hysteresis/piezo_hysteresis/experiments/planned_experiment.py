"""Experiments: records that start and end at rest, usually at 0 V.

An experiment starts with a conditioning, a decaying sine that removes the memory of the
hysteresis. All experiments thus start with the same remanence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from math import ceil, inf, isfinite
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import range_refusal
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import from_spec, reversal_curves

# Relative rounding of commands that does not violate a limit.
_ROUNDING = 1e-9


class InvestigationError(PiezoError):
    """An investigation cannot run with the given settings."""


@dataclass(frozen=True)
class ExperimentLimits:
    """Limits of every experiment."""

    low: float  # [V]
    high: float  # [V]
    slew: float = inf  # largest slew rate of the command [V/s]
    frequency: float = 100.0  # highest frequency of a drive [Hz]
    stroke: float = inf  # largest range of the displacement predicted by the model in use [m]
    heat: float = inf  # [V^2 Hz]
    rest: float = 0.0  # voltage before, between and after the experiments [V]

    def __post_init__(self) -> None:
        if reason := range_refusal(self.low, self.high):
            raise InvestigationError(reason)
        if not isfinite(self.rest):
            raise InvestigationError('the voltage at rest must be a finite number [V]')
        object.__setattr__(self, 'rest', min(max(self.rest, self.low), self.high))
        for name in ('slew', 'frequency', 'stroke', 'heat'):
            if not getattr(self, name) > 0.0:
                raise InvestigationError(f'the limit {name} must be above 0')
        if not isfinite(self.frequency):
            raise InvestigationError('the limit frequency must be a finite number [Hz]')

    @property
    def middle(self) -> float:
        """Center voltage of the experiments [V]."""
        return 0.5 * (self.low + self.high)

    @property
    def amplitude(self) -> float:
        """Largest amplitude about the center voltage [V]."""
        return 0.5 * (self.high - self.low)

    def refusal(self, voltage: FloatArray, dt: float) -> str:  # voltage (n,); dt [s]
        """Return the name of the violated limit, empty if there is none.

        The stroke is not checked.
        """
        slack = _ROUNDING * max(1.0, self.high - self.low)
        if float(voltage.min()) < self.low - slack or float(voltage.max()) > self.high + slack:
            return 'voltage'
        if fastest(voltage, dt, self.rest) > self.slew * (1.0 + _ROUNDING):
            return 'slew'
        return 'heat' if heat_of(voltage, dt) > self.heat else ''

    def to_dict(self) -> dict[str, float | None]:
        """Return plain numbers for JSON; None for an unlimited quantity."""
        return {k: v if isfinite(v) else None for k, v in asdict(self).items()}

    @classmethod
    def parse(cls, content: dict[str, float | None]) -> ExperimentLimits:
        """Return the limits from the output of `to_dict`."""
        return cls(**{k: inf if v is None else float(v) for k, v in content.items()})


def granted_range(
    asked: tuple[float, float], taken: tuple[float, float], model: ModelFile
) -> tuple[float, float]:
    """Return the voltage limits of an investigation [V]; requested limits are kept or rejected."""
    if asked == (0.0, 0.0):
        asked = known_range(*taken, model) if taken[0] < taken[1] else taken
        if not asked[0] < asked[1]:
            raise InvestigationError(
                'the actuator does not publish its voltage range: give low and high'
            )
    if reason := range_refusal(*asked):
        raise InvestigationError(reason)
    if not asked[0] <= 0.0 <= asked[1]:
        raise InvestigationError(
            f'the voltage limits {asked[0]:g} .. {asked[1]:g} V exclude 0 V, where nodes and '
            'controllers begin and end every experiment: include it, or investigate with '
            'ph.investigate, which begins and ends at the permitted voltage nearest to rest'
        )
    if taken[0] < taken[1] and not taken[0] <= asked[0] < asked[1] <= taken[1]:
        raise InvestigationError(
            f'the voltage limits {asked[0]:g} .. {asked[1]:g} V exceed the '
            f'{taken[0]:g} .. {taken[1]:g} V that the actuator takes: narrow them'
        )
    return asked


def known_range(low: float, high: float, model: ModelFile) -> tuple[float, float]:
    """Return the part of a voltage range [V] in which the model was evaluated.

    Outside it the discrepancy of the model is unknown. A range that extends below 0 V is used
    symmetrically.
    """
    conditions = model.discrepancy.conditions if model.discrepancy is not None else ()
    known = max((each.amplitude for each in conditions), default=inf)
    if low < 0.0 < high:
        return max(low, -known), min(high, known)
    return max(low, -2.0 * known), min(high, 2.0 * known)


def fastest(voltage: FloatArray, dt: float, rest: float = 0.0) -> float:
    """Return the largest slew rate of the commands [V/s], with the ways from and to `rest` [V]."""
    change = np.diff(voltage, prepend=rest, append=rest)
    return float(np.max(np.abs(change))) / dt


def heat_of(voltage: FloatArray, dt: float) -> float:
    """Return the mean of frequency times amplitude squared [V^2 Hz]; exact for whole sines."""
    moved = np.abs(np.diff(voltage)) * np.abs(0.5 * (voltage[1:] + voltage[:-1]))
    return float(np.sum(moved)) / (2.0 * voltage.size * dt)


Spec = Mapping[str, Any]

# Periods of the decaying conditioning signal, and its frequency [Hz].
TURNS, CONDITIONING = 6, 10.0
# Time from the voltage at rest to another center voltage [s].
APPROACH = 0.5
# Smallest permitted amplitude, as a share of the nominal one; smaller experiments are omitted.
SMALLEST = 0.1
# Share of a limit that is used, so that rounding does not break it.
BELOW = 0.999
# Oversampling factor for the slew rate, relative to the ticks.
FINER = 8
# Lowest frequency of the conditioning [Hz]; a slower one would take longer than the experiment.
SLOWEST = 0.5


@dataclass(frozen=True)
class PlannedExperiment:
    """An experiment of the catalogue."""

    name: str  # unique within the catalogue
    kind: str  # waveform of its main part
    parts: tuple[Spec, ...]  # specification of each part, relative to the center voltage
    frequency: float  # drive frequency [Hz], 0 for a non-periodic drive
    amplitude: float  # amplitude of the main part [V]
    prelude: float  # time before the main part [s]
    seconds: float  # duration including the conditioning [s]

    @property
    def spec(self) -> dict[str, Any]:
        """Waveform specification of the whole experiment."""
        return {'kind': 'sequence', 'parts': [dict(part) for part in self.parts]}

    def voltage(self, rate: float) -> FloatArray:
        """Return the command of every tick [V]."""
        ticks = np.arange(round(self.seconds * rate), dtype=np.float64)
        return np.asarray(from_spec(self.spec).sample(ticks * (1.0 / rate)).value)

    @property
    def info(self) -> RecordInfo:
        """Annotation of its record; the conditioning is the warm-up and not evaluated."""
        return RecordInfo(
            excitation=self.kind,
            frequency=self.frequency,
            amplitude=self.amplitude,
            warm_up=self.prelude,
        )

    def record(self, name: str, measured: Record) -> Record:
        """Return a measured record under another name, with the annotation of the experiment."""
        info = replace(self.info, actuator=measured.info.actuator)
        return replace(measured, name=name, info=info)


def composed(
    name: str,
    main: Spec,
    seconds: float,  # [s]
    limits: ExperimentLimits,
    rate: float,  # [Hz]
    frequency: float = 0.0,  # [Hz]
) -> PlannedExperiment | None:
    """Return an experiment within the limits, or None if they reduce it too much."""
    alone = _sampled((main,), seconds, FINER * rate)
    speed = fastest(alone, 1.0 / (FINER * rate))
    share = min(1.0, BELOW * limits.slew / speed) if speed > 0.0 else 1.0
    before = _prelude(limits)
    if share < SMALLEST or before is None:
        return None
    fitted = _scaled(main, share)
    at_rest = limits.middle == limits.rest
    middle = [] if at_rest else [_line(limits.middle, limits.rest, limits)]
    parts = (*before, _about(fitted, limits.middle), *middle)
    prelude = sum(_length(part) for part in before)
    found = PlannedExperiment(
        name,
        str(main['kind']),
        parts,
        frequency,
        float(np.max(np.abs(alone))) * share,
        prelude,
        prelude + seconds + sum(_length(part) for part in middle),
    )
    return None if limits.refusal(found.voltage(rate), 1.0 / rate) else found


def _sampled(parts: tuple[Spec, ...], seconds: float, rate: float) -> FloatArray:
    ticks = np.arange(max(2, round(seconds * rate)), dtype=np.float64)
    whole = from_spec({'kind': 'sequence', 'parts': list(parts)})
    return np.asarray(whole.sample(ticks * (1.0 / rate)).value)


def _length(part: Spec) -> float:
    return float(part['times'][-1] if part['kind'] == 'lines' else part['duration'])


def _prelude(limits: ExperimentLimits) -> tuple[Spec, ...] | None:
    """Return the transition to the center voltage and the conditioning about it."""
    amplitude = limits.amplitude
    frequency = min(
        CONDITIONING, limits.frequency, BELOW * limits.slew / (2.0 * np.pi * amplitude)
    )
    if frequency < SLOWEST:
        return None
    dying: Spec = {
        'kind': 'decay',
        'amplitude': BELOW * amplitude,
        'frequency': float(frequency),
        'duration': float(TURNS / frequency),
        'offset': limits.middle,
    }
    if limits.middle == limits.rest:
        return (dying,)
    return _line(limits.rest, limits.middle, limits), dying


def _line(first: float, last: float, limits: ExperimentLimits) -> Spec:
    length = max(APPROACH, abs(last - first) / (BELOW * limits.slew))
    return {'kind': 'lines', 'times': [0.0, length], 'values': [first, last]}


def _scaled(part: Spec, share: float) -> Spec:
    if part['kind'] == 'lines':
        return {**part, 'values': [share * value for value in part['values']]}
    return {**part, 'amplitude': share * part['amplitude']}


def _about(part: Spec, middle: float) -> Spec:
    if part['kind'] == 'lines':
        return {**part, 'values': [middle + value for value in part['values']]}
    return {**part, 'offset': middle}


# Drive frequencies of the sines [Hz], and their amplitudes relative to the largest.
DRIVES = (1.0, 2.0, 5.0, 10.0, 14.0, 20.0, 33.0, 50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0)
SHARES = (0.99, 0.5)
# Number of periods of a sine, and its shortest duration [s].
PERIODS, SHORTEST = 5, 1.0
# Smallest number of ticks per period of a sine.
FINEST = 6
# Hold times of the steps [s], and rise time without a slew limit [s].
HOLDS, RISE = (4.0, 12.0, 30.0), 0.005
RESTS = (5.0, 20.0)


def catalogue(limits: ExperimentLimits, rate: float) -> tuple[PlannedExperiment, ...]:  # rate [Hz]
    """Return every experiment within the limits, in a fixed order."""
    highest = min(limits.frequency, rate / FINEST)
    made = (
        composed(name, main, seconds, limits, rate, frequency)
        for name, main, seconds, frequency in _wanted(limits, highest)
    )
    found = tuple(each for each in made if each is not None)
    if not any(each.amplitude > 0.0 for each in found):
        raise InvestigationError(
            'these limits allow no experiment that moves the actuator: allow a faster slew, a '
            'higher frequency or more heat'
        )
    return found


def _wanted(limits: ExperimentLimits, highest: float) -> Iterator[tuple[str, Spec, float, float]]:
    """Yield name, main part, its duration [s] and drive frequency [Hz] of every experiment."""
    full = SHARES[0] * limits.amplitude
    for share in SHARES:
        for drive in (drive for drive in DRIVES if drive <= highest):
            length = ceil(max(PERIODS, SHORTEST * drive)) / drive
            yield _sine(f'sine {drive:g} Hz', share * limits.amplitude, drive, length, length / 5)
    drive = min(5.0, highest)
    length = ceil(3.0 * drive) / drive
    yield _sine(f'growing sine {drive:g} Hz', full, drive, length, length)
    slow = min(0.5, highest)
    triangle = {'kind': 'triangle', 'amplitude': full, 'frequency': slow, 'duration': 2.0 / slow}
    yield f'triangle {slow:g} Hz', triangle, 2.0 / slow, slow
    for share, top in ((0.5, highest), (0.25, highest)):
        yield _chirp(share * limits.amplitude, top)
    for hold in HOLDS:
        yield _step(full, hold, max(RISE, full / limits.slew))
    curves = reversal_curves(full, 4, min(8.0 * limits.amplitude, limits.slew))
    lines = {'kind': 'lines', 'times': list(curves.times), 'values': list(curves.values)}
    yield 'reversal curves', lines, curves.duration, 0.0
    for rest in RESTS:
        lines = {'kind': 'lines', 'times': [0.0, rest], 'values': [0.0, 0.0]}
        yield f'rest for {rest:g} s', lines, rest, 0.0


def _sine(
    name: str, amplitude: float, drive: float, length: float, ramp: float
) -> tuple[str, Spec, float, float]:
    main = {'kind': 'sine', 'amplitude': amplitude, 'frequency': drive, 'duration': length}
    return f'{name} at {amplitude:.3g} V', {**main, 'ramp': ramp}, length, drive


def _chirp(amplitude: float, highest: float) -> tuple[str, Spec, float, float]:
    first = min(1.0, 0.5 * highest)
    mean = 0.5 * (first + highest)
    length = ceil(4.0 * mean) / mean  # whole periods: the chirp ends at its center voltage
    main = {
        'kind': 'chirp', 'amplitude': amplitude, 'frequency': first, 'highest': highest,
        'duration': length, 'ramp': 0.2,
    }  # fmt: skip
    return f'chirp to {highest:g} Hz at {amplitude:.3g} V', main, length, 0.0


def _step(amplitude: float, hold: float, rise: float) -> tuple[str, Spec, float, float]:
    times = [0.0, 0.2, 0.2 + rise, 0.2 + rise + hold, 0.2 + 2.0 * rise + hold]
    values = [0.0, 0.0, amplitude, amplitude, 0.0]
    main = {'kind': 'lines', 'times': times, 'values': values}
    return f'step to {amplitude:.3g} V held for {hold:g} s', main, times[-1], 0.0
