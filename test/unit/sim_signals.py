"""What the tests of the simulator measure in a reading; nothing here knows the plant."""

import numpy as np


def sine(frequency, amplitude=1.0, seconds=2.0, rate=1000.0, offset=0.0):
    """Commands and times of a sinusoid."""
    time = np.arange(round(seconds * rate)) / rate
    return time, offset + amplitude * np.sin(2 * np.pi * frequency * time)


def harmonics(reading, frequency, orders=8, rate=1000.0, seconds=1.0):
    """Complex amplitudes of sin(n w t) over the last `seconds`, index 0 the mean."""
    count = round(seconds * rate)
    time = np.arange(len(reading) - count, len(reading)) / rate
    tail = reading[-count:]
    lines = [
        2j * np.mean(tail * np.exp(-2j * np.pi * n * frequency * time)) for n in range(orders)
    ]
    lines[0] = complex(np.mean(tail))
    return np.array(lines)


def response(plant, frequency, amplitude=1.0, seconds=2.0, orders=8, tail=1.0):
    """Harmonics of a plant from rest."""
    plant.reset()
    _, command = sine(frequency, amplitude, seconds, plant.rate)
    return harmonics(plant.run(command), frequency, orders, plant.rate, tail)


def degrees(number):
    """Phase of a complex amplitude."""
    return float(np.degrees(np.angle(number)))


def loop_area(command, reading):
    """Area enclosed by the command and the reading over the samples given."""
    return float(abs(np.sum(reading * (np.roll(command, -1) - np.roll(command, 1)) / 2)))
