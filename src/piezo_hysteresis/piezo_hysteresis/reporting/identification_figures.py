"""Sections of an identification: errors by frequency, harmonics and certainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models import ColumnDataSource, FactorRange, HoverTool, LinearColorMapper
from bokeh.palettes import PuOr11

from piezo_hysteresis.arrays import BoolArray, FloatArray, largest_if_unknown
from piezo_hysteresis.identification.error_measures import RecordErrors
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.identification.model_discrepancy import discrepancy_text
from piezo_hysteresis.identification.uncertainty import CONDITION_LIMIT, CORRELATION_LIMIT
from piezo_hysteresis.numerics.harmonics import harmonics as fitted_harmonics
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.display_units import micrometres, shown, with_deviation
from piezo_hysteresis.reporting.page import PageSection, Plot, Table, table
from piezo_hysteresis.reporting.plot_parts import new_axes
from piezo_hysteresis.reporting.plots import Curve, spectrum_figure, trace_figure, xy_figure
from piezo_hysteresis.reporting.signals import last_periods, stands_out


def where_section(
    records: Sequence[Record], found: Identification, simulated: Mapping[str, FloatArray]
) -> PageSection:  # simulated [m]
    """Return the error by frequency, and its spectrum and time course in the worst record."""
    errors = {each.name: each.displacement - simulated[each.name] for each in records}
    by_name = {row.record: row for row in found.records}
    worst = max(records, key=lambda r: largest_if_unknown(by_name[r.name].nrmse_percent))
    figures = []
    if len({r.info.frequency for r in records if r.info.frequency > 0}) > 2:
        figures.append(over_frequency(records, found))
    view = next((each for each in found.runs.views if each.name == worst.name), None)
    lost = None if view is None or view.valid is None else view.valid == 0.0
    figures += _in_worst(worst, errors[worst.name], found.values.get('natural_frequency'), lost)
    rows = [_row(r, by_name[r.name], errors[r.name], found.noise_floor) for r in records]
    text = 'Measured minus model, free run, after the warm-up.'
    if found.noise_floor > 0:
        text += (
            f' The noise floor, {micrometres(found.noise_floor)} µm rms, is the part of the '
            'measurement that does not repeat from period to period.'
        )
    if found.discrepancy is not None:
        text += f' Discrepancy in `model.yaml`: the model {discrepancy_text(found.discrepancy)}.'
    return PageSection('Error by record and harmonic', text, tuple(figures), (_table(rows),))


def over_frequency(records: Sequence[Record], found: Identification) -> Plot:
    """Draw the free-run error of every sine over its frequency."""
    by_name = {row.record: row for row in found.records}
    driven = [r for r in records if r.info.frequency > 0]
    levels = sorted({float(f'{r.info.amplitude:.3g}') for r in driven}, reverse=True)
    curves = []
    for level in levels:
        pairs = sorted(
            (r.info.frequency, by_name[r.name].free_run_rms)
            for r in driven
            if float(f'{r.info.amplitude:.3g}') == level
        )
        frequency, error = np.array(pairs).T
        name = f'{level:g} {driven[0].info.input_unit}' if len(levels) > 1 else 'free run'
        curves.append(Curve(name, frequency, error, '' if len(levels) > 1 else 'error'))
    floor = found.noise_floor if found.noise_floor > 0 else None
    caption = 'Free-run error of every record, by amplitude of the drive.'
    return xy_figure(
        curves, 'Error over frequency', caption,
        'frequency of the drive [Hz]', 'rms error [µm]', log_y=True, floor=floor,
    )  # fmt: skip


def harmonics(error: FloatArray, frequency: float, dt: float) -> dict[int, float]:
    """Return the amplitudes of an error at the harmonics of a drive; order 0 is the mean."""
    # error (n,); frequency [Hz]; dt [s]
    period = 1.0 / (frequency * dt)
    length = round(int(error.size / period) * period)
    if length < 2 or length > error.size:
        return {}
    orders, phasors, _ = fitted_harmonics(error[-length:], frequency, dt)
    return dict(zip(orders, (abs(complex(each)) for each in phasors), strict=True))


def _in_worst(
    record: Record, error: FloatArray, resonance: float | None, lost: BoolArray | None
) -> list[Plot]:
    cut = slice(record.warm_up_samples, None)
    signals = [('measured', record.displacement[cut]), ('measured minus model', error[cut])]
    frequency = record.info.frequency
    caption = f'Amplitudes in {record.name}, the record with the largest relative error'
    marked = {} if resonance is None else {'mode': resonance}
    spectra = spectrum_figure(
        signals, record.dt, 'Spectrum of the error',
        f'{caption}; multiples of the drive are marked.' if frequency > 0 else f'{caption}.',
        roles=('', 'error'), fundamental=frequency, marks=marked,
        highest=None if frequency > 0 else _highest(record),
    )  # fmt: skip
    span = last_periods(len(record), frequency, record.dt, 3, record.warm_up_samples)
    part = 'its last periods' if frequency > 0 else 'the whole record'
    if stands_out(error[cut], error[span]):
        span, part = cut, 'the whole record, because of outliers'
    curves = [Curve('error', record.time[span], error[span], 'error')]
    if lost is not None:
        excluded = Curve('excluded from the fit', record.time[cut][lost], error[cut][lost], 'lost')
        curves.append(excluded)
        span, part = cut, 'the whole record, because of excluded samples'
        curves[0] = Curve('error', record.time[span], error[span], 'error')
    trace = trace_figure(
        curves,
        'Error over time', f'Measured minus model in {record.name}, {part}.', 'error',
    )  # fmt: skip
    return [spectra, trace]


def _highest(record: Record) -> float:
    """Return the frequency [Hz] above which the spectrum is noise, at most 30 times its peak."""
    power = np.abs(np.fft.rfft(record.displacement - record.displacement.mean()))
    peak = max(int(np.argmax(power)), 1) / record.duration
    return min(30 * peak, 0.5 * record.rate)


def _row(
    record: Record, errors: RecordErrors, error: FloatArray, floor: float
) -> tuple[object, ...]:
    largest = ''
    if record.info.frequency > 0 and np.isfinite(errors.free_run_rms):
        cut = error[record.warm_up_samples :]
        sizes = harmonics(cut, record.info.frequency, record.dt)
        if sizes:
            n = max(sizes, key=lambda order: sizes[order])
            name = 'mean' if n == 0 else f'{n}×'
            largest = f'{name}: {micrometres(sizes[n])} µm'
    percent = errors.nrmse_percent
    return (
        record.name,
        micrometres(errors.free_run_rms),
        f'{percent:.3g}' if np.isfinite(percent) else None,
        f'{errors.free_run_rms / floor:.3g}' if floor > 0 else None,
        micrometres(errors.one_step_rms),
        largest or None,
    )


def _table(rows: Sequence[tuple[object, ...]]) -> Table:
    headers = (
        'record', 'free run [µm]', 'free run [% of std]', 'in noise floors', 'one step [µm]',
        'largest part of the error',
    )  # fmt: skip
    caption = 'Rms errors, and the harmonic of the drive with the largest error.'
    return table(headers, rows, caption)


_PAIRS = 5  # listed pairs with the strongest correlations
_WRITTEN = 9  # largest number of parameters with numbers in the cells


def parameter_section(found: Identification) -> PageSection:
    """Return the parameters with standard deviations and warnings."""
    text = (
        'Standard deviations are those of the linearised fit with its residual; they do '
        'not cover errors of the model structure.'
    )
    if found.warnings:
        text += '\n\n' + '\n'.join(f'- {warning}' for warning in found.warnings)
    return PageSection('Parameters', text, (), (_parameters(found),))


def _parameters(found: Identification) -> Table:
    rows = []
    for parameter in found.chain.parameters:
        unit, factor = shown(parameter.unit)
        std = found.std.get(parameter.name)
        value, deviation = with_deviation(
            factor * found.values[parameter.name], None if std is None else factor * std
        )
        rows.append((parameter.name, value, deviation, unit, parameter.description))
    headers = ('parameter', 'value', 'standard deviation', 'unit', 'description')
    return table(headers, rows, f'Parameters of {found.chain.name}, by {found.method}.')


def correlation_section(found: Identification) -> PageSection:
    """Return the correlations between the parameters and the condition of the fit."""
    limit = f'{CONDITION_LIMIT:.0e}'.replace('e+0', 'e')
    far = 'below' if found.condition < CONDITION_LIMIT else 'beyond'
    text = (
        f'The condition number of the fit is {found.condition:.2g}, {far} the {limit} from which '
        'on individual parameters are not determined. If the correlation of two parameters '
        f'exceeds ±{CORRELATION_LIMIT}, changes of both can cancel in the free run: '
        'their deviations are then large, and only their combined effect is known.'
    )
    pairs = _strongest(found)
    pairs_table = table(
        ('parameters', 'correlation'), pairs, 'Pairs with the largest correlation.'
    )
    return PageSection('Parameter correlations', text, (_map(found),), (pairs_table,))


def _strongest(found: Identification) -> list[tuple[str, str]]:
    size = len(found.names)
    order = sorted(
        ((i, j) for i in range(size) for j in range(i)),
        key=lambda pair: -abs(float(found.correlation[pair])),
    )
    return [
        (f'{found.names[j]}, {found.names[i]}', f'{found.correlation[i, j]:+.3f}')
        for i, j in order[:_PAIRS]
    ]


def _map(found: Identification) -> Plot:
    names = list(found.names)
    size = len(names)
    matrix = np.asarray(found.correlation, float)
    plot = new_axes(
        'Correlations', '', '',
        x_range=FactorRange(*names), y_range=FactorRange(*reversed(names)),
    )  # fmt: skip
    plot.xaxis.major_label_orientation = 1.1
    plot.grid.grid_line_color = None
    values = [float(matrix[i, j]) for i in range(size) for j in range(size)]
    source = ColumnDataSource(
        {
            'x': [names[j] for _ in range(size) for j in range(size)],
            'y': [names[i] for i in range(size) for _ in range(size)],
            'value': values,
            'words': [f'{value:.2f}'.replace('0.', '.') for value in values],
            'ink': ['#ffffff' if abs(value) > 0.75 else '#000000' for value in values],
        }
    )
    cells = plot.rect(
        'x', 'y', 0.96, 0.96, source=source, line_color=None,
        fill_color={
            'field': 'value',
            'transform': LinearColorMapper(palette=PuOr11, low=-1.0, high=1.0),
        },
    )  # fmt: skip
    if size <= _WRITTEN:
        plot.text(
            'x', 'y', 'words', source=source, text_align='center', text_baseline='middle',
            text_font_size='10px', text_color='ink',
        )  # fmt: skip
    columns = [('pair', '@y, @x'), ('correlation', '@value{0.000}')]
    plot.add_tools(HoverTool(renderers=[cells], tooltips=columns))
    caption = 'Orange: both are too large together. Violet: one too large, the other too small.'
    return Plot(plot, caption)
