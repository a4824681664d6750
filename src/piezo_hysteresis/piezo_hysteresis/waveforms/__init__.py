"""Excitations and references with analytic derivatives (neutral: no physics)."""

from piezo_hysteresis.waveforms.base import Samples, Waveform
from piezo_hysteresis.waveforms.sine import Sine

__all__ = ['Samples', 'Sine', 'Waveform']
