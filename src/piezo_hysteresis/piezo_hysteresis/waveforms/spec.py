"""Waveforms from a mapping: one table for the command line, the nodes and the sweeps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezo_hysteresis.common.wording import near
from piezo_hysteresis.waveforms import sine as formulas
from piezo_hysteresis.waveforms.sine import GRIDS, Multisine, Sine, SineSum
from piezo_hysteresis.waveforms.waveform import (
    LAWS,
    Chirp,
    Decay,
    Sequence,
    Waveform,
    WaveformError,
)


@dataclass(frozen=True)
class Setting:
    """One setting of a kind of waveform.

    Attributes
    ----------
    name, unit, description : str
        Name, unit and description; the unit is ``1`` for dimensionless settings, ``unit`` for that
        of the signal.
    default : object
        Also defines the type; None for a required number.
    low, high : float
        Bounds of numbers.
    choices : tuple of str
        Allowed texts.
    """

    name: str
    unit: str
    default: Any
    description: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Kind:
    """One kind of waveform: its settings and how it is built from them."""

    name: str
    description: str
    settings: tuple[Setting, ...]
    build: Callable[..., Waveform]


_AMPLITUDE = Setting('amplitude', 'unit', 1.0, 'Amplitude.')
_FREQUENCY = Setting('frequency', 'Hz', 1.0, 'Frequency.', 1e-6, 1e6)
_DURATION = Setting('duration', 's', 10.0, 'Length.', 1e-6, 1e7)
_OFFSET = Setting('offset', 'unit', 0.0, 'Constant added.')
_PHASE = Setting('phase', 'rad', 0.0, 'Phase at the start.')
_RAMP = Setting('ramp', 's', 0.0, 'Time over which the amplitude rises.', 0.0, 1e6)
_SEED = Setting('seed', '1', 0, 'Seed of everything random.', 0)
_COMMON = (_AMPLITUDE, _DURATION, _OFFSET, _RAMP)


def _composite(frequencies: tuple[float, ...], weights: tuple[float, ...]) -> Any:
    def build(**settings: Any) -> Waveform:
        phases = np.random.default_rng(settings.pop('seed')).uniform(0.0, 2.0 * np.pi, 9)
        return SineSum(
            frequencies=frequencies,
            weights=weights,
            phases=tuple(map(float, phases[: len(frequencies)])),
            **settings,
        )

    return build


def _sum(**settings: Any) -> Waveform:
    count = len(settings['frequencies'])
    settings['weights'] = settings['weights'] or (1.0 / max(count, 1),) * count
    settings['phases'] = settings['phases'] or (0.0,) * count
    return SineSum(**settings)


def _sequence(parts: tuple[Any, ...]) -> Waveform:
    return Sequence(tuple(from_spec(part) for part in parts))


_ROWS = (
    Kind('sine', 'Sinusoid.', (*_COMMON, _FREQUENCY, _PHASE), Sine),
    Kind('triangle', 'Triangle.', (*_COMMON, _FREQUENCY, _PHASE), formulas.Triangle),
    Kind(
        'raster',
        'Fast axis of a scan: trace, retrace, and a smooth turn-around at either end.',
        (
            *_COMMON,
            _FREQUENCY,
            _PHASE,
            Setting('trace', '1', 0.5, 'Share of the period for the trace.', 1e-3, 0.999),
            Setting('turn', '1', 0.1, 'Share of the period for each turn-around.', 0.0, 0.5),
        ),
        formulas.Raster,
    ),
    Kind(
        'multisine',
        'Harmonics of one frequency with random phases; the amplitude is the peak.',
        (
            *_COMMON,
            _FREQUENCY,
            Setting('highest', 'Hz', 50.0, 'Highest line.', 1e-6, 1e6),
            Setting('grid', '1', 'full', 'Lines that are excited.', choices=GRIDS),
            _SEED,
        ),
        Multisine,
    ),
    Kind(
        'chirp',
        'Sine whose frequency runs from one value to another.',
        (
            *_COMMON,
            _FREQUENCY,
            Setting('highest', 'Hz', 100.0, 'Frequency at the end.', 1e-6, 1e6),
            Setting('law', '1', 'linear', 'How the frequency grows.', choices=LAWS),
        ),
        Chirp,
    ),
    Kind(
        'staircase',
        'Stairs up, down and back, each step held.',
        (
            _AMPLITUDE,
            _OFFSET,
            Setting('steps', '1', 5, 'Steps from the middle to the top.', 1, 10_000),
            Setting('hold', 's', 1.0, 'Length of a step.', 1e-6, 1e6),
            Setting('rise', 's', 0.0, 'Part of a step in which it is reached.', 0.0, 1e6),
        ),
        formulas.staircase,
    ),
    Kind(
        'step',
        'Step and hold; shows creep.',
        (
            _AMPLITUDE,
            _DURATION,
            _OFFSET,
            Setting('delay', 's', 0.5, 'Time of the step.', 0.0, 1e6),
        ),
        formulas.step_and_hold,
    ),
    Kind(
        'reversal_curves',
        'First-order reversal curves; show nonlocal memory.',
        (
            _AMPLITUDE,
            _OFFSET,
            Setting('curves', '1', 8, 'Number of curves.', 1, 10_000),
            Setting('rate', 'unit/s', 2.0, 'Speed along the curves.', 1e-12, 1e12),
        ),
        formulas.reversal_curves,
    ),
    Kind(
        'rest',
        'Constant level; shows drift, hum and noise alone.',
        (_DURATION, Setting('level', 'unit', 0.0, 'The level.')),
        formulas.rest,
    ),
    Kind(
        'lines',
        'Straight lines through given points; two of them at one time make a jump.',
        (
            Setting('times', 's', (0.0, 1.0), 'Times of the points, from 0 on.', 0.0, 1e7),
            Setting('values', 'unit', (0.0, 0.0), 'Values there; the last is held.'),
        ),
        formulas.Lines,
    ),
    Kind(
        'decay',
        'Sine that dies away, after which an actuator with memory has a defined remanence.',
        (*_COMMON, _FREQUENCY),
        Decay,
    ),
    Kind(
        'sum',
        'Sum of sinusoids, Zhou 2021 (9); equal weights where none are given.',
        (
            *_COMMON,
            Setting('frequencies', 'Hz', (1.0,), 'Frequency of each component.'),
            Setting('weights', '1', (), 'Weight of each component.'),
            Setting('phases', 'rad', (), 'Phase of each component.'),
        ),
        _sum,
    ),
    Kind(
        'composite_zhou2021_low',
        'The first composite of Zhou 2021: 20, 30 and 40 Hz.',
        (*_COMMON, _SEED),
        _composite((20.0, 30.0, 40.0), (0.4, 0.3, 0.3)),
    ),
    Kind(
        'composite_zhou2021_high',
        'The second composite of Zhou 2021: 40, 50 and 60 Hz.',
        (*_COMMON, _SEED),
        _composite((40.0, 50.0, 60.0), (0.4, 0.3, 0.3)),
    ),
    Kind(
        'composite_xiao2014',
        'Like the arbitrary sum of Xiao 2014, whose frequencies are not printed: 7, 19 and 43 Hz.',
        (*_COMMON, _SEED),
        _composite((7.0, 19.0, 43.0), (0.5, 0.3, 0.2)),
    ),
    Kind(
        'composite_fang2019',
        'Like the composite of Fang 2019 below 10 Hz, whose terms are not printed: 1, 5 and 10 '
        'Hz.',
        (*_COMMON, _SEED),
        _composite((1.0, 5.0, 10.0), (0.5, 0.3, 0.2)),
    ),
    Kind(
        'sequence',
        'Waveforms one after another.',
        (Setting('parts', '1', ({'kind': 'rest'},), 'Specification of each part.'),),
        _sequence,
    ),
)

KINDS: Mapping[str, Kind] = {row.name: row for row in _ROWS}
"""Every kind of waveform by name, for help texts and for `from_spec`."""


def from_spec(spec: Mapping[str, Any]) -> Waveform:
    """Return the waveform that a mapping such as ``{'kind': 'sine', 'frequency': 23}`` describes.

    Settings that are not given take the default of the table `KINDS`.

    Raises
    ------
    WaveformError
        If the kind or a setting is unknown, or a value of the wrong type or out of range.
    """
    if not isinstance(spec, Mapping):
        raise WaveformError(f'a waveform is a mapping with a kind, got {spec!r}')
    name = str(spec.get('kind'))
    if name not in KINDS:
        raise WaveformError(
            f'there is no waveform {name}{near(name, KINDS)}; there are {", ".join(KINDS)}'
        )
    kind = KINDS[name]
    known = {setting.name: setting for setting in kind.settings}
    stray = sorted(str(key) for key in spec if key != 'kind' and key not in known)
    if stray:
        raise WaveformError(
            f'the waveform {name} has no setting {stray[0]!r}{near(stray[0], known)}; '
            f'it has {", ".join(sorted(known))}'
        )
    settings = {
        setting.name: _checked(name, setting, spec.get(setting.name, setting.default))
        for setting in kind.settings
    }
    return kind.build(**settings)


def has_setting(kind: str, setting: str) -> bool:
    """Return whether the waveform `kind` has the `setting` at all."""
    return kind in KINDS and any(row.name == setting for row in KINDS[kind].settings)


def _checked(kind: str, setting: Setting, value: Any) -> Any:
    name = f'{setting.name} of the waveform {kind}'
    if setting.choices:
        if value not in setting.choices:
            raise WaveformError(
                f'the {name} is one of {", ".join(setting.choices)}, got {value!r}'
            )
        return value
    if isinstance(setting.default, tuple):
        if not isinstance(value, (list, tuple)):
            raise WaveformError(f'the {name} is a list, got {value!r}')
        numbers = setting.name != 'parts'
        return tuple(_number(name, setting, entry) if numbers else entry for entry in value)
    if isinstance(setting.default, int):
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
            raise WaveformError(f'the {name} is a whole number, got {value!r}')
        return int(_number(name, setting, int(value)))
    return _number(name, setting, value)


def _number(name: str, setting: Setting, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise WaveformError(f'the {name} is a number, got {value!r}')
    if not (math.isfinite(value) and setting.low <= value <= setting.high):
        raise WaveformError(
            f'the {name} must lie within {setting.low:g} .. {setting.high:g} {setting.unit}, '
            f'got {value!r}'
        )
    return float(value)
