"""Plots and reports of the results of the Python interface.

Imported when a result is displayed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import singledispatch
from math import ceil
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from piezo_hysteresis.arrays import FloatArray, largest_if_unknown
from piezo_hysteresis.common.wording import near
from piezo_hysteresis.compensation.operating_limits import rate_of
from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification import Identification, Validation
from piezo_hysteresis.interface.compensate_runs import Compensation
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting import folder
from piezo_hysteresis.reporting.compensation_report import colour_of, write_compensation
from piezo_hysteresis.reporting.discovery_report import write_discovery
from piezo_hysteresis.reporting.display_units import MICRO
from piezo_hysteresis.reporting.identification_report import write_identification
from piezo_hysteresis.reporting.plots import GREY, ROLES
from piezo_hysteresis.reporting.signals import last_periods
from piezo_hysteresis.reporting.validation_report import write_validation

_STRETCHES = 120  # intervals of the envelope of an error
# Time that a sine from rest has to settle; its last period is drawn with so many samples.
_SETTLING_PERIODS, _SETTLING_SECONDS, _SAMPLES = 10, 2.0, 200
_DEFAULT_DRIVE = (1.0, 1.0)  # frequency [Hz] and amplitude [V] for a model without records
_VERBS: dict[type, str] = {
    Identification: 'identify',
    Validation: 'validate',
    Discovery: 'discover',
    Compensation: 'compensate',
}


def draw(result: Any, axes: Axes | None, record: str) -> Axes:
    """Draw a result on axes, by default on new ones."""
    if axes is not None and not isinstance(axes, Axes):
        raise PiezoError(f'axes must be axes of matplotlib, not of type {type(axes).__name__}')
    if axes is None:
        axes = plt.subplots(layout='constrained')[1]
    _draw(result, axes, record)
    return axes


@singledispatch
def _draw(result: Any, axes: Axes, record: str) -> None:
    raise PiezoError(f'there is no plot of a {type(result).__name__}')


def write(result: Any, path: str, *, overwrite: bool = False) -> None:
    """Write the folder of a result; with `overwrite` it replaces other results."""
    if overwrite:
        folder.overwrite(path, _VERBS[type(result)])
    _write(result, path)


@singledispatch
def _write(result: Any, path: str) -> None:
    raise PiezoError(f'there is no report of a {type(result).__name__}')


@_draw.register
def _(result: Record, axes: Axes, record: str) -> None:
    part, over = _abscissa(axes, result)
    axes.plot(over, MICRO * result.displacement[part], lw=1.2)


@_draw.register
def _(result: ModelFile, axes: Axes, record: str) -> None:
    rate = rate_of(result, None)
    for frequency, amplitude in _drives(result):
        dt = 1.0 / rate
        if not result.model.has_fixed_rate:
            dt /= max(1, round(_SAMPLES * frequency / rate))
        period = round(1.0 / (frequency * dt))
        periods = ceil(max(_SETTLING_PERIODS, _SETTLING_SECONDS * frequency))
        phase = 2.0 * np.pi * frequency * dt * np.arange(periods * period + 1)
        voltage = amplitude * np.sin(phase)
        displacement = MICRO * result.simulate(voltage, dt, frequency=frequency)
        label = f'{frequency:.3g} Hz, {amplitude:.3g} V'
        axes.plot(voltage[-period - 1 :], displacement[-period - 1 :], lw=1.2, label=label)
    axes.set_title(f'{result.model.name}, simulated', wrap=True)
    axes.set(xlabel='voltage [V]', ylabel='displacement [µm]')
    axes.legend()


@_draw.register
def _(result: Identification, axes: Axes, record: str) -> None:
    _require_data(result.data)
    _free_run(axes, result.data, result.runs.simulated, _named(result, record))


@_draw.register
def _(result: Validation, axes: Axes, record: str) -> None:
    _free_run(axes, result.data, result.simulated, _named(result, record))


@_draw.register
def _(result: Discovery, axes: Axes, record: str) -> None:
    rows = result.proof.rows
    place = np.arange(len(rows))
    before, after = ([MICRO * getattr(row, key) for row in rows] for key in ('before', 'after'))
    axes.bar(place - 0.2, before, 0.4, color=ROLES['before'], label=result.verdict.baseline)
    axes.bar(place + 0.2, after, 0.4, color=ROLES['after'], label='with the effects found')
    axes.axhline(MICRO * result.floor, color='k', ls=':', label='noise')
    axes.set_xticks(place, [row.record for row in rows], rotation=30, ha='right')
    axes.set_xlim(-1, len(rows))
    axes.set(yscale='log', ylabel='rms error [µm]', title='Held-out records')
    axes.legend()


@_draw.register
def _(result: Compensation, axes: Axes, record: str) -> None:
    for run in result.runs:
        time, largest = _envelope(run.result.time, run.result.error)
        label = f'{run.name}: {MICRO * run.metrics.rms:.3g} µm rms'
        axes.plot(time, MICRO * largest, color=colour_of(run), label=label)
    axes.set(yscale='log', xlabel='time [s]', ylabel='tracking error, envelope [µm]')
    axes.legend()


@_write.register
def _(result: Identification, path: str) -> None:
    _require_data(result.data)
    write_identification(path, result, result.data)


@_write.register
def _(result: Validation, path: str) -> None:
    write_validation(path, result)


@_write.register
def _(result: Discovery, path: str) -> None:
    write_discovery(path, result)


@_write.register
def _(result: Compensation, path: str) -> None:
    write_compensation(path, result.study, result.runs, result.reference, result.seconds)


def _drives(model: ModelFile) -> list[tuple[float, float]]:
    """Return frequency [Hz] and amplitude [V] of the slowest, middle and fastest fitted sine."""
    fitted = model.discrepancy.conditions if model.discrepancy else ()
    largest: dict[float, float] = {}
    for each in fitted:
        if each.frequency > 0.0:
            largest[each.frequency] = max(each.amplitude, largest.get(each.frequency, 0.0))
    if not largest:
        return [_DEFAULT_DRIVE]
    known = sorted(largest.items())
    return [known[k] for k in sorted({0, len(known) // 2, len(known) - 1})]


def _require_data(records: Sequence[Record]) -> None:
    if not records:
        raise PiezoError('the result does not contain its records; identify again')


def _named(result: Identification | Validation, record: str) -> str:
    """Return the name of the drawn record: the requested or the worst one."""
    names = [row.record for row in result.records]
    if not record:
        return max(result.records, key=lambda row: largest_if_unknown(row.nrmse_percent)).record
    if record not in names:
        raise PiezoError(
            f'there is no record {record}{near(record, names)}; there are {", ".join(names)}'
        )
    return record


def _free_run(
    axes: Axes, records: Sequence[Record], simulated: Mapping[str, FloatArray], name: str
) -> None:
    """Draw measured and simulated displacement of one record."""
    (drawn,) = (record for record in records if record.name == name)
    part, over = _abscissa(axes, drawn)
    axes.plot(over, MICRO * drawn.displacement[part], color=GREY, lw=3.5, label='measured')
    model = MICRO * simulated[name][part]
    axes.plot(over, model, '--', color=ROLES['model'], label='model')
    axes.legend()


def _abscissa(axes: Axes, record: Record) -> tuple[slice, FloatArray]:
    """Label the axes; return the drawn samples and what they are drawn over.

    The last two periods are drawn over the voltage, a record without a period over time.
    """
    (known,) = annotated([record])
    frequency, start = known.info.frequency, record.warm_up_samples
    part = last_periods(len(record), frequency, record.dt, 2, start)
    drive = 'force [N]' if record.info.input_unit == 'N' else 'voltage [V]'
    label, over = (drive, record.voltage) if frequency > 0.0 else ('time [s]', record.time)
    axes.set(title=record.name, xlabel=label, ylabel='displacement [µm]')
    return part, over[part]


def _envelope(time: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the largest magnitude in each interval, and the center time of the interval."""
    edges = np.linspace(0, time.size, min(_STRETCHES, time.size) + 1).astype(int)
    largest = np.maximum.reduceat(np.abs(error), edges[:-1])
    return 0.5 * (time[edges[:-1]] + time[edges[1:] - 1]), largest
