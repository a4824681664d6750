"""Waveforms one after another."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.waveforms.waveform import Samples, Waveform, WaveformError


@dataclass(frozen=True)
class Sequence:
    """Waveforms in sequence; the phase continues from the previous one.

    Attributes
    ----------
    parts : tuple of Waveform
        At least one; each runs for its duration, the last one continues.
    """

    parts: tuple[Waveform, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise WaveformError('a sequence needs at least one part')

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(sum(part.duration for part in self.parts))

    def sample(self, time: FloatArray) -> Samples:
        """Return the sequence at `time` [s]."""
        time = np.asarray(time, dtype=np.float64)
        starts = np.cumsum([0.0, *(part.duration for part in self.parts[:-1])])
        chosen = np.clip(np.searchsorted(starts, time, side='right') - 1, 0, len(self.parts) - 1)
        columns = {entry.name: np.zeros_like(time) for entry in fields(Samples)}
        phase = 0.0
        for index, (part, start) in enumerate(zip(self.parts, starts, strict=True)):
            mask = chosen == index
            samples = part.sample(time[mask] - start)
            for name, column in columns.items():
                column[mask] = getattr(samples, name)
            columns['phase'][mask] += phase
            phase += float(part.sample(np.array([part.duration])).phase[0])
        return Samples(**columns)
