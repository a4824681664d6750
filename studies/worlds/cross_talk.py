"""Cross-talk hidden in simulated stages of three axes, and stages without it.

    python studies/study.py cross_talk --seed 101

Each stage is drawn: gains, modes, noise and effects of each axis (hysteresis of two kinds, creep,
curved sensor, lag, hum, ...). A hidden cross-talk is 1 % of the motion of one axis, of random
sign, that another one reads. The records are those of `python -m piezo_sim axes`: two levels of
nine realisations, of which four each have the same waveforms with other signs. `discover_axes`
gets the records alone. A stage counts as right if exactly the hidden pair is named.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from piezo_hysteresis.axes.axes_discovery import discover_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_sim.axes_plant import AxesPlant
from piezo_sim.axes_records import RECORDED, simulate_axes

QUICK: dict[str, Any] = {'hidden': 1, 'untouched': 1}
AXES, SIZE = 3, 0.01
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


def run(asked: argparse.Namespace) -> str:
    """Examine all stages, and return a table."""
    lines = ['| stage | hidden | named | right |', '|---|---|---|---|']
    right = {'hidden': 0, 'untouched': 0}
    errors: list[float] = []
    for k in range(asked.hidden + asked.untouched):
        rng = np.random.default_rng([asked.seed, k])
        changes = drawn(rng)
        true: tuple[tuple[int, int], ...] = ()
        if k < asked.hidden:
            i, j = (int(each) + 1 for each in rng.permutation(AXES)[:2])
            size = SIZE * rng.choice([-1.0, 1.0])
            changes |= {f'effects.cross_talk_{i}_to_{j}': True}
            changes |= {f'cross_talk.share_{i}_to_{j}': size}
            true = ((i, j),)
        plant = AxesPlant.from_preset('xyz_stage', seed=k, overrides=changes)
        found = discover_axes(records_of(plant, k), 'gain')
        named = tuple((pair.voltage, pair.displacement) for pair in found.cross_talk)
        is_right = named == true
        right['hidden' if true else 'untouched'] += is_right
        text = '; '.join(str(pair).removeprefix('cross_talk: ') for pair in found.cross_talk)
        truth = f'{100.0 * size:.2g} %, axis {i} to {j}' if true else 'none'
        lines.append(f'| {k} | {truth} | {text or "none"} | {"yes" if is_right else "no"} |')
        if true and is_right:
            errors.append(abs(found.cross_talk[0].size / size - 1.0))
    hidden, untouched = (f'{right[name]} of {getattr(asked, name)}' for name in right)
    lines += ['', f'Right: {hidden} hidden, {untouched} untouched.']
    if errors:
        lines.append(
            f'Sizes are within {max(errors):.1%} of the truth, median {np.median(errors):.1%}.'
        )
    return '\n'.join(lines)
