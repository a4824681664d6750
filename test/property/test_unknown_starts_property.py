"""Twelve drives at any rate, range and stroke: a fit from an unknown start against a known one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record

pytestmark = pytest.mark.slow

SAMPLES, BEFORE = 4000, 800
# Noise of the sensor, as a share of the stroke.
NOISE = 1e-3


class Stage(NamedTuple):
    """A record from the virgin state, the part that a user has of it, and the noise [m]."""

    whole: Record
    part: Record
    noise: float


def _pieces(share: FloatArray, levels: FloatArray) -> FloatArray:
    return np.asarray(levels[np.minimum((share * len(levels)).astype(int), len(levels) - 1)])


def _drive(name: str, rng: np.random.Generator) -> FloatArray:
    """Return a drive within -1 to 1, shape (SAMPLES,)."""
    t = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
    turn = 2.0 * np.pi * t
    found: FloatArray
    if name == 'slow sine':
        found = np.sin(1.3 * turn)
    elif name == 'sine':
        found = np.sin(9.0 * turn)
    elif name == 'ramp':
        found = 2.0 * t - 1.0
    elif name == 'staircase':
        found = _pieces(t, rng.uniform(-1.0, 1.0, rng.integers(3, 8)))
    elif name == 'step':
        found = np.where(t < 0.3, -0.5, 0.8)
    elif name in ('one triangle', 'triangle'):
        found = 2.0 / np.pi * np.arcsin(np.sin((1.0 if name == 'one triangle' else 6.0) * turn))
    elif name == 'multisine':
        tones = [np.sin(f * turn + rng.uniform(0.0, 6.3)) for f in (2.0, 3.0, 5.0, 8.0)]
        found = np.sum(tones, axis=0)
    elif name == 'noise':
        walk = np.cumsum(rng.standard_normal(SAMPLES))
        found = walk - np.linspace(walk[0], walk[-1], SAMPLES)
    elif name == 'raster':
        share = (6.0 * t) % 1.0
        found = np.where(share < 0.9, share / 0.45 - 1.0, 1.0 - (share - 0.9) / 0.05)
    elif name == 'chirp':
        found = np.sin(turn * (2.0 + 6.0 * t))
    else:
        knots = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 1.0, 6)), [1.0]])
        found = np.round(np.interp(t, knots, rng.uniform(-1.0, 1.0, 8)), 2)
    return np.asarray(found / max(float(np.max(np.abs(found))), 1.0))


def stage(name: str, seed: int) -> Stage:
    """Return a record of a random actuator: 100 Hz to 100 kHz, 1 V to 1 kV, 10 nm to 1 mm."""
    rng = np.random.default_rng(seed)
    dt, reach = 10.0 ** rng.uniform(-5.0, -2.0), 10.0 ** rng.uniform(0.0, 3.0)
    stroke, unipolar = 10.0 ** rng.uniform(-8.0, -3.0), rng.random() < 0.5
    drive = _drive(name, rng)
    way = [0.0, rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0), float(drive[0])]
    before = np.interp(np.linspace(0.0, 1.0, BEFORE), [0.0, 0.4, 0.7, 1.0], way)
    u = reach * np.concatenate([before, drive])
    if unipolar:
        u = 0.5 * (u + reach)
        u[: BEFORE // 2] = np.linspace(0.0, u[BEFORE // 2], BEFORE // 2)
    model = named('prandtl_ishlinskii').hold(pi_range=reach)
    weights = [n for n in model.parameter_names if n.startswith('w')]
    shares = rng.uniform(0.5, 1.5, len(weights)) * np.where(np.arange(len(weights)) == 0, 10, 1)
    shares *= 0.5 * stroke / reach / shares.sum()
    values = {**model.defaults(), **dict(zip(weights, map(float, shares), strict=True))}
    y = np.concatenate([[0.0], model.respond(u, model.pack(values), dt)[:-1]])
    y += NOISE * stroke * rng.standard_normal(y.size)
    part = Record('part', dt, u[BEFORE:], y[BEFORE:])
    return Stage(Record('whole', dt, u, y), part, NOISE * stroke)


@pytest.mark.parametrize('seed', [11, 12])
@pytest.mark.parametrize(
    'name',
    [
        'slow sine', 'sine', 'ramp', 'staircase', 'step', 'one triangle', 'triangle', 'multisine',
        'noise', 'raster', 'chirp', 'by hand',
    ],
)  # fmt: skip
def test_an_unknown_start_costs_no_accuracy_or_is_stated(name: str, seed: int) -> None:
    made = stage(name, seed)
    known = ph.identify([made.whole], 'prandtl_ishlinskii', begins='step')
    run = ph.simulate(known, made.whole, begins='step')
    least = float(np.sqrt(np.mean((made.whole.displacement - run)[BEFORE:] ** 2)))
    found = ph.identify([made.part], 'prandtl_ishlinskii')
    (row,) = found.records
    error = made.part.displacement - ph.simulate(found, made.part)
    assert row.free_run_rms == float(np.sqrt(np.mean(error**2)))
    is_stated = any('do not determine' in each for each in found.warnings)
    assert row.free_run_rms <= 1.5 * least or is_stated
