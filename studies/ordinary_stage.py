"""A piezo stage that shares no equation and no code with piezo_sim or the models.

Hysteresis of Preisach type with a density that is linear in the mean voltage, solved by its
Everett function over the stack of past extremes; creep by a chain of relaxations whose strength
follows a power of their time constant; one mode, exact for held voltages; a sensor with white
noise and a finite resolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import scipy.linalg

from piezo_hysteresis.arrays import FloatArray

# Largest number of turns that a drive can leave behind.
_DEEPEST = 4096


@dataclass(frozen=True)
class Draw:
    """What distinguishes one stage from another."""

    low: float = 0.0  # [V]
    high: float = 100.0  # [V]
    stroke: float = 14e-6  # displacement of the whole range [m]
    rate: float = 10e3  # sampling rate [Hz]
    mode: float = 800.0  # natural frequency [Hz]
    damping: float = 0.012  # damping ratio
    hysteresis: float = 0.25
    skew: float = 0.2
    creep: float = 0.02  # creep of a decade of time as a share of the displacement
    growth: float = 0.0  # its power of time
    noise: float = 3.6e-9  # rms noise of the sensor [m]

    @property
    def middle(self) -> float:
        """Centre of the range [V]."""
        return 0.5 * (self.low + self.high)

    @property
    def span(self) -> float:
        """Width of the range [V]."""
        return self.high - self.low


#: The stage on which methods are calibrated.
CALIBRATION = Draw()


def drawn(seed: int) -> Draw:
    """Return another stage: range, stroke, rate, mode, hysteresis, creep and noise are drawn."""
    rng = np.random.default_rng((54, seed))
    high = float(np.exp(rng.uniform(math.log(1.5), math.log(800.0))))
    low = float(rng.choice([0.0, -high, -0.2 * high]))
    rate = float(np.exp(rng.uniform(math.log(2e3), math.log(25e3))))
    stroke = float(np.exp(rng.uniform(math.log(1e-6), math.log(300e-6))))
    return Draw(
        low, high, stroke, rate,
        mode=rate * rng.uniform(0.03, 0.12),
        damping=rng.uniform(0.006, 0.03),
        hysteresis=rng.uniform(0.15, 0.35),
        skew=rng.uniform(-0.5, 0.5),
        creep=rng.uniform(0.005, 0.03),
        growth=rng.uniform(-0.1, 0.1),
        noise=stroke * 10.0 ** rng.uniform(-4.0, -3.3),
    )  # fmt: skip


class Stage:
    """The stage of a draw; it exchanges voltage for displacement tick by tick."""

    def __init__(self, draw: Draw, seed: int = 0) -> None:
        self.draw, self.seed = draw, seed
        dt, omega = 1.0 / draw.rate, 2.0 * math.pi * draw.mode
        system = np.zeros((3, 3))
        system[:2] = [
            [0.0, 1.0, 0.0],
            [-omega * omega, -2.0 * draw.damping * omega, omega * omega],
        ]
        self._matrix = scipy.linalg.expm(system * dt)[:2].copy()
        times = 10.0 ** np.arange(-2.25, 3.0, 0.5)
        shares = 0.5 * draw.creep * times**draw.growth
        self._creep = np.vstack([1.0 - np.exp(-dt / times), shares, 0.0 * times])
        self._turns, self._state = np.zeros(_DEEPEST), np.zeros(4)
        self.reset()

    def reset(self) -> None:
        """Put the stage back: never driven, at the middle of its range."""
        self._noise = np.random.default_rng(self.seed)
        self._turns[:3] = [0.0, 1.0, 0.5]
        self._state[:] = [3.0, 0.0, 0.0, relays(self._turns, 3, self.draw.skew)]
        self._creep[2] = 0.0

    def exchange(self, voltage: float) -> float:
        """Hold `voltage` [V] for one tick; return the displacement before it acts [m]."""
        return float(self.respond(np.array([voltage]))[0])

    def respond(self, voltage: FloatArray) -> FloatArray:
        """Return the displacement [m] for a voltage [V], shape (n,), from where the stage is."""
        draw, moved = self.draw, np.empty(voltage.size)
        levels = np.clip((voltage - draw.low) / draw.span, 0.0, 1.0)
        drive(
            levels, moved, self._turns, self._state, self._creep, self._matrix,
            draw.hysteresis, draw.skew,
        )  # fmt: skip
        seen = draw.stroke * (moved + 0.5) + self._noise.normal(0.0, draw.noise, moved.size)
        resolution = 1.5 * draw.stroke / 2**16
        return resolution * np.round(seen / resolution)


@numba.njit
def visit(level: float, turns: FloatArray, count: int) -> int:
    """Move to a level, 0 to 1, and discard the loops that it passes; return the turns kept."""
    while count > 1:
        last, before = turns[count - 1], turns[count - 2]
        onwards = (level - last) * (last - before) > 0.0
        if not onwards and abs(level - last) < abs(before - last):
            break
        count -= 1
    turns[count] = level
    return count + 1


@numba.njit
def relays(turns: FloatArray, count: int, skew: float) -> float:
    """Return the displacement of all relays, 0 to 1, by the Everett function."""
    total = 0.0
    for k in range(1, count):
        size = turns[k] - turns[k - 1]
        total += abs(size) * size * (1.0 + skew * (turns[k] + turns[k - 1] - 1.0))
    return total


@numba.njit
def drive(
    levels: FloatArray, moved: FloatArray, turns: FloatArray, state: FloatArray, creep: FloatArray,
    matrix: FloatArray, share: float, skew: float,
) -> None:  # fmt: skip
    """Fill what the mode has moved before each level acts, as a share of the stroke."""
    count = int(state[0])
    for k in range(levels.size):
        moved[k] = state[1]
        count = visit(levels[k], turns, count)
        force = (1.0 - share) * (levels[k] - 0.5)
        force += share * (relays(turns, count, skew) - state[3])
        total = force
        for i in range(creep.shape[1]):
            total += creep[1, i] * creep[2, i]
            creep[2, i] += creep[0, i] * (force - creep[2, i])
        x, v = state[1], state[2]
        state[1] = matrix[0, 0] * x + matrix[0, 1] * v + matrix[0, 2] * total
        state[2] = matrix[1, 0] * x + matrix[1, 1] * v + matrix[1, 2] * total
    state[0] = count


def records(draw: Draw, folder: Path, seed: int, seconds: float = 3.0) -> Path:
    """Write a user's training records of a stage as CSV: three sines and a multisine."""
    folder.mkdir(parents=True, exist_ok=True)
    time = np.arange(round(seconds * draw.rate)) / draw.rate
    scale = draw.mode / 800.0
    drives = {
        f'sine_{f * scale:.3g}Hz_{100 * a:.0f}': a * np.sin(2.0 * math.pi * f * scale * time)
        for f, a in ((2.0, 0.45), (20.0, 0.45), (20.0, 0.2), (100.0, 0.2))
    }
    lines = np.geomspace(10.0, 1500.0, 25) * scale
    phases = np.random.default_rng((seed, 7)).uniform(0.0, 2.0 * math.pi, lines.size)
    tones = np.sin(2.0 * math.pi * lines * time[:, None] + phases).sum(1)
    drives['multisine'] = 0.1 * tones / np.max(np.abs(tones))
    for k, (name, shape) in enumerate(drives.items()):
        voltage = draw.middle + draw.span * shape
        displacement = Stage(draw, seed + k).respond(voltage)
        table = np.column_stack([time, voltage, 1e6 * displacement])
        np.savetxt(
            folder / f'{name}.csv', table, fmt='%.9g', delimiter=',', comments='',
            header='time_s,voltage_V,displacement_um',
        )  # fmt: skip
    return folder
