"""Which sample of which waveform a tick gets; knows no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.compensation.base import ReferencePoint
from piezo_hysteresis.waveforms import Sine, Waveform


@dataclass
class Experiment:
    """One waveform laid over the ticks of the loop.

    Attributes
    ----------
    waveform : Waveform
        Pure function of the time since `first`.
    first : int
        Tick at which it starts.
    rate : float
        Sampling rate [Hz].
    length : int
        Ticks it lasts; 0 has no end.
    """

    waveform: Waveform
    first: int
    rate: float
    length: int = 0

    def over(self, sample: int) -> bool:
        """Tell whether `sample` lies behind the end."""
        return self.length > 0 and sample - self.first >= self.length

    def point(self, sample: int) -> ReferencePoint:
        """Return the waveform at tick `sample`, in its own unit."""
        time = np.array([(sample - self.first) * (1.0 / self.rate)])
        s = self.waveform.sample(time)
        return ReferencePoint(
            sample,
            float(s.value[0]),
            float(s.velocity[0]),
            float(s.acceleration[0]),
            float(s.frequency[0]),
            float(s.phase[0]),
        )

    def retuned(self, frequency: float, amplitude: float, offset: float, sample: int) -> None:
        """Change a sinusoid from tick `sample` on; its phase stays continuous."""
        sine = self.waveform
        if not isinstance(sine, Sine):
            return
        elapsed = (sample - self.first) * (1.0 / self.rate)
        turned = 2.0 * math.pi * (sine.frequency - frequency) * elapsed
        self.waveform = replace(
            sine,
            frequency=frequency,
            amplitude=amplitude,
            offset=offset,
            phase=sine.phase + turned,
        )
