"""Actuators of the benchmark: hysteresis, mode and effects, in plain NumPy and SciPy.

The voltage is held from sample to sample and the displacement is read at the end of each sample.
All columns of a batch (records, parameter steps) run side by side, so that one pass serves a
whole Jacobian. Arrays are (samples, columns).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]
Values = Mapping[str, float]
Effects = Mapping[str, Values]

PLAYS = np.arange(0.1, 0.95, 0.1)  # thresholds over the range [1]


@dataclass(frozen=True)
class Scale:
    """What the equations are scaled by.

    Attributes
    ----------
    volts, metres : float
        Range of the voltage [V] and stroke [m].
    dt, span : float
        Sampling time and duration of a record [s].
    moving : bool
        Records begin in motion; otherwise at rest at 0 V.
    """

    volts: float
    metres: float
    dt: float
    span: float
    moving: bool = False


# --- hysteresis ---------------------------------------------------------------------------------


def bouc_wen(voltage: Array, beta: Array, gamma: Array, moving: bool = False) -> Array:
    """Compute h of dh = du - beta |du| h - gamma du |h|, exactly from sample to sample [V].

    Parameters
    ----------
    voltage : (samples, columns) [V]
    beta, gamma : (columns,) [1/V]
    moving : bool
        Begin at the first voltage and not at 0 V.
    """
    before = voltage[:1] if moving else np.zeros_like(voltage[:1])
    step = np.diff(voltage, axis=0, prepend=before)
    way, sign = np.abs(step), np.sign(step)
    back, forth = np.maximum(beta - gamma, 1e-9), np.maximum(beta + gamma, 1e-9)
    ends_back, ends_forth = 1.0 / back, 1.0 / forth
    h = np.zeros(voltage.shape[1])
    answer = np.empty_like(voltage)
    for k in range(voltage.shape[0]):
        g, s, length = sign[k] * h, sign[k], way[k]
        below = np.minimum(g, 0.0)
        crossing = np.log1p(-back * below) * ends_back
        until = np.minimum(length, crossing)
        falling = ends_back + (below - ends_back) * np.exp(-back * until)
        above = np.maximum(g, 0.0)
        rising = ends_forth + (above - ends_forth) * np.exp(-forth * (length - until))
        h = np.where(length > 0.0, s * np.where(crossing > length, falling, rising), h)
        answer[k] = h
    return answer


def plays(voltage: Array, thresholds: Array, moving: bool = False) -> Array:
    """Compute play operators; (samples, columns, thresholds) [V] for thresholds [V]."""
    first = voltage[0][:, None] if moving else np.zeros((voltage.shape[1], 1))
    state = np.repeat(first, thresholds.size, 1)
    answer = np.empty((*voltage.shape, thresholds.size))
    low, high = voltage[:, :, None] - thresholds, voltage[:, :, None] + thresholds
    for k in range(voltage.shape[0]):
        state = np.maximum(low[k], np.minimum(high[k], state))
        answer[k] = state
    return answer


def duhem(voltage: Array, values: Values, volts: float) -> Array:
    """Compute the model of Coleman and Hodgson, dz = a |du| (f(u) - z) + g(u) du [V]."""
    step = np.diff(voltage, axis=0, prepend=0.0)
    z, answer = np.zeros(voltage.shape[1]), np.empty_like(voltage)
    curve = volts * values['height'] * np.tanh(values['bend'] * voltage / volts)
    slope = values['slope'] * (1.0 - 0.25 * (voltage / volts) ** 2)
    decay = np.exp(-values['decay'] * np.abs(step) / volts)
    for k in range(voltage.shape[0]):
        z = curve[k] + (z - curve[k]) * decay[k] + slope[k] * step[k]
        answer[k] = z
    return answer


def preisach(voltage: Array, values: Values, volts: float) -> Array:
    """Compute relays on a triangle of 24 by 24 with a density of Gauss, next to a gain [V]."""
    grid = (np.arange(24) + 0.5) / 12.0 - 1.0
    up, down = (a.ravel() for a in np.meshgrid(grid, grid, indexing='ij'))
    up, down = up[up >= down], down[up >= down]
    weight = np.exp(-(((up - down) / 2 - values['width']) ** 2) / (2 * values['spread'] ** 2))
    weight *= np.exp(-((up + down) ** 2) / (8 * values['middle'] ** 2))
    weight /= weight.sum()
    x = voltage / volts
    relay = np.where(up + down > 0, -1.0, 1.0) * np.ones((voltage.shape[1], 1))
    answer = np.empty_like(voltage)
    for k in range(voltage.shape[0]):
        relay[x[k][:, None] >= up] = 1.0
        relay[x[k][:, None] <= down] = -1.0
        answer[k] = relay @ weight
    share = values['share']
    return np.asarray(volts * ((1.0 - share) * x + share * answer))


def elastoslides(voltage: Array, values: Values, volts: float) -> Array:
    """Compute ten elastoslides after Goldfarb and Celanovic, thresholds in a power law [V]."""
    limits = volts * values['widest'] * (np.arange(1, 11) / 10.0) ** values['power']
    slides = voltage[:, :, None] - plays(voltage, limits)
    weights = np.linspace(1.5, 0.5, 10) / 10.0
    return np.asarray(voltage - values['share'] * slides @ weights)


FOREIGN = {'duhem': duhem, 'preisach': preisach, 'elastoslides': elastoslides}


def core(world: str, values: Values, voltage: Array, scale: Scale) -> Array:
    """Compute the displacement of a hysteresis without mode [m], (samples, columns)."""
    if world in FOREIGN:
        return np.asarray(values['gain'] * FOREIGN[world](voltage, values, scale.volts))
    if world == 'play_bank':
        bank = plays(voltage, PLAYS * scale.volts, scale.moving)
        weights = np.array([values[f'w{j}'] for j in range(1, PLAYS.size + 1)])
        return np.asarray(values['w0'] * voltage + bank @ weights)
    ones = np.ones(voltage.shape[1])
    h = bouc_wen(voltage, values['beta'] * ones, values['gamma'] * ones, scale.moving)
    return np.asarray(values['gain'] * voltage - values['loop'] * h)


# --- linear pieces ------------------------------------------------------------------------------


def low_pass(signal: Array, time: float, dt: float, moving: bool) -> Array:
    """Compute a first-order lag of a held signal, settled at the start."""
    first = signal[:1] if moving else np.zeros_like(signal[:1])
    a = float(np.exp(-dt / max(time, 1e-12)))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], signal - first, axis=0) + first)


def resonator(signal: Array, frequency: float, damping: float, dt: float, moving: bool) -> Array:
    """Compute x''/w^2 + 2 d x'/w + x = signal for a held signal, settled at the start."""
    w = 2.0 * np.pi * frequency
    first = signal[:1] if moving else np.zeros_like(signal[:1])
    d = min(max(damping, 1e-4), 0.999)
    turn, decay = w * np.sqrt(1.0 - d * d) * dt, np.exp(-d * w * dt)
    c, s = np.cos(turn) * decay, np.sin(turn) * decay * d / np.sqrt(1.0 - d * d)
    b0, b1 = 1.0 - c - s, decay**2 + s - c
    return np.asarray(lfilter([b0, b1], [1.0, -2.0 * c, decay**2], signal - first, axis=0) + first)


def times(count: int, dt: float) -> Array:
    """Return the times of samples as a column [s]."""
    return np.asarray(dt * np.arange(count, dtype=np.float64)[:, None])


# --- the chain ----------------------------------------------------------------------------------


def before_core(voltage: Array, effects: Effects, scale: Scale) -> Array:
    """Compute the voltage that reaches the ceramic [V]."""
    u = voltage
    if e := effects.get('slew_limit'):
        u = _slewed(u, e['rate'] * scale.volts * scale.dt)
    if e := effects.get('amplifier_lag'):
        u = low_pass(u, e['lag_time'], scale.dt, scale.moving)
    if e := effects.get('saturation'):
        c = max(abs(e['bend']), 1e-6)
        u = np.asarray(scale.volts * np.tanh(c * u / scale.volts) / c)
    if e := effects.get('dead_band'):
        u = np.asarray(np.sign(u) * np.maximum(np.abs(u) - e['width'] * scale.volts, 0.0))
    return u


def _slewed(voltage: Array, most: float) -> Array:
    answer = np.array(voltage)
    for k in range(1, voltage.shape[0]):
        answer[k] = answer[k - 1] + np.clip(voltage[k] - answer[k - 1], -most, most)
    return answer


def after_core(
    y: Array, u: Array, effects: Effects, scale: Scale, mode: tuple[float, float] | None
) -> Array:
    """Compute what the sensor reads [m] from what the hysteresis answers [m]."""
    t, dt, moving, metres = times(y.shape[0], scale.dt), scale.dt, scale.moving, scale.metres
    if e := effects.get('square_law'):
        y = y + e['square'] * metres * (u / scale.volts) ** 2
    if e := effects.get('heating'):
        warm = low_pass((u / scale.volts) ** 2, e['time'], dt, False)
        y = y * (1.0 + e['share'] * warm)
    if e := effects.get('friction'):
        y = plays(y, np.array([abs(e['width']) * metres]), moving)[:, :, 0]
    if mode:
        y = resonator(y, mode[0], mode[1], dt, moving)
    if e := effects.get('creep'):
        y = y + e['share'] * low_pass(y, e['time'], dt, moving)
    if e := effects.get('mode'):
        second = resonator(y, e['frequency'], e['damping'], dt, moving)
        y = (1.0 - e['share']) * y + e['share'] * second
    if e := effects.get('falling_gain'):
        y = y * (1.0 - e['loss'] * t / scale.span)
    if e := effects.get('sensor_curve'):
        y = y + (e['even'] * y * y + e['odd'] * y * np.abs(y)) / metres
    if e := effects.get('tone'):
        turn = 2.0 * np.pi * e['frequency'] * t
        y = y + metres * (e['sine'] * np.sin(turn) + e['cosine'] * np.cos(turn))
    if e := effects.get('drift'):
        y = y + e['drift'] * metres * t / scale.span
    if e := effects.get('sensor_steps'):
        y = y + e['height'] * metres * (np.floor(t / e['every']) % 2.0)
    if e := effects.get('transport_delay'):
        y = _late(y, e['delay'] / dt, moving)
    return np.asarray(y)


def _late(y: Array, samples: float, moving: bool) -> Array:
    whole, part = int(np.floor(samples)), samples - np.floor(samples)
    first = y[:1] if moving else np.zeros_like(y[:1])
    padded = np.concatenate([np.repeat(first, whole + 1, 0), y])
    count = y.shape[0]
    return np.asarray((1.0 - part) * padded[1 : count + 1] + part * padded[:count])


def respond(world: str, values: Values, voltage: Array, scale: Scale, effects: Effects) -> Array:
    """Compute the displacement of an actuator with effects [m], (samples, columns)."""
    return responses(world, voltage, scale, [(values, effects)])[0]


def responses(
    world: str, voltage: Array, scale: Scale, jobs: Sequence[tuple[Values, Effects]]
) -> list[Array]:
    """Compute the displacement for several values and effects, hysteresis of all in one pass.

    Parameters
    ----------
    world : str
        ``bouc_wen``, ``bouc_wen_mode``, ``play_bank`` or one of `FOREIGN`.
    voltage : (samples, records) [V]
    scale : Scale
    jobs : sequence of (values, effects)

    Returns
    -------
    list of (samples, records) [m]
        One for each job, without noise; the zero of the sensor is ``offset`` of the values.
    """
    drives = [before_core(voltage, effects, scale) for _, effects in jobs]
    bare = _cores(world, drives, scale, [values for values, _ in jobs])
    found = []
    for (values, effects), u, y in zip(jobs, drives, bare, strict=True):
        mode = (values['frequency'], values['damping']) if world == 'bouc_wen_mode' else None
        found.append(after_core(y, u, effects, scale, mode) + values.get('offset', 0.0))
    return found


def _cores(
    world: str, drives: Sequence[Array], scale: Scale, values: Sequence[Values]
) -> list[Array]:
    """Run every different hysteresis once, all of them side by side."""
    names = ('beta', 'gamma') if world.startswith('bouc_wen') else ()
    shapes = {'play_bank': (), 'bouc_wen': names, 'bouc_wen_mode': names}.get(world)
    if shapes is None:
        return [core(world, v, u, scale) for u, v in zip(drives, values, strict=True)]
    keys = [
        (u.tobytes(), *(v[name] for name in shapes)) for u, v in zip(drives, values, strict=True)
    ]
    unique = {key: place for place, key in reversed(list(enumerate(keys)))}
    order = {key: k for k, key in enumerate(unique)}
    width = drives[0].shape[1]
    wide = np.concatenate([drives[place] for place in unique.values()], 1)
    if world == 'play_bank':
        bank = plays(wide, PLAYS * scale.volts, scale.moving)
    else:
        parts = [
            np.repeat([values[place][name] for place in unique.values()], width)
            for name in ('beta', 'gamma')
        ]
        bank = bouc_wen(wide, parts[0], parts[1], scale.moving)
    found = []
    for key, u, v in zip(keys, drives, values, strict=True):
        part = bank[:, order[key] * width : (order[key] + 1) * width]
        if world == 'play_bank':
            weights = np.array([v[f'w{j}'] for j in range(1, PLAYS.size + 1)])
            found.append(v['w0'] * u + part @ weights)
        else:
            found.append(v['gain'] * u - v['loop'] * part)
    return found
