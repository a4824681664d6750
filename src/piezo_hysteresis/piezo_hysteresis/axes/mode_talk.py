"""Cross-talk through a mode: an axis drives a mode that another one moves with.

A guide that is not square passes the motion of an axis on as it is, its resonance included. A mode
of the body adds a resonance that the motion of that axis does not have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.frequency_response import excited, spectra

# Damping ratios that are tried, and candidates in the half width of a mode.
_DAMPING, _DENSE = (0.005, 0.01, 0.02, 0.04, 0.08), 2.0
# Usual delay of a reading [samples], and lines that are averaged without it.
_LAG, _SMOOTH = 1.5, 21
# Lines over which the noise of one line is found; a mode is narrower.
_BROAD = 81
_FEWEST_LINES = 20
# A mode is named from this multiple of the deviation of its size on, found on stages of their own,
# and without its strongest line still from this part of it on.
CERTAIN, _WITHOUT_ONE = 12.0, 0.6


class ModeTalk(NamedTuple):
    """What an axis moves with a mode that another one drives."""

    size: float  # motion of the mode at rest, as a part of that of the axis that drives it
    std: float  # standard deviation of the size
    frequency: float  # [Hz]
    damping: float  # ratio
    static: float  # what is passed on without the mode, as a part of the motion of that axis
    static_std: float  # standard deviation of it


class _Pair(NamedTuple):
    """Equations of a pair, of which the own voltage is eliminated."""

    frequency: FloatArray  # (lines,) [Hz]
    y: ComplexArray  # (records, lines)
    stroke: ComplexArray  # of the other axis without its resonance, the same shape
    moved: ComplexArray  # motions of all other axes (records, lines, others)
    place: int  # of the other axis among them


def mode_talk(
    records: Sequence[AxesRecord], pair: tuple[int, int], groups: list[list[int]]
) -> ModeTalk | None:
    """Return what axis j moves through a mode with voltage i, for a pair (j, i) from 0 on.

    `groups` are records in which axis j repeats its voltage.
    """
    equations = _equations(records, pair, groups)
    if equations is None:
        return None
    weight = _weights(equations)
    found = _search(equations, weight)
    if found is None:
        return None
    return _fitted(equations, weight, *found)


def _equations(
    records: Sequence[AxesRecord], pair: tuple[int, int], groups: list[list[int]]
) -> _Pair | None:
    j, i = pair
    frequency, u, y = spectra(records)
    lines = np.flatnonzero(excited(u))
    if lines.size < _FEWEST_LINES or not groups:
        return None
    u, y = u[:, lines], y[:, lines]
    others = [k for k in range(y.shape[2]) if k != j]

    def kept(x: ComplexArray) -> ComplexArray:
        return np.concatenate([x[those] - x[those].mean(0) for those in groups])

    stroke = _stroke(frequency[lines], u[:, :, i], y[:, :, i], records[0].dt)
    return _Pair(
        frequency[lines], kept(y[:, :, j]), kept(stroke), kept(y[:, :, others]), others.index(i)
    )


def _weights(at: _Pair) -> FloatArray:
    """Return the weight of each line, from what the motions of the others leave nearby."""
    weight = np.ones(at.frequency.size)
    for _ in range(2):
        left = _residual(at, weight)
        power = np.mean(np.abs(left) ** 2, 0)
        half = _BROAD // 2
        padded = np.pad(power, half, mode='reflect') if power.size > half else power
        near = (
            np.median(np.lib.stride_tricks.sliding_window_view(padded, _BROAD), -1)
            if (power.size > half)
            else np.full(power.size, np.median(power))
        )
        # a median of exponential powers is less than their mean
        weight = 1.0 / np.sqrt(near / np.log(2.0) + 1e-9 * near.max() + 1e-300)
    return weight


def _residual(at: _Pair, weight: FloatArray) -> ComplexArray:
    """Return what parts of the motions of the other axes leave."""
    a = at.moved * weight[:, None]
    left = np.concatenate([a.real.reshape(-1, a.shape[2]), a.imag.reshape(-1, a.shape[2])])
    b = (at.y * weight).ravel()
    share = np.linalg.lstsq(left, np.concatenate([b.real, b.imag]), rcond=1e-9)[0]
    return np.asarray(at.y - at.moved @ share)


def _mode(frequency: FloatArray, natural: FloatArray, damping: FloatArray) -> ComplexArray:
    """Return the response of modes of unit motion at rest, (modes, lines)."""
    ratio = frequency / natural[:, None]
    return np.asarray(1.0 / (1.0 - ratio**2 + 2j * damping[:, None] * ratio))


def _search(at: _Pair, weight: FloatArray) -> tuple[float, float] | None:
    """Return frequency [Hz] and damping of the mode that explains most, if it is certain."""
    low, high = at.frequency[2], 0.95 * at.frequency[-1]
    natural, damping = [], []
    for zeta in _DAMPING:
        count = int(_DENSE * np.log(high / low) / zeta) + 1
        natural.append(np.geomspace(low, high, count))
        damping.append(np.full(count, zeta))
    grid, ratios = np.concatenate(natural), np.concatenate(damping)
    scores, lost = _scores(at, weight, grid, ratios)
    best = int(np.argmax(scores))
    if scores[best] < CERTAIN**2 or lost[best] < _WITHOUT_ONE * scores[best]:
        return None
    return float(grid[best]), float(ratios[best])


def _scores(
    at: _Pair, weight: FloatArray, natural: FloatArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the squares of size by deviation of modes, also without the strongest line.

    What the motions of the other axes explain counts for them; the phase of the mode is free.
    """
    left = _residual(at, weight) * weight
    u = at.stroke * weight
    cross = np.sum(u.conj() * left, 0)  # (lines,)
    power = np.sum(np.abs(u) ** 2, 0)
    with_moved = np.einsum('rl,rlo->lo', u.conj(), at.moved * weight[:, None])
    a = at.moved * weight[:, None]
    normal = np.einsum('rlo,rlp->op', a.conj(), a).real
    answer = _mode(at.frequency, natural, damping)
    parts = answer.conj() * cross
    found = parts.sum(1)
    overlap = answer.conj() @ with_moved  # (modes, others), complex
    inverse = np.linalg.pinv(normal, 1e-12)
    size = np.abs(answer) ** 2 @ power
    # of real and imaginary part of the size each
    real = size - np.einsum('mo,op,mp->m', overlap.real, inverse, overlap.real)
    imaginary = size - np.einsum('mo,op,mp->m', overlap.imag, inverse, overlap.imag)
    least = 1e-6 * size
    score = found.real**2 / np.maximum(real, least) + found.imag**2 / np.maximum(imaginary, least)
    strongest = np.abs(parts).max(1)
    share = np.maximum(0.0, 1.0 - strongest / np.maximum(np.abs(found), 1e-300)) ** 2
    variance = 0.5  # of a part of a complex number of unit power
    return score / variance / 2.0, score * share / variance / 2.0


def _fitted(at: _Pair, weight: FloatArray, natural: float, damping: float) -> ModeTalk:
    """Return size and deviation, with frequency and damping fitted by turns of the search."""
    for width in (4.0, 1.0, 0.3, 0.1):
        near = natural * (1.0 + width * damping * np.linspace(-1.0, 1.0, 17))
        ratios = damping * np.geomspace(1.0 / (1.0 + width), 1.0 + width, 9)
        grid, zeta = (each.ravel() for each in np.meshgrid(near, ratios))
        best = int(np.argmax(_scores(at, weight, grid, zeta)[0]))
        natural, damping = float(grid[best]), float(zeta[best])
    wave = at.stroke * _mode(at.frequency, np.array([natural]), np.array([damping]))[0]
    columns = np.concatenate([at.moved, wave[:, :, None], 1j * wave[:, :, None]], 2)
    a = columns * weight[:, None]
    left = np.concatenate([a.real.reshape(-1, a.shape[2]), a.imag.reshape(-1, a.shape[2])])
    b = (at.y * weight).ravel()
    right = np.concatenate([b.real, b.imag])
    scale = np.linalg.norm(left, axis=0) + 1e-300
    c = np.linalg.lstsq(left / scale, right, rcond=1e-9)[0] / scale
    variance = float(np.sum((right - left @ c) ** 2)) / max(right.size - c.size, 1)
    inverse = np.linalg.pinv((left / scale).T @ (left / scale), 1e-12)
    std = np.sqrt(variance * np.diag(inverse)) / scale
    size = float(np.copysign(np.hypot(c[-2], c[-1]), c[-2]))
    return ModeTalk(
        size, float(max(std[-2:])), natural, damping, float(c[at.place]), float(std[at.place])
    )


def _stroke(frequency: FloatArray, u: ComplexArray, y: ComplexArray, dt: float) -> ComplexArray:
    """Return what an axis would move with its voltage without its own resonance, (records, lines).

    Hysteresis moves less at small fast voltages than at slow ones, amplifiers and sensors lag: all
    that is in the response of the axis itself, from which its resonance is divided.
    """
    power = np.sum(np.abs(u) ** 2, 0) + 1e-300
    early = np.exp(2j * np.pi * frequency * _LAG * dt)
    own = np.sum(u.conj() * y, 0) / power * early
    rigid = own * _removed(frequency, own)
    ones = np.ones(min(_SMOOTH, frequency.size))
    smooth = np.convolve(rigid * power, ones, 'same') / np.convolve(power, ones, 'same')
    return np.asarray(u * smooth / early)


def _removed(frequency: FloatArray, own: ComplexArray) -> ComplexArray:
    """Return what flattens the highest resonance of a response, (lines,)."""
    size = np.abs(own)
    peak = int(np.argmax(size))
    if size[peak] < 2.0 * np.median(size[: max(3, size.size // 50)]):
        return np.ones(frequency.size, complex)
    near = slice(int(0.6 * peak), min(frequency.size, int(1.5 * peak) + 3))
    best, found = np.inf, np.ones(frequency.size, complex)
    for natural in frequency[peak] * np.linspace(0.96, 1.04, 41):
        for damping in np.geomspace(0.003, 0.15, 25):
            ratio = frequency / natural
            inverse = 1.0 - ratio**2 + 2j * damping * ratio
            flat = (own * inverse)[near]
            rough = float(np.sum(np.abs(np.diff(flat)) ** 2) / np.sum(np.abs(flat) ** 2))
            if rough < best:
                best, found = rough, inverse
    return found
