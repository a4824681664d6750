"""Report and folder of an identification: errors, where they are, uncertainty, next steps."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray, largest_if_unknown
from piezo_hysteresis.discovery.choice.choose import TriedModel
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.models import Model, name_of
from piezo_hysteresis.models.named import LADDER
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.display_units import micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.identification_figures import (
    correlation_section,
    parameter_section,
    where_section,
)
from piezo_hysteresis.reporting.page import PageSection, Plot, render, table
from piezo_hysteresis.reporting.plots import Curve, response_figure, trace_figure
from piezo_hysteresis.reporting.signals import last_periods

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


def _loop(record: Record, simulated: FloatArray) -> Plot:
    cut = last_periods(len(record), record.info.frequency, record.dt, 2, record.warm_up_samples)
    responses = [('measured', record.displacement[cut], ''), ('model', simulated[cut], 'model')]
    part = 'its last periods' if record.info.frequency > 0 else 'the whole record'
    caption = f'Input and displacement of {record.name}, {part}.'
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
