"""Frequency response of several axes, and its poles by vector fitting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import BoolArray, ComplexArray, FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError

# Weakest line of the excitation, as a part of the median one.
_EXCITED = 0.05
_TURNS = 15


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Response of all outputs to all inputs."""

    frequency: FloatArray  # excited lines [Hz], shape (lines,)
    matrix: ComplexArray  # response [m/V], shape (lines, outputs, inputs)


def spectra(records: Sequence[AxesRecord]) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return frequencies [Hz], spectra of voltages and displacements, (records, lines, axes)."""
    means = [each.mean_period() for each in records if each.periods]
    if len(means) != len(records) or len({each.voltage.shape[0] for each in means}) > 1:
        raise RecordError(
            'a response of several axes needs records of one and the same period in steady state: '
            'state it with --periodic'
        )
    u = np.fft.rfft([each.voltage for each in means], axis=1)
    y = np.fft.rfft([each.displacement for each in means], axis=1)
    frequency = np.fft.rfftfreq(means[0].voltage.shape[0], means[0].dt)
    return frequency.astype(np.float64), u, y


def excited(u: ComplexArray) -> BoolArray:
    """Return which lines all records excite, of spectra (records, lines, inputs); never 0 Hz."""
    power = np.sqrt(np.mean(np.abs(u) ** 2, (0, 2)))
    lines = power > _EXCITED * np.median(power[power > 1e-3 * power.max()])
    lines[0] = False
    return np.asarray(lines)


def response(records: Sequence[AxesRecord], neighbours: int = 0) -> FrequencyResponse:
    """Return the response by least squares over records and over `neighbours` lines each side."""
    frequency, u, y = spectra(records)
    lines = np.flatnonzero(excited(u))
    inputs, outputs = u.shape[2], y.shape[2]
    if len(records) * (2 * neighbours + 1) < inputs:
        raise RecordError(
            f'{counted(len(records), "record")} cannot tell {counted(inputs, "input")} apart: '
            'drive each alone, or all with different signs, in as many records as there are inputs'
        )
    u, y = u[:, lines], y[:, lines]
    a = np.concatenate([_shifted(u, by) for by in range(-neighbours, neighbours + 1)])
    b = np.concatenate([_shifted(y, by) for by in range(-neighbours, neighbours + 1)])
    a, b = a.transpose(1, 0, 2), b.transpose(1, 0, 2)
    normal = a.conj().transpose(0, 2, 1) @ a
    right = a.conj().transpose(0, 2, 1) @ b
    weak = np.linalg.cond(normal) > 1e10
    if weak.mean() > 0.5:
        raise RecordError(
            'the voltages of the axes are the same in all records but for a factor: drive them '
            'independently, or one after the other'
        )
    normal[weak] += (
        1e-9 * np.trace(normal[weak], axis1=1, axis2=2).real[:, None, None] * np.eye(inputs)
    )
    matrix = np.linalg.solve(normal, right).transpose(0, 2, 1)
    assert matrix.shape == (lines.size, outputs, inputs)
    return FrequencyResponse(frequency[lines], matrix)


def _shifted(x: ComplexArray, by: int) -> ComplexArray:
    """Return the lines `by` places on, the edges held."""
    places = np.clip(np.arange(x.shape[1]) + by, 0, x.shape[1] - 1)
    return x[:, places]


@dataclass(frozen=True, eq=False)
class Poles:
    """Modes of a rational fit."""

    poles: ComplexArray  # upper half [rad/s], shape (modes,)
    residues: ComplexArray  # residues [m/V rad/s], shape (modes, outputs, inputs)
    constant: FloatArray  # (outputs, inputs)
    slope: FloatArray  # (outputs, inputs)

    def at(self, frequency: FloatArray) -> ComplexArray:
        """Return the response at frequencies [Hz], shape (lines, outputs, inputs)."""
        s = 2j * np.pi * frequency[:, None]
        upper = np.tensordot(1.0 / (s - self.poles), self.residues, 1)
        lower = np.tensordot(1.0 / (s - self.poles.conj()), self.residues.conj(), 1)
        return upper + lower + self.constant + 2j * np.pi * frequency[:, None, None] * self.slope


def vector_fit(measured: FrequencyResponse, order: int, delay: float, seed: int = 0) -> Poles:
    """Fit common poles to a response matrix by vector fitting, from which `delay` [s] is taken.

    Source: Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052; relaxed poles are
    those of the scaling function, unstable ones are mirrored.
    """
    unit = 2.0 * np.pi * measured.frequency[-1]  # of frequencies, so that columns are alike
    s = 2j * np.pi * measured.frequency / unit
    early = np.exp(2j * np.pi * measured.frequency * delay)[:, None, None]
    h = (measured.matrix * early).reshape(s.size, -1)
    weight = 1.0 / np.sqrt(np.sqrt(np.mean(np.abs(h) ** 2, 1)))[:, None]
    low, high = abs(s[0]), abs(s[-1])
    ends = (max(low, 0.1 * high), 0.97 * high)
    poles = np.asarray(np.geomspace(*ends, order) * (-0.01 + 1j), complex)
    rng = np.random.default_rng(seed)
    for _ in range(_TURNS):
        basis = _basis(s, poles)
        full = _real(np.concatenate([basis, np.ones((s.size, 1)), s[:, None]], 1) * weight)
        q = np.linalg.qr(full)[0]
        normal, right = np.zeros((2 * order, 2 * order)), np.zeros(2 * order)
        for column in h.T:
            part = _real(-column[:, None] * basis * weight)
            part -= q @ (q.T @ part)
            normal += part.T @ part
            right += part.T @ _real(column * weight[:, 0])
        scale = np.sqrt(np.diag(normal)) + 1e-300
        x = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-13)[0] / scale
        poles = _moved(poles, x, rng, ends)
    basis = _basis(s, poles)
    full = np.concatenate([basis, np.ones((s.size, 1)), s[:, None]], 1) * weight
    c = np.linalg.lstsq(_real(full), _real(h * weight), rcond=None)[0]
    shape = measured.matrix.shape[1:]
    residues = (c[:order] + 1j * c[order : 2 * order]).reshape(order, *shape)
    constant, slope = c[2 * order].reshape(shape), c[2 * order + 1].reshape(shape)
    return Poles(poles * unit, residues * unit, constant, slope / unit)


def _basis(s: ComplexArray, poles: ComplexArray) -> ComplexArray:
    upper, lower = 1.0 / (s[:, None] - poles), 1.0 / (s[:, None] - poles.conj())
    return np.concatenate([upper + lower, 1j * (upper - lower)], 1)


def _real(x: ComplexArray) -> FloatArray:
    return np.concatenate([x.real, x.imag])


def _moved(
    poles: ComplexArray, x: FloatArray, rng: np.random.Generator, ends: tuple[float, float]
) -> FloatArray:
    """Return the zeros of the scaling function as new poles; lost ones are drawn anew."""
    order = poles.size
    a = np.zeros((2 * order, 2 * order))
    for i, pole in enumerate(poles):
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [
            [pole.real, pole.imag], [-pole.imag, pole.real],
        ]  # fmt: skip
    b, c = np.tile([2.0, 0.0], order), np.empty(2 * order)
    c[::2], c[1::2] = x[:order], x[order:]
    new = np.linalg.eigvals(a - np.outer(b, c))
    new = new[new.imag > 1e-6 * ends[1]][:order]
    fresh = rng.uniform(*ends, order - new.size) * (-0.01 + 1j)
    new = np.concatenate([-np.abs(new.real) + 1j * new.imag, fresh])
    return np.asarray(new[np.argsort(new.imag)], complex)
