"""A random actuator and its recordings: no block of the suite, no `piezo_sim`.

The voltage is held between ticks, as a converter does. Everything after it is integrated on a grid
sixteen times as fine: a hysteresis of Bouc and Wen, which knows no time, a mode, and one or two
effects of random size. Then comes whatever a laboratory does to a record: it starts somewhere, its
zero lies anywhere, its noise is white or not, equal or larger with the drive, and its converter
has few bits or many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, log, pi, tanh

import numba
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import chirp, lfilter, sawtooth

from piezo_hysteresis.records import Record, RecordInfo

Array = NDArray[np.float64]

FINE = 16  # steps between ticks
LENGTH = 6000  # samples of a record
#: What may hide, and what a right verdict calls it.
EFFECTS = {
    'delay': 'transport_delay',
    'lag': 'amplifier_lag',
    'creep': 'creep',
    'second mode': 'resonance',
    'hardening spring': 'stiffness',
    'square law': 'electrostriction',
    'saturation': 'saturation',
    'curved sensor': 'sensor_nonlinearity',
    'tone': 'mains_hum',
    'drift': 'drift',
    'falling gain': 'gain_decay',
}
#: What no effect of the suite describes.
UNKNOWN_EFFECTS = ('dead band', 'heating')
_ALL = (*EFFECTS, *UNKNOWN_EFFECTS)


@dataclass(frozen=True)
class Conditions:
    """How the records were taken."""

    rate: float  # sampling rate [Hz]
    start: str  # ``rest``, ``step``, ``mid-period`` or ``remanent``
    noise: float  # rms over the stroke of the largest record [1]
    grows: bool  # whether noise follows the amplitude of the record
    coloured: bool  # whether noise has a memory of some samples
    zeros: float  # spread of the zeros of records over the stroke [1]
    bits: int  # of the converter of the displacement
    kinds: tuple[str, ...]  # waveform of each record
    drives: tuple[tuple[float, float], ...]  # [1]


@dataclass(frozen=True)
class Actuator:
    """What is the same in all records; lengths in strokes, times in ticks, voltages in ranges."""

    volts: float  # [V]
    metres: float  # [m]
    loop: float
    beta: float
    gamma: float
    frequency: float  # of the mode [1/tick]
    damping: float  # [1]
    sizes: dict[str, float] = field(default_factory=dict)  # of what hides; absent is nothing
    other: dict[str, float] = field(default_factory=dict)  # [ticks] [1/tick]


@numba.njit(cache=False)
def _integrated(held, numbers, sizes, others):  # type: ignore[no-untyped-def]
    """Return the stroke at the ticks for voltages that are held, both in units of the range."""
    loop, beta, gamma, omega, damping = numbers
    delay, lag, creep, second, spring, square, limit, band, heat = sizes
    creep_time, second_omega = others
    count, dt = held.size, 1.0 / FINE
    late = int(delay * FINE + 0.5)
    answer = np.empty(count)
    drive = last = h = x = v = x2 = v2 = slow = warm = 0.0
    for k in range(count * FINE):
        if k % FINE == 0:
            answer[k // FINE] = (1.0 - second) * x + second * x2
        source = held[max(k - late, 0) // FINE] if k >= late else 0.0
        drive = source if lag <= 0.0 else drive + (1.0 - np.exp(-dt / lag)) * (source - drive)
        u = drive
        if limit > 0.0:
            u = tanh(limit * u) / limit
        if band > 0.0:
            u = max(abs(u) - band, 0.0) * np.sign(u)
        parts = 4 + int(abs(u - last) / 0.002)  # a loop follows the whole way of a jump
        step = (u - last) / parts
        for _ in range(parts):
            middle = h + 0.5 * (step - beta * abs(step) * h - gamma * step * abs(h))
            h += step - beta * abs(step) * middle - gamma * step * abs(middle)
        warm += dt / 3000.0 * (u * u - warm)
        last = u
        force = (u + square * u * u + loop * h) * (1.0 + heat * warm)
        slow += dt / creep_time * (creep * force - slow)
        for _ in range(2):
            half = dt / 2
            a = omega * (omega * (force + slow - x - spring * x**3) - 2.0 * damping * v)
            middle_x, middle_v = x + 0.5 * half * v, v + 0.5 * half * a
            pull = force + slow - middle_x - spring * middle_x**3
            x += half * middle_v
            v += half * omega * (omega * pull - 2.0 * damping * middle_v)
            if second > 0.0:
                b = second_omega * (second_omega * (force + slow - x2) - 0.04 * v2)
                near_x, near_v = x2 + 0.5 * half * v2, v2 + 0.5 * half * b
                x2 += half * near_v
                v2 += (
                    half * second_omega * (second_omega * (force + slow - near_x) - 0.04 * near_v)
                )
    return answer


def _answer(actuator: Actuator, held: Array, before: int) -> Array:
    """Return what a perfect sensor says from tick `before` on, in strokes."""
    a, size = actuator, actuator.sizes.get
    numbers = np.array([a.loop, a.beta, a.gamma, 2 * pi * a.frequency, a.damping])
    inner = ('delay', 'lag', 'creep', 'second mode', 'hardening spring', 'square law')
    sizes = [size(name, 0.0) for name in (*inner, 'saturation', *UNKNOWN_EFFECTS)]
    others = np.array([a.other.get('creep', 1000.0), 2 * pi * a.other.get('second mode', 0.1)])
    y = np.asarray(_integrated(held, numbers, np.array(sizes), others))[before:]
    t = np.arange(y.size) / LENGTH
    y = y * (1.0 - size('falling gain', 0.0) * t)
    y = y + size('curved sensor', 0.0) * y * np.abs(y)
    tone = 2 * pi * a.other.get('tone', 0.01) * LENGTH * t
    return np.asarray(y + size('tone', 0.0) * np.sin(tone) + size('drift', 0.0) * t)


# --- how it is driven and recorded -------------------------------------------------------------


def _wave(kind: str, amplitude: float, frequency: float, count: int) -> Array:
    """Return a voltage in ranges."""
    t = np.arange(count, dtype=np.float64)
    turn = 2 * pi * frequency * t
    if kind == 'triangle':
        return np.asarray(amplitude * sawtooth(turn + pi / 2, 0.5))
    if kind == 'growing sine':
        return np.asarray(amplitude * t / count * np.sin(turn))
    if kind == 'chirp':
        sweep = chirp(t, 0.3 * frequency, count, 3.0 * frequency, phi=-90.0)
        return np.asarray(amplitude * sweep)
    if kind == 'step':
        return np.asarray(amplitude * np.sign(np.sin(2 * pi * 1.5 * t / count)))
    return np.asarray(amplitude * np.sin(turn))


def _driven(conditions: Conditions, place: int) -> tuple[Array, int]:
    """Return the voltage of a record, and how much of it was before the record."""
    amplitude, frequency = conditions.drives[place]
    kind, period = conditions.kinds[place], round(1.0 / frequency)
    if conditions.start == 'mid-period':
        before = int(2.37 * period)
        return _wave(kind, amplitude, frequency, LENGTH + before), before
    wave = _wave(kind, amplitude, frequency, LENGTH)
    if conditions.start == 'step':
        return np.roll(wave, -int(0.2 * period)), 0
    if conditions.start == 'remanent':
        ramp = np.concatenate([np.linspace(0, 1, 500), np.linspace(1, 0, 500), np.zeros(1500)])
        return np.concatenate([ramp, wave]), ramp.size
    return wave, 0


def clean(actuator: Actuator, conditions: Conditions) -> list[tuple[Array, Array]]:
    """Return voltage and stroke of every record, in ranges and strokes."""
    found = []
    for place in range(len(conditions.drives)):
        held, before = _driven(conditions, place)
        found.append((held[before:], _answer(actuator, held, before)))
    return found


def recorded(actuator: Actuator, conditions: Conditions, random: Generator) -> list[Record]:
    """Return the records as a laboratory has them."""
    records = []
    for place, (held, y) in enumerate(clean(actuator, conditions)):
        amplitude, frequency = conditions.drives[place]
        kind = conditions.kinds[place]
        noise = random.standard_normal(y.size)
        if conditions.coloured:
            noise = np.asarray(lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], noise))
        size = conditions.noise * (amplitude if conditions.grows else 1.0)
        read = y + size * noise + conditions.zeros * random.standard_normal()
        least = 3.0 / 2**conditions.bits  # a range of three strokes
        read = np.round(read / least) * least
        drive = frequency * conditions.rate if kind in ('sine', 'triangle') else 0.0
        records.append(
            Record(
                f'{place} {kind}',
                1.0 / conditions.rate,
                actuator.volts * held,
                actuator.metres * read,
                info=RecordInfo(frequency=drive),
            )
        )
    return records


# --- the lot ----------------------------------------------------------------------------------


def _between(random: Generator, low: float, high: float) -> float:
    return exp(random.uniform(log(low), log(high)))


def drawn_actuator(random: Generator) -> Actuator:
    """Return an actuator without anything hidden."""
    return Actuator(
        volts=_between(random, 1.0, 150.0),
        metres=_between(random, 5e-6, 2e-4),
        loop=random.uniform(0.2, 0.5),
        beta=random.uniform(0.5, 1.5),
        gamma=random.uniform(-0.4, 0.6),
        frequency=_between(random, 1 / 40, 1 / 15),
        damping=_between(random, 0.02, 0.1),
    )


def drawn_conditions(random: Generator) -> Conditions:
    """Return how the records are taken: one frequency may be missing, or one amplitude."""
    count = int(random.integers(5, 8))
    mixed = random.random() < 0.5
    kinds = ['sine'] * 3 + [
        str(random.choice(['triangle', 'growing sine', 'chirp', 'step', 'sine']))
        if mixed
        else 'sine'
        for _ in range(count - 3)
    ]
    slow, fast = 1 / 1500, 1 / 100
    frequencies = [_between(random, slow, fast) for _ in range(count)]
    amplitudes = [1.0, *(float(random.choice([0.4, 0.7, 1.0])) for _ in range(count - 1))]
    if random.random() < 0.25:
        amplitudes = [1.0] * count
    return Conditions(
        rate=_between(random, 200.0, 20e3),
        start=str(random.choice(['rest', 'step', 'mid-period', 'remanent'])),
        noise=_between(random, 5e-4, 4e-3),
        grows=bool(random.random() < 0.5),
        coloured=bool(random.random() < 0.3),
        zeros=float(random.choice([0.0, 0.05])),
        bits=int(random.integers(8, 17)),
        kinds=tuple(kinds),
        drives=tuple(zip(amplitudes, frequencies, strict=True)),
    )


_TRIED = {
    'delay': 2.0, 'lag': 2.0, 'creep': 0.1, 'second mode': 0.1, 'hardening spring': 0.2,
    'square law': 0.1, 'saturation': 0.3, 'curved sensor': 0.1, 'tone': 0.02, 'drift': 0.1,
    'falling gain': 0.1, 'dead band': 0.05, 'heating': 0.1,
}  # fmt: skip


def _seen(plain: Actuator, changed: Actuator, conditions: Conditions) -> float:
    """Return how much of a change no gain and zero of a record hide, rms over the stroke."""
    total, count = 0.0, 0
    for (_, y), (_, z) in zip(clean(plain, conditions), clean(changed, conditions), strict=True):
        columns = np.vstack([np.ones_like(y), y]).T
        left = z - columns @ np.linalg.lstsq(columns, z, rcond=None)[0]
        total, count = total + float(left @ left), count + left.size
    return float(np.sqrt(total / count))


def with_hidden(
    plain: Actuator, conditions: Conditions, names: Sequence[str], random: Generator
) -> Actuator:
    """Return the actuator with effects that are four to forty times as large as the noise."""
    sizes, other = {}, {}
    for name in names:
        if name == 'creep':
            other[name] = _between(random, 0.05 * LENGTH, 0.4 * LENGTH)
        elif name == 'second mode':
            other[name] = plain.frequency * random.uniform(1.4, 2.2)
        elif name == 'tone':
            other[name] = _between(random, 1 / 200, 1 / 10)
        least = max(conditions.noise, 1.0 / 2**conditions.bits)
        wanted, size = least * _between(random, 4.0, 40.0), _TRIED[name]
        for _ in range(4):  # nearly proportional, so this is near enough
            trial = Actuator(**{**vars(plain), 'sizes': {name: size}, 'other': other})
            size *= min(max(wanted / max(_seen(plain, trial, conditions), 1e-9), 0.2), 5.0)
            size = min(max(size, _LEAST.get(name, 0.0)), _MOST[name])
        sizes[name] = size
    return Actuator(**{**vars(plain), 'sizes': sizes, 'other': other})


#: Less cannot be distinguished from when a sample was taken [ticks].
_LEAST = {'delay': 1.5, 'lag': 1.5}
#: Beyond this it is another actuator [ticks], [1].
_MOST = {
    'delay': 6.0, 'lag': 10.0, 'creep': 0.5, 'second mode': 0.5, 'hardening spring': 1.0,
    'square law': 0.5, 'saturation': 1.5, 'curved sensor': 0.5, 'tone': 0.2, 'drift': 1.0,
    'falling gain': 0.6, 'dead band': 0.2, 'heating': 0.5,
}  # fmt: skip
