"""Sections of a report that tell what was identified and what it is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.automatic import Step
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.page import Plot, Section, Table, table
from piezo_hysteresis.reporting.plots import (
    Curve,
    loop_figure,
    spectrum_figure,
    trace_figure,
    xy_figure,
)
from piezo_hysteresis.reporting.signals import last_periods
from piezo_hysteresis.reporting.units import MICRO, micrometres, shown, with_deviation

_LOOPS = 4  # records whose loops are drawn

_TRIED = {
    'hysteresis': 'hysteresis beside the origin (Bouc-Wen)',
    'mode': 'one lightly damped mode',
    'creep': 'creep',
    'nonlocal_memory': 'memory of several reversals (play operators)',
    'amplifier_lag': 'lag of the amplifier',
    'electrostriction': 'electrostriction (square law)',
}


def fit_section(
    records: Sequence[Record], found: Identification, simulated: Mapping[str, FloatArray]
) -> Section:
    """Return measured and simulated loops, and the error where there are several frequencies.

    Parameters
    ----------
    records : sequence of Record
        What was measured.
    found : Identification
        What was identified from it.
    simulated : mapping of str to ndarray
        Free run by record name [m].
    """
    figures = [_loop(each, simulated[each.name]) for each in _spread(records)]
    frequencies = [record.info.frequency for record in records]
    if len({f for f in frequencies if f > 0}) > 2:
        figures.append(_over_frequency(records, found))
    else:
        longest = max(records, key=len)
        figures += _trace_and_residual(longest, simulated[longest.name])
    worst = max(found.records, key=lambda row: row.nrmse_percent)
    text = (
        f'The model `{found.model.name}` runs freely: it is given the voltage alone, never the '
        f'measured displacement. Its worst record is {worst.record}: {worst.nrmse_percent:.3g} % '
        f'of the standard deviation of the displacement, {micrometres(worst.free_run_rms)} µm rms.'
    )
    return Section('Does the model follow the actuator?', text, tuple(figures))


def parameter_section(found: Identification) -> Section:
    """Return the parameters with standard deviations, and what a reader must know of them."""
    text = (
        'Standard deviations come from the curvature of the fit and from what it leaves; they do '
        'not cover what the model lacks.'
    )
    if found.noise_floor > 0:
        text += (
            ' From period to period the measurement repeats itself within '
            f'{micrometres(found.noise_floor)} µm rms: the noise floor, below which no model gets.'
        )
    if found.warnings:
        text += '\n\n' + '\n'.join(f'- {warning}' for warning in found.warnings)
    tables = (_parameters(found), _records(found))
    return Section('What was identified, and how sure is it?', text, (), tables)


def choice_section(steps: Sequence[Step]) -> Section:
    """Return how the model was chosen."""
    rows = [
        (
            _TRIED.get(step.name, step.name),
            step.parameters,
            micrometres(step.trained_rms),
            micrometres(step.held_out_rms),
            step.kept,
        )
        for step in steps
    ]
    text = (
        'Nothing but the record was given. Each effect was fitted together with all before it to '
        'the first 70 % of every record; it was kept where it lowers the error by 2 % and the '
        'last 30 %, which were never fitted, do not disagree. For names, probabilities and '
        'alternatives run `discover`.'
    )
    headers = ('added', 'parameters', 'error, fitted [µm]', 'error, held out [µm]', 'kept')
    return Section('How was the model chosen?', text, (), (table(headers, rows),))


def _spread(records: Sequence[Record]) -> list[Record]:
    order = sorted(records, key=lambda r: (r.info.frequency, r.info.amplitude, r.name))
    places = np.unique(np.linspace(0, len(order) - 1, _LOOPS).round().astype(int))
    return [order[place] for place in places]


def _loop(record: Record, simulated: FloatArray) -> Plot:
    cut = last_periods(len(record), record.info.frequency, record.dt, 2, record.warm_up_samples)
    curves = [
        Curve('measured', record.voltage[cut], record.displacement[cut]),
        Curve('model', record.voltage[cut], simulated[cut]),
    ]
    part = 'its last periods' if record.info.frequency > 0 else 'the whole record'
    caption = f'Input and displacement of {record.name}, {part}.'
    return loop_figure(curves, record.name, caption, record.info.input_unit)


def _over_frequency(records: Sequence[Record], found: Identification) -> Plot:
    by_name = {row.record: row for row in found.records}
    pairs = sorted(
        (r.info.frequency, by_name[r.name].free_run_rms) for r in records if r.info.frequency > 0
    )
    frequency, error = np.array(pairs).T
    floor = found.noise_floor if found.noise_floor > 0 else None
    caption = 'Free-run error of the model in every record, against the noise floor.'
    return xy_figure(
        [Curve('free run', frequency, error)], 'Error over frequency', caption,
        'frequency of the drive [Hz]', 'rms error [µm]', log_y=True, floor=floor,
    )  # fmt: skip


def _trace_and_residual(record: Record, simulated: FloatArray) -> list[Plot]:
    error = record.displacement - simulated
    curves = [
        Curve('measured', record.time, record.displacement),
        Curve('model', record.time, simulated),
    ]
    rest = [Curve('measured minus model', record.time, error)]
    cut = slice(record.warm_up_samples, None)
    signals = [('measured', record.displacement[cut]), ('measured minus model', error[cut])]
    return [
        trace_figure(curves, 'Over time', f'{record.name} and the free run of the model.'),
        trace_figure(rest, 'What the model leaves', 'Measured minus model over time.', 'error'),
        spectrum_figure(
            signals, record.dt, 'Spectra', 'Amplitudes of the displacement and of what is left.',
            fundamental=record.info.frequency, highest=_highest(record),
        ),
    ]  # fmt: skip


def _highest(record: Record) -> float:
    """Return where the spectrum has become noise [Hz]: at most the 30th multiple of its peak."""
    power = np.abs(np.fft.rfft(record.displacement - record.displacement.mean()))
    peak = max(int(np.argmax(power)), 1) / record.duration
    return min(30 * peak, 0.5 * record.rate)


def _parameters(found: Identification) -> Table:
    rows = []
    for parameter in found.model.parameters:
        unit, factor = shown(parameter.unit)
        std = found.std.get(parameter.name)
        value, deviation = with_deviation(
            factor * found.values[parameter.name], None if std is None else factor * std
        )
        rows.append((parameter.name, value, deviation, unit, parameter.description))
    headers = ('parameter', 'value', 'standard deviation', 'unit', 'what it is')
    return table(headers, rows, f'Parameters of {found.model.name}, by {found.method}.')


def _records(found: Identification) -> Table:
    rows = [
        (
            row.record,
            micrometres(row.free_run_rms),
            f'{row.nrmse_percent:.3g}',
            micrometres(row.one_step_rms),
        )
        for row in found.records
    ]
    headers = ('record', 'free run [µm]', 'free run [% of std]', 'one step [µm]')
    return table(headers, rows, 'Rms errors of every record, after its warm-up.')


def sentence_of(found: Identification) -> str:
    """Return the verdict on an identification."""
    worst = max(found.records, key=lambda row: row.nrmse_percent)
    said = (
        f'The model {found.model.name} follows the measurement within '
        f'{MICRO * worst.free_run_rms:.3g} µm rms ({worst.nrmse_percent:.3g} % of its standard '
        'deviation) in free run'
    )
    if len(found.records) > 1:
        said += f' in the worst of {len(found.records)} records'
    return said + ('.' if found.converged else ', but the fit did not converge: do not use it.')
