"""Report of a model of several axes: how it was found, its modes, and what it leaves."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_discovery import AxesDiscovery
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.axes_tracking import AxesRun
from piezo_hysteresis.axes.frequency_response import response
from piezo_hysteresis.axes.modal_model import ModalModel
from piezo_hysteresis.axes.modal_search import ModalIdentification, levels_of, rms_left
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.models.plain import yaml_text
from piezo_hysteresis.reporting.discovery_report import probability_text
from piezo_hysteresis.reporting.display_units import MICRO, micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.page import PageSection, render, table
from piezo_hysteresis.reporting.plots import Curve, spectrum_figure, trace_figure, xy_figure


def write_axes_identification(
    out: str, found: ModalIdentification, records: Sequence[AxesRecord]
) -> None:
    """Write report.html, summary.json and model.yaml."""
    summary = summary_of(found)
    files = {
        'report.html': _page(found, records),
        'summary.json': json.dumps(summary, indent=1),
        'model.yaml': yaml_text(modal_file.content_of(found.model, summary)),
    }
    write_folder(out, files, 'identify')


def write_axes_discovery(out: str, found: AxesDiscovery, records: Sequence[AxesRecord]) -> None:
    """Write report.html and verdict.json, with modes model.yaml as well."""
    model = found.identification
    effects: list[dict[str, object]] = [
        {'name': pair.name, 'sentence': str(pair), **vars(pair)} for pair in found.cross_talk
    ]
    effects += [
        {'name': step.effect, 'sentence': step.sentence, 'held_out_m': step.held_out}
        for step in found.steps
    ]
    verdict = {
        'baseline': found.baseline,
        'summary': found.summary,
        'remark': found.remark,
        'effects': effects,
        'records': [each.name for each in records],
        'identification': summary_of(model) if model else None,
        'seconds': found.seconds,
    }
    rows = [
        (pair.voltage, pair.displacement, f'{100.0 * pair.size:.3g} ± {100.0 * pair.std:.2g}',
         f'{pair.frequency:.4g}' if pair.frequency else 'static', probability_text(pair.p_value))
        for pair in found.cross_talk
    ]  # fmt: skip
    text = (
        'Motion of an axis with the voltage of another one, below the first resonance, as a part '
        'of the motion of that other one; through a mode it is larger at its frequency. '
        f'{found.remark}'
    )
    head = ('voltage of axis', 'moves axis', 'size [%]', 'mode [Hz]', 'p')
    sections = [
        PageSection(
            'Cross-talk', text if rows else 'None.', (), (table(head, rows),) if rows else ()
        )
    ]
    files = {'verdict.json': json.dumps(verdict, indent=1)}
    if model:
        sections += _sections(model, records)
        files['model.yaml'] = yaml_text(modal_file.content_of(model.model, summary_of(model)))
    files['report.html'] = render('Discovery on several axes', found.summary, sections)
    write_folder(out, files, 'discover')


def write_axes_validation(
    out: str,
    model: ModalModel,
    records: Sequence[AxesRecord],
    rows: Sequence[Mapping[str, Any]],  # record, level, free_run_rms_m and noise_m of each
) -> None:
    """Write report.html and summary.json of a model on records that it was not fitted to."""
    noise = [row['noise_m'] for row in rows]
    listed = [
        (row['record'], row['level'], micrometres(row['free_run_rms_m']),
         '' if own is None else micrometres(own),
         micrometres(float(np.mean(np.std(record.displacement, 0)))))
        for row, own, record in zip(rows, noise, _ordered(records, rows), strict=True)
    ]  # fmt: skip
    levels = list(dict.fromkeys(row['level'] for row in rows))
    errors = {
        level: float(np.mean([row['free_run_rms_m'] for row in rows if row['level'] == level]))
        for level in levels
    }
    last = {row['level']: row['record'] for row in rows}
    runs = _runs(model, records)
    text = ', '.join(f'{micrometres(error)} µm at {level}' for level, error in errors.items())
    sections = [
        PageSection(
            'Errors',
            'Rms over the outputs of measured displacement minus free run, without the mean of a '
            'period; the noise is that of the record.',
            (),
            (table(('record', 'level', 'free run [µm]', 'noise [µm]', 'motion [µm]'), listed),),
        ),
        _left(records, runs, last.values()),
        *_responses(records, runs),
        _modes(model),
    ]
    page = render('Validation of several axes', f'The model leaves {text}.', sections)
    summary = {'records': list(rows), 'levels': errors}
    files = {'report.html': page, 'summary.json': json.dumps(summary, indent=1)}
    write_folder(out, files, 'validate')


def _ordered(records: Sequence[AxesRecord], rows: Sequence[Mapping[str, Any]]) -> list[AxesRecord]:
    """Return the records in the order of the rows."""
    by_name = {each.name: each for each in records}
    return [by_name[row['record']] for row in rows]


def write_axes_tracking(
    out: str, runs: Sequence[AxesRun], dt: float, references: Sequence[str]
) -> None:  # dt [s]
    """Write report.html, summary.json and voltage.csv: the voltages of the last run."""
    rows = [
        {
            'run': each.name,
            'rms_m': each.rms.tolist(),
            'cross_talk': [
                {'reference': i + 1, 'displacement': j + 1, 'part': float(each.cross_talk[j, i])}
                for j, i in np.argwhere(np.isfinite(each.cross_talk)).tolist()
            ],
        }
        for each in runs
    ]
    best, inputs = runs[-1], range(runs[-1].voltage.shape[1])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(['time_s', *(f'voltage_{i + 1}_V' for i in inputs)])
    for k, row in enumerate(best.voltage):
        writer.writerow([f'{k * dt:.9g}', *(f'{v:.9g}' for v in row)])
    files = {
        'report.html': _tracking_page(runs, dt, references),
        'summary.json': json.dumps({'references': list(references), 'runs': rows}, indent=1),
        'voltage.csv': text.getvalue(),
    }
    write_folder(out, files, 'compensate')


def tracking_rows(runs: Sequence[AxesRun]) -> tuple[list[str], list[list[str]]]:
    """Return headers and a row for each run: errors, and the cross-talk of each pair of axes."""
    pairs = np.argwhere(np.isfinite(runs[0].cross_talk)).tolist()
    headers = ['run', *(f'axis {j + 1} [µm rms]' for j in range(runs[0].error.shape[1]))]
    headers += [f'{i + 1} to {j + 1} [%]' for j, i in pairs]
    rows = [
        [
            each.name,
            *(f'{MICRO * rms:.4f}' for rms in each.rms),
            *(f'{100.0 * each.cross_talk[j, i]:.2g}' for j, i in pairs),
        ]
        for each in runs
    ]
    return headers, rows


def _tracking_page(runs: Sequence[AxesRun], dt: float, references: Sequence[str]) -> str:
    last = runs[-1]
    time: FloatArray = dt * np.arange(len(last.error), dtype=np.float64)
    axes = range(last.error.shape[1])
    figures = []
    for j in axes:
        text = references[j] or 'stand still'
        curves = [Curve(each.name, time, each.error[:, j]) for each in runs]
        desired = Curve('reference', time, last.displacement[:, j] + last.error[:, j])
        moved = Curve(last.name, time, last.displacement[:, j])
        figures += [
            trace_figure([desired, moved], f'Axis {j + 1}', f'Axis {j + 1}: {text}.'),
            trace_figure(curves, f'Error of axis {j + 1}', 'Error in one period.', 'error',
                         ground=False),
        ]  # fmt: skip
    headers, rows = tracking_rows(runs)
    verdict = (
        f'{runs[0].name}: {micrometres(runs[0].rms.max())} µm rms on the worst axis; '
        f'{last.name}: {micrometres(last.rms.max())} µm.'
    )
    sections = [
        PageSection(
            'Runs',
            'One period of the steady state. Cross-talk from one axis to another: motion of the '
            'other in the lines of the reference of the one alone.',
            (),
            (table(headers, rows),),
        ),
        PageSection('Axes', '', tuple(figures)),
    ]
    return render('Compensation of several axes', verdict, sections)


def summary_of(found: ModalIdentification) -> dict[str, object]:
    """Return the steps, and which records were fitted, as plain types; errors in m."""
    return {
        'fitted': list(found.fitted),
        'held_out': list(found.held_out),
        'disturbed': list(found.disturbed),
        'steps': [
            {'effect': step.effect, 'added': step.sentence, 'held_out_m': step.held_out}
            for step in found.steps
        ],
    }


def mode_rows(model: ModalModel) -> list[tuple[str, ...]]:
    """Return frequency, damping, softening at the full level and shape of each mode as text."""
    found, std = model.parameters, None
    if model.deviations is not None:
        std = model.layout.named(model.deviations)
    rows: list[tuple[str, ...]] = []
    for k in np.argsort(found['log_omega']):
        frequency = float(np.exp(found['log_omega'][k]) / (2.0 * np.pi))
        damping = 100.0 * float(np.exp(found['log_damping'][k]))
        spread = ('', '')
        if std is not None:
            spread = (
                f' ± {frequency * std["log_omega"][k]:.2g}',
                f' ± {damping * std["log_damping"][k]:.2g}',
            )
        rows.append(
            (
                f'{frequency:.1f}{spread[0]}',
                f'{damping:.3g}{spread[1]}',
                f'{-100.0 * found["softening"][:, k].sum():.2f}',
                ', '.join(f'{each:.3f}' for each in found['shape'][:, k]),
            )
        )
    return rows


def _page(found: ModalIdentification, records: Sequence[AxesRecord]) -> str:
    layout, steps = found.model.layout, found.steps
    first, last = steps[0].held_out, steps[-1].held_out
    errors = ', '.join(
        f'{micrometres(last[level])} µm at {level} ({micrometres(first[level])} linear)'
        for level in last
    )
    verdict = (
        f'A model of {counted(layout.inputs, "axis")} with '
        f'{counted(layout.modes, "natural mode")} leaves {errors} on records that were not fitted.'
    )
    return render(counted(layout.inputs, 'axis'), verdict, _sections(found, records))


def _sections(found: ModalIdentification, records: Sequence[AxesRecord]) -> list[PageSection]:
    runs = _runs(found.model, records)
    errors = [
        (each.name, micrometres(rms_left(each, run.displacement)))
        for each, run in zip(records, runs, strict=True)
    ]
    return [
        _story(found),
        _left(records, runs, found.held_out),
        *_responses(records, runs),
        _modes(found.model),
        PageSection(
            'Records',
            f'- fitted: {", ".join(found.fitted)}\n- held out: {", ".join(found.held_out)}\n'
            f'- left out as disturbed: {", ".join(found.disturbed) or "none"}',
            (),
            (table(('record', 'free run [µm]'), errors),),
        ),
    ]  # fmt: skip


def _modes(model: ModalModel) -> PageSection:
    text = (
        'The shape is that of the drive, and that in which the mode stretches the axes. '
        'Softening is the change of the frequency at the level of the largest records.'
    )
    head = ('frequency [Hz]', 'damping [%]', 'softening [%]', 'shape')
    return PageSection('Modes', text, (), (table(head, mode_rows(model)),))


def _story(found: ModalIdentification) -> PageSection:
    levels = list(found.steps[0].held_out)
    rows = [
        (step.effect, step.sentence, *(f'{MICRO * step.held_out[each]:.4f}' for each in levels))
        for step in found.steps
    ]
    headers = ('step', 'added', *(f'{each} [µm]' for each in levels))
    places = np.arange(len(found.steps), dtype=float)
    curves = [
        Curve(level, places, np.array([step.held_out[level] for step in found.steps]))
        for level in levels
    ]
    caption = 'Free-run error on held-out records after each step, by level of the drive.'
    figure = xy_figure(curves, 'The gap step by step', caption, 'step', 'error [µm]', log_y=True)
    text = 'Each step adds the effect that lowers the error on held-out records most.'
    return PageSection('How the model was found', text, (figure,), (table(headers, rows),))


def _runs(model: ModalModel, records: Sequence[AxesRecord]) -> list[AxesRecord]:
    """Return the records with the displacements of the model."""
    return [replace(each, displacement=model.simulate(each)) for each in records]


def _left(
    records: Sequence[AxesRecord], runs: Sequence[AxesRecord], names: Collection[str]
) -> PageSection:
    """Return a plot for each displacement of the records with these names."""
    plots = []
    for record, run in zip(records, runs, strict=True):
        left = record.displacement - run.displacement
        for j in range(record.outputs if record.name in names else 0):
            signals = [
                ('measured', record.displacement[:, j]),
                ('measured minus model', left[:, j]),
            ]
            caption = f'Spectra of displacement {j + 1} and of what the model leaves of it.'
            title = f'{record.name}, displacement {j + 1}'
            plots.append(spectrum_figure(signals, record.dt, title, caption))
    return PageSection('What is left', '', tuple(plots))


def _responses(records: Sequence[AxesRecord], runs: Sequence[AxesRecord]) -> list[PageSection]:
    """Return the frequency responses to all voltages at the largest level, if they are known."""
    *_, (level, those) = levels_of(records).items()
    try:
        measured, simulated = response(those), response(levels_of(runs)[level])
    except RecordError:  # from too few records, or without a period
        return []
    plots = []
    for j in range(those[0].outputs):
        curves = [
            Curve(f'{name} {i + 1}', each.frequency, np.abs(each.matrix[:, j, i]))
            for i in range(those[0].axes)
            for name, each in (('measured', measured), ('model', simulated))
        ]
        caption = f'Response of displacement {j + 1} to voltage 1, 2, ...'
        plots.append(
            xy_figure(curves, f'Displacement {j + 1}', caption, 'frequency [Hz]',
                      'response [µm/V]', log_x=True, log_y=True, markers=False)
        )  # fmt: skip
    where = f' at {level}' if level else ''
    text = f'Of records{where}, and in the same way of what the model makes of their voltages.'
    return [PageSection('Frequency responses', text, tuple(plots))]
