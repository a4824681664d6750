"""Linear start of a modal model: delay, order and modes from the frequency response."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.frequency_response import FrequencyResponse, Poles, response, vector_fit
from piezo_hysteresis.axes.modal_model import ModalLayout
from piezo_hysteresis.errors import IdentificationError

ORDERS = (1, 2, 3, 4, 6, 8, 12, 16, 20, 24)
# Lines of the fits that compare orders and delays, at most.
_LINES = 500
_DELAYS = np.arange(0.0, 3.01, 0.5)  # ticks
# An order counts as equal if it leaves no more than this factor.
_EQUAL = 1.03
_WELL_DAMPED = 0.06
# Least height of the peak of a mode, in the response at its frequency.
_SEEN = 0.05
_NEIGHBOURS = 2


def thinned(measured: FrequencyResponse, first: int, step: int) -> FrequencyResponse:
    """Return every `step`-th line from `first` on."""
    return FrequencyResponse(measured.frequency[first::step], measured.matrix[first::step])


def left(poles: Poles, measured: FrequencyResponse, delay: float) -> float:
    """Return the relative error of a rational fit on the lines of a response."""
    late = np.exp(-2j * np.pi * measured.frequency * delay)[:, None, None]
    size = np.sqrt(np.mean(np.abs(measured.matrix) ** 2, (1, 2)))
    error = np.abs(measured.matrix - late * poles.at(measured.frequency)) ** 2
    return float(np.sqrt(np.mean(np.mean(error, (1, 2)) / size)) / np.sqrt(np.mean(size)))


def find_delay(measured: FrequencyResponse, dt: float, order: int) -> float:
    """Return the delay [s] with which a rational response leaves least."""
    some = thinned(measured, 0, 1 + measured.frequency.size // _LINES)
    delays = dt * _DELAYS
    return float(min(delays, key=lambda delay: left(vector_fit(some, order, delay), some, delay)))


def find_order(measured: FrequencyResponse, delay: float, most: int) -> int:
    """Return the smallest order that predicts every other line as well as any."""
    step = 2 * (1 + measured.frequency.size // (2 * _LINES))
    some, other = thinned(measured, 0, step), thinned(measured, step // 2, step)
    errors = {
        order: left(vector_fit(some, order, delay), other, delay)
        for order in ORDERS
        if order <= most
    }
    best = min(errors.values())
    return min(order for order, error in errors.items() if error <= _EQUAL * best)


def start_of(
    records: Sequence[AxesRecord], modes: int | None = None
) -> tuple[ModalLayout, FloatArray]:
    """Return layout and parameters of a linear model of records of one level."""
    measured = response(records)
    smooth = response(records, _NEIGHBOURS)
    dt = records[0].dt
    delay = find_delay(smooth, dt, min(8, modes or 8))
    order = modes or find_order(smooth, delay, ORDERS[-1])
    poles = vector_fit(measured, order, delay)
    damping = -poles.poles.real / np.abs(poles.poles)
    inside = poles.poles.imag < 2.1 * np.pi * measured.frequency[-1]
    peak = np.linalg.norm(poles.residues, axis=(1, 2)) / np.abs(poles.poles.real)
    around = np.interp(
        poles.poles.imag / (2.0 * np.pi), smooth.frequency,
        np.linalg.norm(smooth.matrix, axis=(1, 2)),
    )  # fmt: skip
    width = -poles.poles.real / (2.0 * np.pi)  # a narrower one than a line is of the noise
    kept = inside & (width > np.diff(measured.frequency).min())
    kept &= (damping < _WELL_DAMPED) & (peak > _SEEN * around)
    if not kept.any():
        raise IdentificationError('the response shows no mode; a one-axis model may do')
    layout = ModalLayout(
        records[0].voltage.shape[1], records[0].displacement.shape[1], int(kept.sum())
    )
    vector = layout.zeros()
    found = layout.named(vector)
    found['log_omega'][:] = np.log(np.abs(poles.poles[kept]))
    found['log_damping'][:] = np.log(np.clip(damping[kept], 1e-4, None))
    found['delay'][0] = delay
    static = poles.at(np.zeros(1))[0].real
    found['shape'][...] = _shapes(poles, kept, static)
    return layout, vector


def _shapes(poles: Poles, kept: BoolArray, static: FloatArray) -> FloatArray:
    """Return input shapes, (inputs, modes), in the scale that reciprocity sets.

    A mode stretches the axes in the shape in which they drive it; the elongation is the
    displacement through the inverse of the static gain.
    """
    elongation = np.linalg.pinv(static)
    shapes = np.empty((static.shape[1], int(kept.sum())))
    for k, place in enumerate(np.flatnonzero(kept)):
        pole, residue = poles.poles[place], poles.residues[place]
        row = np.linalg.svd(residue)[2][0]
        row = (row * np.exp(-0.5j * np.angle(np.sum(row**2)))).real
        # static contribution of the mode, as an elongation of the axes
        stretched = elongation @ (-2.0 * (residue / pole).real)
        gain = abs(float(row @ stretched @ row) / float(row @ row) ** 2)
        shapes[:, k] = np.sqrt(gain + 1e-4) * row
    return shapes
