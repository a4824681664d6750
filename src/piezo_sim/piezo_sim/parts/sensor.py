"""Sensor, added tones and noise: from the displacement to the reading of a tick."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.parts.amplifier import FAR
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_STREAM = np.uint64(0xD1342543DE82EF95)
_SHIFTS = (np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11))
_S30, _S27, _S31, _S11 = _SHIFTS
_SCALE = 1.0 / 9007199254740992.0
_TWO = np.uint64(2)
_ONE = np.uint64(1)


@inline_jit
def _scramble(word: np.uint64) -> np.uint64:
    word = (word ^ (word >> _S30)) * _MIX_1
    word = (word ^ (word >> _S27)) * _MIX_2
    return word ^ (word >> _S31)


@inline_jit
def uniform(seed: np.uint64, stream: int, count: np.uint64) -> float:
    """Return a number in (0, 1)."""
    base = _scramble(seed + np.uint64(stream) * _STREAM)
    return (float(_scramble(base + count * _GOLDEN) >> _S11) + 0.5) * _SCALE


@inline_jit
def normal(seed: np.uint64, stream: int, count: np.uint64) -> float:
    """Return a normally distributed number of unit variance (Box and Muller)."""
    base = _scramble(seed + np.uint64(stream) * _STREAM)
    first = (float(_scramble(base + (_TWO * count) * _GOLDEN) >> _S11) + 0.5) * _SCALE
    second = (float(_scramble(base + (_TWO * count + _ONE) * _GOLDEN) >> _S11) + 0.5) * _SCALE
    return math.sqrt(-2.0 * math.log(first)) * math.cos(2.0 * math.pi * second)


OCTAVES = 6

PARAMETERS = (
    PlantParameter('sensor.offset', 'm', 5e-6, -1e-1, 1e-1, 'Reading at rest.'),
    PlantParameter(
        'sensor.quadratic', '1/m', 80.0, -1e6, 1e6, 'Square term of the characteristic.'
    ),
    PlantParameter('sensor.cubic', '1/m^2', 1e6, -1e14, 1e14, 'Cubic term of the characteristic.'),
    PlantParameter('sensor.noise_rms', 'm', 20e-9, 0.0, 1e-2, 'White noise per sample.'),
    PlantParameter('sensor.flicker_rms', 'm', 20e-9, 0.0, 1e-2, '1/f noise over six octaves.'),
    PlantParameter('sensor.resolution', 'm', 10e-9, 0.0, 1e-2, 'Step of the A/D converter.'),
    PlantParameter('sensor.bandwidth', 'Hz', 500.0, 1e-2, 1e6, 'First-order bandwidth.'),
    PlantParameter('sensor.range', 'm', 120e-6, 1e-9, 1.0, 'Largest magnitude of a reading.'),
    PlantParameter('sensor.rate_limit', 'm/s', 5e-3, 1e-9, 1e3, 'Fastest change of the reading.'),
    PlantParameter('sensor.jitter', 's', 50e-6, 0.0, 1e-2, 'Rms jitter of the sampling instant.'),
    PlantParameter(
        'sensor.dropout_probability', '1', 0.005, 0.0, 1.0, 'Share of samples that repeat.'
    ),
    PlantParameter(
        'sensor.cyclic_error', 'm', 0.4e-6, 0.0, 1e-2, 'Error that repeats with the scale.'
    ),
    PlantParameter('sensor.cyclic_period', 'm', 20e-6, 1e-9, 1.0, 'Pitch of that scale.'),
    PlantParameter('sensor.burst_rms', 'm', 2e-6, 0.0, 1e-2, '1/f noise in a burst.'),
    PlantParameter('sensor.burst_interval', 's', 2.0, 1e-3, 1e6, 'Mean time between bursts.'),
    PlantParameter('sensor.burst_duration', 's', 0.2, 1e-3, 1e6, 'Mean length of a burst.'),
    PlantParameter('mains.amplitude', 'm', 0.5e-6, 0.0, 1e-2, 'Hum in the reading.'),
    PlantParameter('mains.frequency', 'Hz', 50.0, 1e-3, 1e5, 'Mains frequency.'),
    PlantParameter('mains.phase', 'rad', 0.7, -7.0, 7.0, 'Phase at the start.'),
    PlantParameter('mains.third', '1', 0.1, 0.0, 10.0, 'Third harmonic of the hum.'),
    PlantParameter('vibration.amplitude', 'm', 0.3e-6, 0.0, 1e-2, 'Floor vibration.'),
    PlantParameter('vibration.frequency', 'Hz', 17.3, 1e-3, 1e5, 'Its frequency.'),
    PlantParameter(
        'modulated_tone.amplitude', 'm', 1e-6, 0.0, 1e-2, 'Tone that swells and fades.'
    ),
    PlantParameter('modulated_tone.frequency', 'Hz', 113.0, 1e-3, 1e5, 'Its carrier.'),
    PlantParameter('modulated_tone.modulation', 'Hz', 0.7, 1e-4, 1e4, 'Rate at which it swells.'),
    PlantParameter('switching.step', 'm', 1.5e-6, -1e-2, 1e-2, 'Jump between the two states.'),
    PlantParameter(
        'switching.threshold', 'V', 0.5, 0.0, 1e4, 'Voltage at which the state switches.'
    ),
)

EFFECTS = (
    PlantEffect('offset', 'The reading at rest is not zero.', {'sensor.offset': 0.0}),
    PlantEffect(
        'sensor_nonlinearity',
        'The characteristic of the sensor is curved.',
        {'sensor.quadratic': 0.0, 'sensor.cubic': 0.0},
    ),
    PlantEffect('noise', 'White sensor noise.', {'sensor.noise_rms': 0.0}),
    PlantEffect('flicker_noise', '1/f sensor noise.', {'sensor.flicker_rms': 0.0}),
    PlantEffect('quantisation', 'The reading moves in steps.', {'sensor.resolution': 0.0}),
    PlantEffect('sensor_bandwidth', 'The sensor is a low-pass filter.', {'sensor.bandwidth': 0.0}),
    PlantEffect(
        'mains_hum', 'A tone unrelated to the drive in the reading.', {'mains.amplitude': 0.0}
    ),
    PlantEffect('floor_vibration', 'A tone in the displacement.', {'vibration.amplitude': 0.0}),
    PlantEffect(
        'sensor_clipping', 'The sensor ends at its range.', {'sensor.range': FAR}, exotic=True
    ),
    PlantEffect(
        'rate_limit', 'The sensor cannot follow fast.', {'sensor.rate_limit': FAR}, exotic=True
    ),
    PlantEffect('jitter', 'Samples are taken early or late.', {'sensor.jitter': 0.0}, exotic=True),
    PlantEffect(
        'dropouts',
        'Some samples repeat the one before.',
        {'sensor.dropout_probability': 0.0},
        exotic=True,
    ),
    PlantEffect(
        'cyclic_error',
        'The scale of an encoder repeats its error with its pitch.',
        {'sensor.cyclic_error': 0.0},
        exotic=True,
    ),
    PlantEffect('noise_bursts', 'Bursts of 1/f noise.', {'sensor.burst_rms': 0.0}, exotic=True),
    PlantEffect(
        'modulated_tone',
        'A tone that swells and fades.',
        {'modulated_tone.amplitude': 0.0},
        exotic=True,
    ),
    PlantEffect(
        'switching',
        'The seat of the actuator jumps between two states.',
        {'switching.step': 0.0},
        exotic=True,
    ),
)

# Streams of random numbers, one per use.
_WHITE, _JITTER, _DROP, _BURST, _FLICKER = 1, 2, 3, 4, 16
_TWO_PI = 2.0 * math.pi


@inline_jit
def _tones(p: Any, time: float) -> float:
    total = 0.0
    if p.mains.amplitude > 0.0:
        phase = _TWO_PI * p.mains.frequency * time + p.mains.phase
        total += p.mains.amplitude * (math.sin(phase) + p.mains.third * math.sin(3.0 * phase))
    tone = p.modulated_tone
    if tone.amplitude > 0.0:
        swell = 0.5 * (1.0 - math.cos(_TWO_PI * tone.modulation * time))
        total += tone.amplitude * swell * math.sin(_TWO_PI * tone.frequency * time)
    return total


@inline_jit
def _noise(p: Any, s: Any, dt: float) -> float:
    total, count = 0.0, np.uint64(s.tick)
    if p.sensor.noise_rms > 0.0:
        total += p.sensor.noise_rms * normal(s.seed, _WHITE, count)
    if p.sensor.burst_rms > 0.0:
        mean = p.sensor.burst_duration if s.bursting else p.sensor.burst_interval
        if uniform(s.seed, _BURST, count) < dt / mean:
            s.bursting = not s.bursting
    bursting = p.sensor.burst_rms > 0.0 and s.bursting
    if p.sensor.flicker_rms > 0.0 or bursting:
        flicker = 0.0
        for j in range(OCTAVES):  # equal power per octave: a sum of first-order processes
            keep = math.exp(-_TWO_PI * 2.0**j / 4.0 * dt)
            fresh = normal(s.seed, _FLICKER + j, count)
            s.flicker[j] = keep * s.flicker[j] + math.sqrt(1.0 - keep * keep) * fresh
            flicker += s.flicker[j]
        flicker /= math.sqrt(float(OCTAVES))
        total += flicker * (p.sensor.flicker_rms + (p.sensor.burst_rms if bursting else 0.0))
    return total


@inline_jit
def read(p: Any, s: Any, displacement: float, dt: float) -> float:
    """Return the reading [m] of this tick for the (band-limited) `displacement` [m]."""
    time = s.tick * dt
    q = p.sensor
    y = displacement
    if p.vibration.amplitude > 0.0:
        y += p.vibration.amplitude * math.sin(_TWO_PI * p.vibration.frequency * time)
    if q.jitter > 0.0:
        y += (
            q.jitter
            * normal(s.seed, _JITTER, np.uint64(s.tick))
            * (displacement - s.seen_before)
            / dt
        )
    s.seen_before = displacement
    if q.cyclic_error > 0.0:
        y += q.cyclic_error * math.sin(_TWO_PI * y / q.cyclic_period)
    y = q.offset + y * (1.0 + y * (q.quadratic + y * q.cubic))
    y += _tones(p, time) + _noise(p, s, dt)
    if q.rate_limit < FAR:
        reach = q.rate_limit * dt
        y = min(max(y, s.reading - reach), s.reading + reach)
    y = min(max(y, -q.range), q.range)
    if q.resolution > 0.0:
        y = np.rint(y / q.resolution) * q.resolution
    if (
        q.dropout_probability > 0.0
        and uniform(s.seed, _DROP, np.uint64(s.tick)) < q.dropout_probability
    ):
        y = s.reading
    s.reading = y
    return float(y)
