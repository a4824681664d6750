"""Actuators from textbook equations, integrated by SciPy: no block of the suite, no `piezo_sim`.

Time is continuous and so is the voltage; what is sampled is noisy. Each world takes voltages of
about 1 and answers metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezo_hysteresis.records import Record, RecordInfo

Array = NDArray[np.float64]
Drive = Callable[[float], tuple[float, float]]  # voltage and its derivative at a time
World = Callable[[Drive, Array], Array]  # displacement [m] at times [s]

RATE = 1000.0
NOISE = 2e-3  # of the stroke, rms
STROKE = 1e-4  # [m] that one volt gives, about


def _solved(right: Callable[[float, Array], Sequence[float]], start: int, times: Array) -> Array:
    found = solve_ivp(
        right, (0.0, float(times[-1])), np.zeros(start), 'LSODA', times, rtol=1e-7, atol=1e-9,
        max_step=5e-3,
    )  # fmt: skip
    if not found.success:
        raise RuntimeError(found.message)
    return np.asarray(found.y)


def _metres(stroke: Array) -> Array:
    return np.asarray(STROKE * stroke)


def _mode(x: float, v: float, target: float, frequency: float, damping: float) -> float:
    omega = 2.0 * np.pi * frequency
    return omega * (omega * (target - x) - 2.0 * damping * v)


def maxwell(drive: Drive, times: Array) -> Array:
    """Goldfarb and Celanovic 1997: elastoslides between charge and voltage, a coupled mass."""
    stiffness = np.array([0.30, 0.20, 0.15, 0.10])
    most = np.array([0.02, 0.05, 0.09, 0.15])

    def right(t: float, s: Array) -> Sequence[float]:
        q, x, v, forces = s[0], s[1], s[2], s[3:]
        rate = (drive(t)[0] - float(forces.sum()) - (q - 0.3 * x)) / 2e-4
        share = np.where(rate * forces > 0.0, np.abs(forces / most) ** 8, 0.0)
        moved = stiffness * rate * (1.0 - share)
        return [rate, v, _mode(x, v, q - 0.3 * x, 68.0, 0.03), *moved]

    return _metres(_solved(right, 3 + most.size, times)[1])


def duhem(drive: Drive, times: Array) -> Array:
    """Coleman and Hodgson 1986: a Duhem operator before a mode."""

    def right(t: float, s: Array) -> Sequence[float]:
        w, x, v = s
        u, rate = drive(t)
        return [1.2 * abs(rate) * (0.9 * u - w) + 0.5 * rate, v, _mode(x, v, w, 120.0, 0.05)]

    return _metres(_solved(right, 3, times)[1])


def two_modes(drive: Drive, times: Array) -> Array:
    """Canudas de Wit 1995: a stage with two modes side by side, of which the slower rubs."""

    def right(t: float, s: Array) -> Sequence[float]:
        u = drive(t)[0]
        bristle, x, v, y, w = s
        force = 1.0 + 0.4 * np.exp(-((v / 2.0) ** 2))
        grip = (v - abs(v) * bristle / force) / 0.02
        return [
            grip, v, _mode(x, v, u - 0.02 * bristle, 68.0, 0.03), w, _mode(y, w, u, 210.0, 0.02),
        ]  # fmt: skip

    found = _solved(right, 5, times)
    return _metres(0.8 * found[1] + 0.2 * found[3])


def leaking(drive: Drive, times: Array) -> Array:
    """Drive a stage by a charge amplifier that leaks: the slow share of the charge is lost."""

    def right(t: float, s: Array) -> Sequence[float]:
        q, w, x, v = s
        rate = drive(t)[1] - q / 3.0
        return [rate, 0.8 * abs(rate) * (q - w) + 0.7 * rate, v, _mode(x, v, w, 90.0, 0.04)]

    return _metres(_solved(right, 4, times)[2])


WORLDS: dict[str, World] = {
    'elastoslides': maxwell,
    'Duhem': duhem,
    'two modes, friction': two_modes,
    'leaking charge': leaking,
}


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
        clean = world(drive, times)
        noisy = clean + NOISE * STROKE * random.standard_normal(times.size)
        voltage = np.array([drive(t)[0] for t in times])
        info = RecordInfo(frequency=frequency)
        name = f'{frequency:g} Hz {amplitude:g} V'
        records.append(Record(name, 1.0 / RATE, voltage, noisy, info=info))
    return records
