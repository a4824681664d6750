"""Report of an identification: figures, errors by frequency, harmonics and certainty."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml
from bokeh.models import ColumnDataSource, FactorRange, HoverTool, LinearColorMapper
from bokeh.palettes import PuOr11

from piezo_hysteresis.arrays import BoolArray, FloatArray, largest_if_unknown
from piezo_hysteresis.discovery.choose import TriedModel
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.identification.error_measures import RecordErrors
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.identification.model_discrepancy import discrepancy_text
from piezo_hysteresis.identification.uncertainty import CONDITION_LIMIT, CORRELATION_LIMIT
from piezo_hysteresis.models import Model, name_of
from piezo_hysteresis.models.named import LADDER
from piezo_hysteresis.numerics.harmonics import harmonics as fitted_harmonics
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.display_units import micrometres, shown, with_deviation
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.page import PageSection, Plot, Table, render, table
from piezo_hysteresis.reporting.plots import (
    Curve,
    new_axes,
    response_figure,
    spectrum_figure,
    trace_figure,
    xy_figure,
)
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
    part = _part(span, record)
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


_LOOPS = 4  # number of drawn loops
_MANY_FLOORS = 3.0  # error in noise floors from which an effect is missing in the model


def identification_page(
    records: Sequence[Record],
    found: Identification,
    *,
    steps: Sequence[TriedModel] = (),
    data: Sequence[str] = (),
    folder: str = '',
) -> str:
    """Return the whole report as HTML."""
    seen = annotated(records)
    simulated = found.runs.simulated
    sections = [
        fit_section(seen, found, simulated),
        where_section(seen, found, simulated),
        *([choice_section(steps)] if steps else []),
        parameter_section(found),
        *([correlation_section(found)] if len(found.names) > 1 else []),
        next_section(found, data, folder),
    ]
    names = ', '.join(record.name for record in records[:3])
    more = f' and {len(records) - 3} more' if len(records) > 3 else ''
    return render(f'Identification of {names}{more}', sentence_of(found), sections)


def sentence_of(found: Identification) -> str:
    """Return the summary of an identification in one sentence."""
    worst = max(found.records, key=lambda row: largest_if_unknown(row.nrmse_percent))
    many = len(found.records) > 1
    where = f' in the worst of {len(found.records)} records' if many else ''
    if not np.isfinite(worst.free_run_rms):
        return f'The model {found.chain.name} diverges in free run{where}: do not use it.'
    sentence = (
        f'The model {found.chain.name} follows the measurement within '
        f'{micrometres(worst.free_run_rms)} µm rms ({worst.nrmse_percent:.3g} % of its standard '
        f'deviation) in free run{where}'
    )
    if not found.converged:
        return sentence + ', but the fit did not converge: do not use it.'
    if found.noise_floor > 0:
        ratio = worst.free_run_rms / found.noise_floor
        sentence += f', {ratio:.3g} times the noise floor'
        if ratio > _MANY_FLOORS:
            return sentence + ': the model is incomplete.'
    return sentence + '.'


def fit_section(
    records: Sequence[Record], found: Identification, simulated: Mapping[str, FloatArray]
) -> PageSection:  # simulated [m]
    """Return measured and simulated loops, and one record over time."""
    worst = max(found.records, key=lambda row: largest_if_unknown(row.nrmse_percent))
    which = f' in its worst record, {worst.record}' if len(records) > 1 else ''
    text = (
        f'The model `{found.chain.name}` is simulated in free run, from the voltage alone. Its '
        f'error{which} is {micrometres(worst.free_run_rms)} µm rms, {worst.nrmse_percent:.3g} % '
        'of the standard deviation of the displacement.'
    )
    return PageSection(
        'Measured and simulated displacement', text, fit_figures(records, simulated)
    )


def fit_figures(
    records: Sequence[Record], simulated: Mapping[str, FloatArray]
) -> tuple[Plot, ...]:
    """Return loops of some records with their free runs [m]; for few records one over time."""
    drawn = [each for each in records if float(np.ptp(each.voltage)) > 0] or list(records)
    figures = [_loop(each, simulated[each.name]) for each in _spread(drawn)]
    if len(records) < _LOOPS:
        longest = max(records, key=len)
        curves = [
            Curve('measured', longest.time, longest.displacement),
            Curve('model', longest.time, simulated[longest.name], 'model'),
        ]
        caption = f'{longest.name} and the free run of the model.'
        figures.append(trace_figure(curves, 'Over time', caption))
    return tuple(figures)


def choice_section(steps: Sequence[TriedModel]) -> PageSection:
    """Return the tested models and the selected one."""
    rows = [
        (
            LADDER.get(step.name, step.name),
            step.parameters,
            micrometres(step.trained_rms),
            micrometres(step.held_out_rms),
            step.kept,
        )
        for step in steps
    ]
    text = (
        'The model is selected from the records alone. Each effect is fitted together with all '
        'previous ones to the first 70 % of every record. It is kept if it lowers the error by 2 '
        '% and does not increase the error on the held-out last 30 %. One that only increases the '
        'latter is tried again after the others. For probabilities and '
        'alternatives run `discover`.'
    )
    headers = ('added', 'parameters', 'error, fitted [µm]', 'error, held out [µm]', 'kept')
    return PageSection('Model selection', text, (), (table(headers, rows),))


def next_section(found: Identification, data: Sequence[str] = (), folder: str = '') -> PageSection:
    """Return the recommended next steps, most urgent first."""
    model, parameters = (str(Path(folder) / name) for name in ('model.yaml', 'params.yaml'))
    lines = []
    if not found.converged:
        lines.append('The fit did not converge: record more, or use a simpler model.')
    exceeds = error_exceeds_noise(found)
    discover = (
        f'`{discover_command(found.chain, data)}` reports what the model lacks, with '
        'probabilities and alternatives; it refits the model with every effect.'
    )
    changed = (
        f'`python -m piezo_hysteresis discover NEW_DATA --baseline {model} --out changed` reports '
        'later changes, from new records.'
    )
    judge = (
        f'`python -m piezo_hysteresis validate OTHER_DATA --model {model} --out check` tests '
        'the model on held-out records: do this before you use it.'
    )
    lines += [discover, judge] if exceeds else [judge]
    lines.append(changed)
    lines.append(
        f'`python -m piezo_hysteresis param load /feedforward {parameters}` loads it into the '
        'running feedforward node.'
    )
    return PageSection('Next steps', '\n'.join(f'- {line}' for line in lines))


def error_exceeds_noise(found: Identification) -> bool:
    """Return whether the error far exceeds the noise in the worst record."""
    worst = max(largest_if_unknown(row.free_run_rms) for row in found.records)
    return found.noise_floor > 0 and worst > _MANY_FLOORS * found.noise_floor


def discover_command(model: Model, data: Sequence[str] = ()) -> str:
    """Return the command that searches missing effects in the data of the identification.

    The model is given by its name: with its own file `discover` cannot find a new effect in these
    data.
    """
    inputs = ' '.join(data) if 0 < len(data) <= 3 else 'DATA'
    baseline = name_of(model) or 'NAME'
    return f'python -m piezo_hysteresis discover {inputs} --baseline {baseline} --out found'


def _spread(records: Sequence[Record]) -> list[Record]:
    order = sorted(records, key=lambda r: (r.info.frequency, r.info.amplitude, r.name))
    places = np.unique(np.linspace(0, len(order) - 1, _LOOPS).round().astype(int))
    return [order[place] for place in places]


def _part(cut: slice, record: Record) -> str:
    """Return what a cut shows of a record: a drive that repeats need not state its frequency."""
    whole = (cut.start or 0) <= record.warm_up_samples
    return 'the whole record' if whole else 'its last periods'


def _loop(record: Record, simulated: FloatArray) -> Plot:
    cut = last_periods(len(record), record.info.frequency, record.dt, 2, record.warm_up_samples)
    responses = [('measured', record.displacement[cut], ''), ('model', simulated[cut], 'model')]
    caption = f'Input and displacement of {record.name}, {_part(cut, record)}.'
    drive, unit = record.voltage[cut], record.info.input_unit
    return response_figure(drive, record.time[cut], responses, record.name, caption, unit)


def write_identification(
    out: str, found: Identification, records: Sequence[Record], data: Sequence[str] = ()
) -> None:
    """Write model.yaml, params.yaml, summary.json and report.html."""
    saved = found.model_file(data, records[0].rate)
    ros = {'/**': {'ros__parameters': saved.to_ros_parameters()}}
    write_folder(
        out,
        {
            'model.yaml': saved.text(),
            'params.yaml': yaml.safe_dump(ros, sort_keys=False),
            'summary.json': json.dumps(found.summary(), indent=2, allow_nan=False) + '\n',
            'report.html': identification_page(records, found, data=data, folder=out),
        },
        'identify',
    )
