"""Tone of fixed frequency that is independent of the drive."""

from math import cos, hypot, pi, sin

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect, Residual
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.harmonics import DOMINANT, non_harmonic_lines, resolved_lines
from piezo_hysteresis.numerics.linalg import solve_least_squares

# Number of neighbouring lines for the background of a line.
_ABOUT = 51
# Share of lines away from harmonics from which a record has many periods.
_MOST = 0.5


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the displacement with the tone added; state is (start [s], samples so far)."""
    start, count = state[0], state[1]
    for k in range(x.size):
        cycles = p[0] * (start + count * dt)
        angle = 2.0 * pi * (cycles - int(cycles))
        y[k] = x[k] + p[1] * sin(angle) + p[2] * cos(angle)
        count += 1.0
    state[1] = count


def guess(seen: Residual) -> list[dict[str, float]]:
    """Return the line with the largest ratio to its neighbours, and the largest line.

    Neither is a harmonic of the drive. The error for a drive with varying amplitude is large and
    smooth at low frequencies, so that the largest line there need not be the tone. In a record of
    few periods most lines are near a harmonic; the largest of all is returned too if it is most of
    the residual.
    """
    _, lines = non_harmonic_lines(seen.residual, seen.dt, seen.frequency)
    above = lines / np.maximum(_background(lines), 1e-300)
    places = dict.fromkeys(int(np.argmax(each)) for each in (above, lines))
    found = [_tone(seen, lines, place) for place in places if lines[place] > 0.0]
    if np.mean(lines > 0.0) > _MOST:
        return found
    every = resolved_lines(seen.residual)
    largest = int(np.argmax(every))
    if largest in places and lines[largest] > 0.0:
        return found
    most = _tone(seen, every, largest)
    power = 0.5 * hypot(most['hum_sine'], most['hum_cosine']) ** 2
    return [*found, most] if power > DOMINANT * float(np.var(seen.residual)) else found


def _background(lines: FloatArray) -> FloatArray:
    """Return the mean of the neighbours of each line, without excluded lines."""
    from scipy.ndimage import uniform_filter1d

    counted = uniform_filter1d((lines > 0.0).astype(np.float64), _ABOUT, mode='constant')
    total = uniform_filter1d(lines, _ABOUT, mode='constant')
    return np.asarray(total / np.maximum(counted, 1.0 / _ABOUT))


def _tone(seen: Residual, lines: FloatArray, place: int) -> dict[str, float]:
    """Return the tone near a line that fits the residual best."""
    n = seen.residual.size
    time = seen.start + np.arange(n) * seen.dt
    # the peak of a parabola through the three largest lines, in log
    offset = 0.0
    if 0 < place < n // 2 and lines[place - 1] > 0.0 and lines[place + 1] > 0.0:
        left, top, right = np.log(lines[place - 1 : place + 2])
        offset = 0.5 * (left - right) / (left - 2.0 * top + right)
    hum = float((place + offset) / (n * seen.dt))
    angle = 2.0 * np.pi * hum * time
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones(n)])
    sine, cosine, _ = solve_least_squares(columns, seen.residual).values
    return {'hum_frequency': hum, 'hum_sine': float(sine), 'hum_cosine': float(cosine)}


BLOCK = Block(
    name='mains_hum',
    slot=Slot.ADDED,
    parameters=(
        Parameter('hum_frequency', 'Hz', 50.0, 1e-3, 1e6, 'Frequency of the tone.', 50.0),
        Parameter('hum_sine', 'm', 0.0, -1.0, 1.0, 'Sine amplitude at time 0.', 1e-6),
        Parameter('hum_cosine', 'm', 0.0, -1.0, 1.0, 'Cosine amplitude at time 0.', 1e-6),
    ),
    kernel=kernel,
    state_size=2,
    between=InterSample.CLOCK,
    description='Tone of fixed frequency, locked to the time of the record and not to the drive.',
    source='mains, pumps, fans',
)

EFFECTS = (
    Effect(
        name='mains_hum',
        repeatable=True,
        block=BLOCK,
        neutral={'hum_sine': 0.0, 'hum_cosine': 0.0},
        starts=(
            {'hum_frequency': 50.0, 'hum_sine': 1e-7, 'hum_cosine': 1e-7},
            {'hum_frequency': 60.0},
            {'hum_frequency': 100.0},
        ),
        guess=guess,
        physics=(
            'Mains, a pump or a fan couples into the sensor or the mount at a frequency '
            'unrelated to the drive.'
        ),
        experiment='A record at 0 V, and drives of which the tone is not a multiple.',
        required_coverage=(Coverage.REST,),
        mistaken_for=('odd_harmonic', 'resonance'),
    ),
)
