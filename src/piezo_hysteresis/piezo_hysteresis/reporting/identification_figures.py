"""Figures of an identification: loops, residual spectra, error over frequency."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.error_measures import RecordErrors
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.plot_parts import GREY, ROLES
from piezo_hysteresis.reporting.signals import amplitude_spectrum, thinned

_PANELS = 6
_LAST = 20_000  # drawn samples of a record without a period
_LEAST = 1e-15  # drawn amplitude [m], which a logarithmic axis needs
_MODEL, _ERROR, _FLOOR = ROLES['model'], ROLES['error'], '#000000'


def figures(
    records: Sequence[Record],
    simulated: Mapping[str, FloatArray],  # [m]
    errors: Sequence[RecordErrors],
    *,
    noise_floor: float = float('nan'),  # [m]
) -> dict[str, bytes]:
    """Draw all figures."""
    chosen = _spread(records)
    drawn = {
        'loops.png': _loops(chosen, simulated),
        'residual_spectra.png': _spectra(chosen, simulated, noise_floor),
        'error_over_frequency.png': _over_frequency(records, errors, noise_floor),
    }
    return {name: _png(figure) for name, figure in drawn.items()}


def _spread(records: Sequence[Record]) -> list[Record]:
    order = sorted(records, key=lambda r: (r.info.frequency, r.info.amplitude, r.name))
    places = np.unique(np.linspace(0, len(order) - 1, _PANELS).round().astype(int))
    return [order[place] for place in places]


def _panels(count: int) -> tuple[Figure, list[Any]]:
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 3.4 * rows), layout='constrained')
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_visible(False)
    return figure, list(axes[:count])


def _tail(record: Record) -> slice:
    """Return the last two periods, or the end of a record without a period."""
    frequency = record.info.frequency
    count = round(2 / (frequency * record.dt)) if frequency > 0 else _LAST
    return slice(max(len(record) - count, record.warm_up_samples), None)


def _loops(records: Sequence[Record], simulated: Mapping[str, FloatArray]) -> Figure:
    figure, axes = _panels(len(records))
    for axis, record in zip(axes, records, strict=True):
        cut = _tail(record)
        u, measured = record.voltage[cut], 1e6 * record.displacement[cut]
        axis.plot(*thinned(u, measured), color=GREY, lw=3.5, label='measured')
        model = 1e6 * simulated[record.name][cut]
        axis.plot(*thinned(u, model), '--', color=_MODEL, label='model')
        axis.set_title(record.name, fontsize='medium')
        force = record.info.input_unit == 'N'
        axis.set_xlabel('force [N]' if force else 'voltage [V]')
        axis.set_ylabel('displacement [µm]')
    axes[0].legend()
    return figure


def _spectra(
    records: Sequence[Record], simulated: Mapping[str, FloatArray], floor: float
) -> Figure:
    figure, axes = _panels(len(records))
    for axis, record in zip(axes, records, strict=True):
        cut = slice(record.warm_up_samples, None)
        for label, signal, colour in (
            ('measured', record.displacement[cut], GREY),
            (
                'measured minus model',
                record.displacement[cut] - simulated[record.name][cut],
                _ERROR,
            ),
        ):
            frequency, amplitude = amplitude_spectrum(signal, record.dt)
            x, y = thinned(frequency, amplitude, decades=True)
            axis.loglog(x, 1e6 * np.maximum(y, _LEAST), color=colour, label=label, lw=0.8)
        if floor > 0:
            # amplitude of one spectral line of white noise with this rms
            line = 2e6 * floor / np.sqrt(len(record) - record.warm_up_samples)
            axis.axhline(line, color=_FLOOR, ls=':', label='noise floor')
        axis.set_title(record.name, fontsize='medium')
        axis.set_xlabel('frequency [Hz]')
        axis.set_ylabel('amplitude [µm]')
    axes[0].legend()
    return figure


def _over_frequency(
    records: Sequence[Record], errors: Sequence[RecordErrors], floor: float
) -> Figure:
    figure, (axis,) = _panels(1)
    by_name = {each.record: each for each in errors}
    frequency = [record.info.frequency for record in records]
    known = any(f > 0 for f in frequency)
    place = frequency if known else list(range(1, len(records) + 1))
    for label, colour, marker in (('free run', _ERROR, 'o'), ('one step', GREY, 'x')):
        rms = [
            by_name[r.name].free_run_rms if label == 'free run' else by_name[r.name].one_step_rms
            for r in records
        ]
        finite = [(x, 1e6 * y) for x, y in zip(place, rms, strict=True) if np.isfinite(y)]
        if finite:
            axis.semilogy(*zip(*sorted(finite), strict=True), marker=marker, color=colour,
                          label=label)  # fmt: skip
    if floor > 0:
        axis.axhline(1e6 * floor, color=_FLOOR, ls=':', label='noise floor')
    axis.set_xlabel('frequency of the drive [Hz]' if known else 'record')
    axis.set_ylabel('error rms [µm]')
    axis.legend()
    return figure


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format='png', metadata={'Software': None})
    return buffer.getvalue()
