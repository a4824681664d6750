"""Actuators from textbook equations, integrated by SciPy: no block of the suite, no `piezo_sim`.

Time is continuous, and the voltage a continuous function or the levels of a converter; what is
sampled is noisy. Each world takes voltages of about 1 and answers metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezo_hysteresis.records import Record, RecordInfo

Array = NDArray[np.float64]
Drive = Callable[[float], tuple[float, float]]  # voltage and its derivative at a time
Slope = Callable[[float, float, Array, Array], None]

RATE = 1000.0
NOISE = 2e-3  # of the stroke, rms
STROKE = 1e-4  # [m] that one volt gives, about
PARTS = 10  # of a tick; a converter moves to its next level in the first


@njit(cache=True)
def _mode(x: float, v: float, target: float, frequency: float, damping: float) -> float:
    omega = 2.0 * np.pi * frequency
    return omega * (omega * (target - x) - 2.0 * damping * v)


_STIFFNESS = np.array([0.30, 0.20, 0.15, 0.10])
_MOST = np.array([0.02, 0.05, 0.09, 0.15])

# Each slope takes a voltage [V], its derivative [V/s] and the states, and writes the derivatives
# of the states.


@njit(cache=True)
def maxwell(u: float, rate: float, s: Array, slope: Array) -> None:
    """Goldfarb and Celanovic 1997: elastoslides between charge and voltage, a coupled mass."""
    q, x, forces = s[0], s[1], s[3:]
    current = (u - forces.sum() - (q - 0.3 * x)) / 2e-4
    slope[0], slope[1] = current, s[2]
    slope[2] = _mode(x, s[2], q - 0.3 * x, 68.0, 0.03)
    for k in range(forces.size):
        share = abs(forces[k] / _MOST[k]) ** 8 if current * forces[k] > 0.0 else 0.0
        slope[3 + k] = _STIFFNESS[k] * current * (1.0 - share)


@njit(cache=True)
def duhem(u: float, rate: float, s: Array, slope: Array) -> None:
    """Coleman and Hodgson 1986: a Duhem operator before a mode."""
    slope[0] = 1.2 * abs(rate) * (0.9 * u - s[0]) + 0.5 * rate
    slope[1], slope[2] = s[2], _mode(s[1], s[2], s[0], 120.0, 0.05)


@njit(cache=True)
def dahl(u: float, rate: float, s: Array, slope: Array) -> None:
    """Dahl 1976: a friction force that saturates, against the voltage of a mode."""
    slope[0] = 0.6 * rate * (1.0 - np.sign(rate) * s[0] / 0.12)
    slope[1], slope[2] = s[2], _mode(s[1], s[2], u - s[0], 95.0, 0.04)


@njit(cache=True)
def two_modes(u: float, rate: float, s: Array, slope: Array) -> None:
    """Canudas de Wit 1995: a stage with two modes side by side, of which the slower rubs."""
    bristle, x, v, y, w = s
    force = 1.0 + 0.4 * np.exp(-((v / 2.0) ** 2))
    slope[0] = (v - abs(v) * bristle / force) / 0.02
    slope[1], slope[2] = v, _mode(x, v, u - 0.02 * bristle, 68.0, 0.03)
    slope[3], slope[4] = w, _mode(y, w, u, 210.0, 0.02)


@njit(cache=True)
def leaking(u: float, rate: float, s: Array, slope: Array) -> None:
    """Drive a stage by a charge amplifier that leaks: the slow share of the charge is lost."""
    lost = rate - s[0] / 3.0
    slope[0], slope[1] = lost, 0.8 * abs(lost) * (s[0] - s[1]) + 0.7 * lost
    slope[2], slope[3] = s[3], _mode(s[2], s[3], s[1], 90.0, 0.04)


@njit
def _held(slope: Slope, voltage: Array, last: float, state: Array) -> Array:
    """Return the states at the ends of all parts of ticks (classical Runge-Kutta method)."""
    states = np.empty((state.size, PARTS * voltage.size))
    s, now = state.copy(), last
    a, b, c, d = np.empty_like(s), np.empty_like(s), np.empty_like(s), np.empty_like(s)
    for k in range(voltage.size):
        for part in range(PARTS):
            steps = 16 if part == 0 else 4
            h = 1.0 / (RATE * PARTS * steps)
            rate = (voltage[k] - now) * RATE * PARTS if part == 0 else 0.0
            for _ in range(steps):
                slope(now, rate, s, a)
                slope(now + 0.5 * h * rate, rate, s + 0.5 * h * a, b)
                slope(now + 0.5 * h * rate, rate, s + 0.5 * h * b, c)
                now += h * rate
                slope(now, rate, s + h * c, d)
                s += h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            states[:, PARTS * k + part] = s
        now = voltage[k]
    return states


@dataclass(frozen=True)
class World:
    """Equations of an actuator."""

    states: int  # number of states
    slope: Slope  # one of the functions above
    output: Callable[[Array], Array]  # displacement in strokes, from the states as columns

    def follow(self, drive: Drive, times: Array) -> Array:
        """Return the displacement at times from 0 [s], from rest [m]."""

        def slope(t: float, states: Array) -> Array:
            found = np.empty(states.size)
            self.slope(*drive(t), states, found)
            return found

        found = solve_ivp(
            slope, (0.0, float(times[-1])), np.zeros(self.states), 'LSODA', times,
            rtol=1e-7, atol=1e-9, max_step=5e-3,
        )  # fmt: skip
        if not found.success:
            raise RuntimeError(found.message)
        return np.asarray(STROKE * self.output(found.y))

    def held(self, voltage: Array, last: float, state: Array) -> tuple[Array, Array]:
        """Return the displacement [m] at the ends of the parts of ticks, and the states there."""
        # voltage [V] (n,); last [V]; state (states,)
        states = _held(self.slope, voltage, last, state)
        return np.asarray(STROKE * self.output(states)), states


def _second(s: Array) -> Array:
    return np.asarray(s[1])


WORLDS: dict[str, World] = {
    'elastoslides': World(7, maxwell, _second),
    'Duhem': World(3, duhem, _second),
    'two modes, friction': World(5, two_modes, lambda s: 0.8 * s[1] + 0.2 * s[3]),
    'leaking charge': World(4, leaking, lambda s: np.asarray(s[2])),
}
#: Stays out of `studies/worlds/foreign.py`, whose draws go by the place of a world.
DAHL = World(3, dahl, _second)


def sine(amplitude: float, frequency: float) -> Drive:
    """Return a sine that grows over its first period, so that it begins at rest."""
    omega = 2.0 * np.pi * frequency

    def drive(t: float) -> tuple[float, float]:
        if t < 1.0 / frequency:
            grown, growth = t * frequency, frequency
        else:
            grown, growth = 1.0, 0.0
        s, c = np.sin(omega * t), np.cos(omega * t)
        return amplitude * grown * s, amplitude * (growth * s + grown * omega * c)

    return drive


def recorded(
    world: World, drives: Sequence[tuple[float, float]], seconds: float, random: Generator
) -> list[Record]:
    """Return one record for each amplitude and frequency."""
    times = np.arange(round(seconds * RATE)) / RATE
    records = []
    for amplitude, frequency in drives:
        drive = sine(amplitude, frequency)
        clean = world.follow(drive, times)
        noisy = clean + NOISE * STROKE * random.standard_normal(times.size)
        voltage = np.array([drive(t)[0] for t in times])
        info = RecordInfo(frequency=frequency)
        name = f'{frequency:g} Hz {amplitude:g} V'
        records.append(Record(name, 1.0 / RATE, voltage, noisy, info=info))
    return records
