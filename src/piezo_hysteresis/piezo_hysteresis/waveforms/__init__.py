"""Excitations and references with analytic derivatives (neutral: no physics)."""

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.waveforms.sine import (
    Lines,
    Multisine,
    Raster,
    Sine,
    SineSum,
    Triangle,
    rest,
    reversal_curves,
    staircase,
    step_and_hold,
)
from piezo_hysteresis.waveforms.spec import KINDS, Kind, Setting, from_spec, has_setting
from piezo_hysteresis.waveforms.waveform import (
    Chirp,
    Decay,
    Samples,
    Sequence,
    Shaped,
    Waveform,
    WaveformError,
)

__all__ = [
    'KINDS',
    'Chirp',
    'Decay',
    'Kind',
    'Lines',
    'Multisine',
    'PiezoError',
    'Raster',
    'Samples',
    'Sequence',
    'Setting',
    'Shaped',
    'Sine',
    'SineSum',
    'Triangle',
    'Waveform',
    'WaveformError',
    'from_spec',
    'has_setting',
    'rest',
    'reversal_curves',
    'staircase',
    'step_and_hold',
]
