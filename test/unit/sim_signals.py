"""What the tests of the simulator measure in a reading; nothing here knows the plant."""

from __future__ import annotations

from typing import Any

import numpy as np


def sine(
    frequency: Any,
    amplitude: float = 1.0,
    seconds: float = 2.0,
    rate: Any = 1000.0,
    offset: float = 0.0,
) -> Any:
    """Commands and times of a sinusoid."""
    time = np.arange(round(seconds * rate)) / rate
    return time, offset + amplitude * np.sin(2 * np.pi * frequency * time)


def harmonics(
    reading: Any, frequency: Any, orders: int = 8, rate: Any = 1000.0, seconds: float = 1.0
) -> np.ndarray:
    """Complex amplitudes of sin(n w t) over the last `seconds`, index 0 the mean."""
    count = round(seconds * rate)
    time = np.arange(len(reading) - count, len(reading)) / rate
    tail = reading[-count:]
    lines = [
        2j * np.mean(tail * np.exp(-2j * np.pi * n * frequency * time)) for n in range(orders)
    ]
    lines[0] = complex(np.mean(tail))
    return np.array(lines)


def response(
    plant: Any,
    frequency: Any,
    amplitude: float = 1.0,
    seconds: float = 2.0,
    orders: int = 8,
    tail: float = 1.0,
) -> np.ndarray:
    """Harmonics of a plant from rest."""
    plant.reset()
    _, command = sine(frequency, amplitude, seconds, plant.rate)
    return harmonics(plant.run(command), frequency, orders, plant.rate, tail)


def degrees(number: Any) -> float:
    """Phase of a complex amplitude."""
    return float(np.degrees(np.angle(number)))


def loop_area(command: Any, reading: Any) -> float:
    """Area enclosed by the command and the reading over the samples given."""
    return float(abs(np.sum(reading * (np.roll(command, -1) - np.roll(command, 1)) / 2)))
