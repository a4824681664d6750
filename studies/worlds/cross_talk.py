"""Cross-talk hidden in simulated stages of three axes, and stages without it.

    python studies/study.py cross_talk --seed 101

Each stage is drawn: gains, modes, noise and effects of each axis (hysteresis of two kinds, creep,
curved sensor, lag, hum, ...). A hidden cross-talk is 1 % of the motion of one axis, of random
sign, that another one reads, or a mode of the body that one axis drives and another moves with,
by 0.5 % at rest. The records are those of `python -m piezo_sim axes`: two levels of
nine realisations, of which four each have the same waveforms with other signs. `discover_axes`
gets the records alone. A stage counts as right if exactly the hidden pair is named, with the
right kind, and the frequency of a mode within 2 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from piezo_hysteresis.axes.axes_discovery import discover_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.cross_talk import CrossTalk
from piezo_sim.axes_plant import AxesPlant
from piezo_sim.axes_records import RECORDED, simulate_axes

QUICK: dict[str, Any] = {'hidden': 1, 'modes': 1, 'untouched': 1}
AXES, SIZE = 3, 0.01
# Through a mode: its motion at rest, its frequency [Hz] and damping, and how near it is named.
OF_MODE, FREQUENCIES, DAMPING, NEAR = 0.005, (200.0, 1200.0), (0.008, 0.03), 0.02
LEVELS = (0.1, 0.2)  # parts of the usual drive
REALISATIONS, PERIOD, BAND = 9, 0.5, (2.0, 1500.0)
SOMETIMES = (
    'creep', 'log_creep', 'electrostriction', 'sensor_nonlinearity', 'amplifier_lag',
    'rate_dependence', 'stiffness', 'asymmetry', 'flicker_noise', 'mains_hum', 'floor_vibration',
    'second_mode', 'quantisation',
)  # fmt: skip


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    add = parser.add_argument
    add('--hidden', type=int, default=20, help='stages with a hidden cross-talk')
    add('--modes', type=int, default=20, help='stages with cross-talk through a mode')
    add('--untouched', type=int, default=40, help='stages without')


def drawn(rng: np.random.Generator) -> dict[str, float | bool]:
    """Return random parameters and effects of each axis."""
    found: dict[str, float | bool] = {}
    for i in range(1, AXES + 1):
        frequency = float(np.exp(rng.uniform(np.log(200.0), np.log(800.0))))
        own: dict[str, float | bool] = {
            'actuator.gain': 2e-7 * rng.uniform(0.7, 1.3),
            'structure.natural_frequency': frequency,
            'structure.damping_ratio': rng.uniform(0.01, 0.05),
            'sensor.noise_rms': rng.uniform(0.5e-9, 5e-9),
            'mode_2.frequency': frequency * rng.uniform(1.5, 2.5),
        }
        if rng.random() < 0.5:
            own |= {'effects.play': False, 'effects.bouc_wen': True}
        own |= {f'effects.{name}': bool(rng.random() < 0.3) for name in SOMETIMES}
        found |= {f'axis_{i}.{name}': value for name, value in own.items()}
    return found


def records_of(plant: AxesPlant, seed: int) -> list[AxesRecord]:
    """Return the records of a stage."""
    found = []
    for part in LEVELS:
        level = part * plant.preset.voltage
        arrays = simulate_axes(plant, level, REALISATIONS, PERIOD, BAND, seed)
        for k in range(REALISATIONS):
            u, y = (each[:, :, k].transpose(2, 0, 1).reshape(-1, AXES) for each in arrays)
            name = f'{level:g}V/{k}'
            found.append(AxesRecord(name, 1.0 / plant.rate, u, y, RECORDED, f'{level:g}V'))
    return found


Hidden = tuple[int, int, float, float]  # voltage, displacement, size, frequency of a mode or 0


def hidden_in(changes: dict[str, float | bool], through: bool, rng: np.random.Generator) -> Hidden:
    """Hide cross-talk of one pair in a stage, static or through a mode; return what it is."""
    i, j = (int(each) + 1 for each in rng.permutation(AXES)[:2])
    sign = float(rng.choice([-1.0, 1.0]))
    if not through:
        changes |= {f'effects.cross_talk_{i}_to_{j}': True}
        changes |= {f'cross_talk.share_{i}_to_{j}': SIZE * sign}
        return i, j, SIZE * sign, 0.0
    frequency = float(np.exp(rng.uniform(*np.log(FREQUENCIES))))
    changes |= {'effects.body_1': True, 'body_1.frequency': frequency}
    changes |= {'body_1.damping_ratio': float(rng.uniform(*DAMPING))}
    for axis in range(1, AXES + 1):
        changes[f'body_1.drive_{axis}'] = 0.1 if axis == i else 0.0
        changes[f'body_1.motion_{axis}'] = 10.0 * OF_MODE * sign if axis == j else 0.0
    return i, j, OF_MODE * sign, frequency


def run(asked: argparse.Namespace) -> str:
    """Examine all stages, and return a table."""
    lines = ['| stage | hidden | named | right |', '|---|---|---|---|']
    kinds = ['hidden'] * asked.hidden + ['modes'] * asked.modes + ['untouched'] * asked.untouched
    right = dict.fromkeys(('hidden', 'modes', 'untouched'), 0)
    errors: dict[str, list[float]] = {'hidden': [], 'modes': []}
    for k, kind in enumerate(kinds):
        rng = np.random.default_rng([asked.seed, k])
        changes = drawn(rng)
        true = hidden_in(changes, kind == 'modes', rng) if kind != 'untouched' else None
        plant = AxesPlant.from_preset('xyz_stage', seed=k, overrides=changes)
        found = discover_axes(records_of(plant, k), 'gain').cross_talk
        is_right = is_found(found, true)
        right[kind] += is_right
        text = '; '.join(str(pair) for pair in found)
        truth = 'none'
        if true is not None:
            truth = f'{100.0 * true[2]:.2g} %, axis {true[0]} to {true[1]}'
            truth += f', {true[3]:.0f} Hz' if true[3] else ''
            if is_right:
                errors[kind].append(abs(found[0].size / true[2] - 1.0))
        lines.append(f'| {k} | {truth} | {text or "none"} | {"yes" if is_right else "no"} |')
    counts = ', '.join(
        f'{count} of {getattr(asked, name)} {name}' for name, count in right.items()
    )
    lines += ['', f'Right: {counts}.']
    for name, each in errors.items():
        if each:
            lines.append(
                f'Sizes ({name}) are within {max(each):.1%} of the truth, median '
                f'{np.median(each):.1%}.'
            )
    return '\n'.join(lines)


def is_found(found: Sequence[CrossTalk], true: Hidden | None) -> bool:
    """Return whether exactly what is hidden is named."""
    if true is None or len(found) != 1:
        return true is None and not found
    pair = found[0]
    near = abs(pair.frequency - true[3]) <= NEAR * true[3]
    return (pair.voltage, pair.displacement) == true[:2] and near
