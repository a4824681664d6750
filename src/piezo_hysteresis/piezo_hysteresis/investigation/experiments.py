"""One experiment: a record of its own that begins and ends at rest at 0 V.

It begins with a conditioning, a sine that dies away, after which the actuator remembers nothing of
what was before: all experiments begin with the same remanence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.investigation.limits import ExperimentLimits, fastest
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import from_spec

Spec = Mapping[str, Any]

# Of the conditioning: turns in which it dies away, and its frequency [Hz].
TURNS, CONDITIONING = 6, 10.0
# Time from rest to the middle of the range, where that is not 0 V [s].
APPROACH = 0.5
# Experiments that a limit makes smaller than this share of what was meant are not worth doing.
SMALLEST = 0.1
# Share of a limit that is used, so that rounding does not break it.
BELOW = 0.999
# Its speed is seen on a grid so much finer than the ticks.
FINER = 8
# A conditioning slower than this would take longer than the experiment [Hz].
SLOWEST = 0.5


@dataclass(frozen=True)
class PlannedExperiment:
    """An experiment of the catalogue.

    Attributes
    ----------
    name : str
        Unique within the catalogue.
    kind : str
        Waveform of its main part.
    parts : tuple of mapping
        Specification of each part; the middle of the range is not in it yet.
    frequency : float
        Of the drive [Hz], 0 where it does not repeat.
    amplitude : float
        Of the main part [V].
    prelude : float
        Time before the main part [s].
    seconds : float
        Length with its conditioning [s].
    """

    name: str
    kind: str
    parts: tuple[Spec, ...]
    frequency: float
    amplitude: float
    prelude: float
    seconds: float

    @property
    def spec(self) -> dict[str, Any]:
        """Specification of the whole as a waveform."""
        return {'kind': 'sequence', 'parts': [dict(part) for part in self.parts]}

    def voltage(self, rate: float) -> FloatArray:
        """Return the command of every tick [V]."""
        ticks = np.arange(round(self.seconds * rate), dtype=np.float64)
        return np.asarray(from_spec(self.spec).sample(ticks * (1.0 / rate)).value)

    @property
    def info(self) -> RecordInfo:
        """What is known of its record; errors leave the conditioning out."""
        return RecordInfo(
            excitation=self.kind,
            frequency=self.frequency,
            amplitude=self.amplitude,
            warm_up=self.prelude,
        )

    def record(self, name: str, measured: Record) -> Record:
        """Return a measured record under another name, with what is known of it."""
        info = replace(self.info, actuator=measured.info.actuator)
        return replace(measured, name=name, info=info)


def composed(
    name: str,
    main: Spec,
    seconds: float,
    limits: ExperimentLimits,
    rate: float,
    frequency: float = 0.0,
) -> PlannedExperiment | None:
    """Return an experiment within the limits; None where they leave too little of it.

    Parameters
    ----------
    name : str
        What to call it.
    main : mapping
        Specification of its main part, which begins and ends at its middle of 0 V; amplitudes
        must all be named ``amplitude`` or, of lines, ``values``.
    seconds : float
        Length of the main part [s].
    limits : ExperimentLimits
        What must be kept; amplitudes are made smaller for the slew.
    rate : float
        Ticks per second [Hz].
    frequency : float
        Of the drive [Hz], 0 where it does not repeat.
    """
    alone = _sampled((main,), seconds, FINER * rate)
    speed = fastest(alone, 1.0 / (FINER * rate))
    share = min(1.0, BELOW * limits.slew / speed) if speed > 0.0 else 1.0
    before = _prelude(limits)
    if share < SMALLEST or before is None:
        return None
    fitted = _scaled(main, share)
    middle = [] if limits.middle == 0.0 else [_line(limits.middle, 0.0, limits)]
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
    """Return the way to the middle of the range and the conditioning about it."""
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
    return (dying,) if limits.middle == 0.0 else (_line(0.0, limits.middle, limits), dying)


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
