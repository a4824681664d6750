"""Report and folder of ``validate``: the error of a saved model and its known discrepancy."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.detection.limits import APART, DetectionLimit
from piezo_hysteresis.discovery.detection.statements import in_prefixes, statements
from piezo_hysteresis.discovery.verdict.verdict import plain_types
from piezo_hysteresis.identification.error_measures import RecordErrors
from piezo_hysteresis.identification.validate import Validation
from piezo_hysteresis.models import described
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.display_units import micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.identification_report import discover_command, fit_figures
from piezo_hysteresis.reporting.page import PageSection, render, table
from piezo_hysteresis.reporting.plots import Curve, band_figure

_TEXT = (
    'The smallest size of each known effect that these records would have shown with a '
    'probability of 95 %, in addition to the model, and the rms change of the response at this '
    'size. A smaller effect can be present and hide in the noise, in the known discrepancy, or in '
    'fitted parameters. The better experiment lowers the limit most, with the predicted limit; '
    'without a number, no experiment of the catalogue within voltage range and slew rate of these '
    'records halves it. Limits hold for the shapes in brackets; all variants are in {file}.'
)
_APART = (
    f'Where another effect is named, its change of the response lies less than {APART:g} standard '
    'deviations away at the limit: below the size given there, these records cannot distinguish '
    'the two.'
)


def detection_section(
    limits: Sequence[DetectionLimit], file: str = 'verdict.json'
) -> PageSection | None:
    """Return the section of the report, None without detection limits."""
    if not limits:
        return None
    header = ('effect', 'detection limit', 'better experiment', 'rms change', 'similar effect')
    rows = [
        (
            each.effect,
            each.sizes + (f'; not {each.hidden}' if each.hidden not in ('', 'any') else ''),
            each.better or described(each.effect)[0].experiment,
            _range(each.displacement_m),
            each.apart,
        )
        for each in statements(limits)
    ]
    return PageSection(
        'Detection limits', f'{_TEXT.format(file=file)}\n\n{_APART}', (), (table(header, rows),)
    )


def limits_line(limits: Sequence[DetectionLimit]) -> str:
    """Return one line for the terminal: each effect with its smallest detectable sizes."""
    return '; '.join(f'{each.effect} {each.brief}' for each in statements(limits))


def _range(metres: tuple[float, float]) -> str:
    low, high = metres
    if not low < 1.2 * high or high <= 1.2 * low:
        return in_prefixes(high, 'm') if high == high else 'none'
    return f'{in_prefixes(low, "m")} to {in_prefixes(high, "m")}'


def validation_page(
    validation: Validation,
    *,
    model: str = 'model.yaml',
    data: Sequence[str] = (),
    limits: Sequence[DetectionLimit] = (),
) -> str:
    """Return the whole report as HTML."""
    where = ' '.join(data) if 0 < len(data) <= 3 else 'DATA'
    saved, rows, worst = validation.given, validation.records, validation.worst
    noise_floor, simulated = validation.noise_floor, validation.simulated
    many = f' in the worst of {len(rows)} records' if len(rows) > 1 else ''
    sentence = (
        f'The model {saved.model.name} has an error of {micrometres(worst.free_run_rms)} µm rms '
        f'({worst.nrmse_percent:.3g} % of the standard deviation) in free run{many}'
    )
    if noise_floor > 0.0:
        sentence += f', {worst.free_run_rms / noise_floor:.3g} times the noise floor'
    sections = [
        _table(rows, noise_floor, [validation.remark, *validation.warnings]),
        PageSection(
            'Measured and simulated displacement', '', fit_figures(validation.data, simulated)
        ),
        _rest(validation.data, simulated, worst.record),
        *filter(None, [detection_section(limits, 'summary.json')]),
        PageSection(
            'Next steps',
            f'- `{discover_command(saved.model, data)}` reports what the model lacks, with '
            'probabilities and alternatives.\n'
            f'- `python -m piezo_hysteresis discover {where} --baseline {model} --out changed` '
            'reports what has changed since it was identified.\n'
            '- `model.yaml` in this folder is the same model with its error on these '
            'records as discrepancy: the next `validate` compares with it.',
        ),
    ]
    return render(f'{saved.model.name} on records', f'{sentence}.', sections)


def _table(
    rows: Sequence[RecordErrors], noise_floor: float, remarks: Sequence[str]
) -> PageSection:
    lines = [
        (
            row.record,
            micrometres(row.free_run_rms),
            f'{row.nrmse_percent:.3g}',
            micrometres(row.one_step_rms),
        )
        for row in rows
    ]
    headers = ('record', 'free run [µm]', 'free run [%]', 'one step [µm]')
    caption = 'Rms errors; percentages refer to the standard deviation of the displacement.'
    if noise_floor > 0.0:
        caption += f' The noise floor is {micrometres(noise_floor)} µm.'
    text = '\n'.join(f'- {each}' for each in remarks)
    return PageSection('Model error', text, (), (table(headers, lines, caption),))


def _rest(
    records: Sequence[Record], simulated: Mapping[str, FloatArray], worst: str
) -> PageSection:
    record = next(each for each in records if each.name == worst)
    left = record.displacement - simulated[worst]
    curve = Curve('measured minus model', record.time, left, 'error')
    caption = 'Measured minus simulated displacement in the record with the largest error.'
    figure = band_figure([curve], worst, caption, 'error', record.info.frequency)
    return PageSection('Residual over time', '', (figure,))


def write_validation(
    out: str,
    validation: Validation,
    *,
    model: str = 'model.yaml',
    data: Sequence[str] = (),
    limits: Sequence[DetectionLimit] = (),
) -> None:
    """Write report.html, summary.json and model.yaml."""
    summary = validation.summary()
    if limits:
        summary['detection_limits'] = plain_types([asdict(each) for each in limits])
    write_folder(
        out,
        {
            'report.html': validation_page(validation, model=model, data=data, limits=limits),
            'summary.json': json.dumps(summary, indent=2, allow_nan=False) + '\n',
            'model.yaml': validation.updated.text(),
        },
        'validate',
    )
