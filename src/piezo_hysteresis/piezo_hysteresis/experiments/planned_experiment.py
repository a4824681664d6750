"""Experiments: records that start and end at rest, usually at 0 V.

An experiment starts with a conditioning, a decaying sine that removes the memory of the
hysteresis. All experiments thus start with the same remanence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.experiments.experiment_limits import ExperimentLimits, fastest
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import from_spec

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
