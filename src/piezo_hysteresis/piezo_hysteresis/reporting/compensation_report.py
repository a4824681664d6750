"""Report and folder of ``compensate``: tracking errors and displacements of all runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import short
from piezo_hysteresis.compensation.study import PRESET, Run, Study, remarks
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.tabular import csv_text
from piezo_hysteresis.reporting.display_units import micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.page import PageSection, Plot, Table, render, table
from piezo_hysteresis.reporting.plots import ROLES, Curve, band_figure, trace_figure

#: File of the voltage with the smallest tracking error, with displacement and reference.
VOLTAGE = 'voltage.csv'

_DRAWN = 400  # smallest number of drawn samples, from the end
_ROLES = {
    'no compensation': 'uncompensated',
    'feedforward': 'feedforward',
    'with attenuation': 'attenuated',
    'with both': 'everything',
}
_OTHER = 'fed_back'  # any feedback law


def compensation_page(
    runs: Sequence[Run], model: str, plant: str, reference: str, from_seconds: float
) -> str:
    """Return the whole report as HTML."""
    sections = [_errors(runs, from_seconds), _left(runs), _voltages(runs)]
    if plant == model:
        text = (
            'Plant and model have the same name. If they are the same file, the result is the '
            'best case of the controller, not that of an actuator: use another plant.'
        )
        sections.insert(1, PageSection('Validity', text))
    return render(f'{model} compensates {plant}', _verdict(runs, reference), sections)


def _verdict(runs: Sequence[Run], reference: str) -> str:
    first, *others = runs
    best = min(others, key=lambda run: run.metrics.rms)
    ratio = first.metrics.rms / max(best.metrics.rms, 1e-300)
    return (
        f'The rms tracking error of `{reference}` is {micrometres(first.metrics.rms)} µm with '
        f'{first.name} and {micrometres(best.metrics.rms)} µm at best, {best.name} '
        f'({short(ratio)} times lower).'
    )


def _errors(runs: Sequence[Run], from_seconds: float) -> PageSection:
    orders = [n for n in runs[0].metrics.harmonics if all(n in r.metrics.harmonics for r in runs)]
    rows = [
        (
            run.name,
            *map(micrometres, (run.metrics.rms, run.metrics.rms_without_mean)),
            micrometres(run.metrics.largest),
            *(micrometres(run.metrics.harmonics[order]) for order in orders),
        )
        for run in runs
    ]
    headers = ('run', 'RMSE [µm]', 'without mean [µm]', 'largest [µm]')
    text = '\n'.join(f'- {each}' for each in dict.fromkeys(w for run in runs for w in run.words))
    caption = f'Tracking error from {from_seconds:g} s on; the orders are those of the reference.'
    all_headers = (*headers, *(f'{n}× [µm]' for n in orders))
    return PageSection('Tracking error', text, (), (table(all_headers, rows, caption),))


def _left(runs: Sequence[Run]) -> PageSection:
    # the largest error first, so that no curve hides another
    compensated = sorted(runs[1:], key=lambda run: -run.metrics.rms)
    figures: list[Plot] = [
        band_figure(
            [_curve(run, slice(None), run.result.error) for run in compensated],
            'Tracking error of the compensated runs', 'From the start, with the learning phase.',
            'tracking error', _dominant(runs[0]),
        ),
        trace_figure(
            [_curve(run, _end(run), run.result.error) for run in compensated],
            'Tracking error at the end', 'The same in steady state.', 'tracking error',
            ground=False,
        ),
    ]  # fmt: skip
    return PageSection('Tracking error over time', '', tuple(figures))


def _dominant(run: Run) -> float:
    """Return the frequency of the largest spectral line of the reference [Hz], 0 without one."""
    time, reference = run.result.time, run.result.reference
    lines = np.abs(np.fft.rfft(reference - reference.mean()))
    peak = int(np.argmax(lines)) if lines.any() else 0
    return peak / float(time[-1] - time[0]) if time.size > 1 else 0.0


def _voltages(runs: Sequence[Run]) -> PageSection:
    counted = [
        (
            run.name,
            (name.partition('_')[2] or name).replace('_', ' '),
            what.replace('_', ' '),
            count,
        )
        for run in runs
        for name, counts in run.result.counters.items()
        for what, count in counts.items()
        if count
    ]
    tables: tuple[Table, ...] = ()
    if counted:
        headers = ('run', 'link', 'counter', 'ticks')
        tables = (table(headers, counted, 'Counters of links and limiter.'),)
    figure = trace_figure(
        [
            Curve('reference', runs[0].result.time[_end(runs[0])],
                  runs[0].result.reference[_end(runs[0])]),
            *(_curve(run, _end(run), run.result.displacement) for run in runs),
        ],
        'Displacement', 'Reference and displacements at the end.',
    )  # fmt: skip
    return PageSection('Displacement', '', (figure,), tables)


def _end(run: Run) -> slice:
    size = run.result.time.size
    return slice(-min(size, max(_DRAWN, size // 50)), None)


def _curve(run: Run, part: slice, values: FloatArray) -> Curve:
    return Curve(run.name, run.result.time[part], values[part], _role(run))


def _role(run: Run) -> str:
    return _ROLES.get(run.name, _OTHER)


def colour_of(run: Run) -> str:
    """Return the colour of a run in every plot."""
    return ROLES[_role(run)]


def write_compensation(
    out: str | Path, study: Study, runs: Sequence[Run], reference: str, seconds: float
) -> None:  # seconds [s]
    """Write ``summary.json``, ``report.html`` and `VOLTAGE`."""
    controllers = study.controllers
    summary: dict[str, Any] = {
        'model': study.model.model.name,
        'plant': (
            study.plant.model.name
            if isinstance(study.plant, ModelFile)
            else study.controller or f'{PRESET}{study.plant}'
        ),
        'law': controllers.law,
        'gain_model': (controllers.gain_model or study.model).model.name,
        'notes': list(remarks(study, runs)),
        'reference': reference,
        'rate_hz': 1.0 / controllers.dt,
        'from_seconds': study.from_seconds,
        'noise_rms_m': study.noise,
        'seed': study.seed,
        'runs': [_row(each) for each in runs],
        'seconds': seconds,
    }
    page = compensation_page(
        runs, summary['model'], summary['plant'], reference, study.from_seconds
    )
    files: dict[str, str] = {
        'summary.json': json.dumps(summary, indent=2) + '\n',
        'report.html': page,
        VOLTAGE: _voltage(min(runs, key=lambda each: each.metrics.rms)),
    }
    write_folder(out, files, 'compensate')


def _voltage(best: Run) -> str:
    """Return the voltage of a run with reference and displacement [m], as CSV."""
    found = best.result
    record = Record(
        best.name, found.dt, found.voltage, found.displacement, reference=found.reference
    )
    return csv_text(record, unit='m')


def _row(run: Run) -> dict[str, Any]:
    m = run.metrics
    return {
        'run': run.name,
        'rms_m': m.rms,
        'rms_without_mean_m': m.rms_without_mean,
        'largest_m': m.largest,
        'mean_m': m.mean,
        'harmonics_m': {str(order): amplitude for order, amplitude in m.harmonics.items()},
        'counters': run.result.counters,
    }
