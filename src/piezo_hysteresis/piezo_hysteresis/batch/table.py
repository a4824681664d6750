"""Rows of a batch, and their table: CSV and a page with links to the reports."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.arrays import largest_if_unknown
from piezo_hysteresis.batch.run import Batch, Row, Work
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.interface.verbs import discover, identify
from piezo_hysteresis.reporting.discovery_report import write_discovery
from piezo_hysteresis.reporting.display_units import micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.identification_report import write_identification
from piezo_hysteresis.reporting.page import PageSection, render, table

if TYPE_CHECKING:
    from piezo_hysteresis.discovery import Discovery
    from piezo_hysteresis.identification import Identification

_SHOWN = 1000  # largest number of rows of the page; the table has all


def identified(data: str, folder: str, **options: Any) -> Row:
    """Identify one data set, write its folder and return its row."""
    found = identify(data, **options)
    write_identification(folder, found, found.data, [data])
    return identification_row(found)


def discovered(data: str, folder: str, **options: Any) -> Row:
    """Search missing effects in one data set, write its folder and return its row."""
    found = discover(data, **options)
    write_discovery(folder, found, [data])
    return discovery_row(found)


WORK: dict[str, Work] = {'identify': identified, 'discover': discovered}


def identification_row(found: Identification) -> Row:
    """Return the row of an identification; parameters last, in SI units."""
    worst = max(found.records, key=lambda row: largest_if_unknown(row.nrmse_percent))
    row: Row = {
        'model': found.chain.name,
        'method': found.method,
        'records': len(found.records),
        'converged': found.converged,
        'worst_record': worst.record,
        'nrmse_percent': _finite(worst.nrmse_percent),
        'free_run_rms_m': _finite(worst.free_run_rms),
        'noise_floor_rms_m': _finite(found.noise_floor),
        'condition': _finite(found.condition),
        'warnings': len(found.warnings),
    }
    for name, value in found.values.items():
        row[name] = _finite(value)
        if name in found.std:
            row[f'{name}_std'] = _finite(found.std[name])
    return row


def discovery_row(found: Discovery) -> Row:
    """Return the row of a discovery."""
    verdict = found.verdict
    return {
        'baseline': verdict.baseline,
        'records': len(found.data.records),
        'verdict': verdict.verdict,
        'effects': '; '.join(effect.name for effect in verdict.effects),
        'probability': min((e.probability for e in verdict.effects), default=None),
        'before_in_floors': _finite(verdict.held_out.before_in_floors),
        'after_in_floors': _finite(verdict.held_out.after_in_floors),
        'noise_floor_rms_m': _finite(verdict.noise_floor_rms_m),
        'unexplained': verdict.unexplained.description,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def write_tables(out: str | Path, verb: str, done: Batch) -> None:
    """Write results.csv, where unknown values are empty, and index.html."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(done.columns()), restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(done.rows)
    files = {'results.csv': text.getvalue(), 'index.html': index_page(verb, done.rows)}
    write_folder(out, files, f'batch {verb}')


# Columns of the page: heading, column of the table, unit of display; sorted by the first error.
_COLUMNS = {
    'identify': (
        ('records', 'records'), ('model', 'model'), ('free run [µm]', 'free_run_rms_m'),
        ('% of std', 'nrmse_percent'), ('noise floor [µm]', 'noise_floor_rms_m'),
        ('converged', 'converged'), ('warnings', 'warnings'),
    ),
    'discover': (
        ('records', 'records'), ('verdict', 'verdict'), ('effects', 'effects'),
        ('probability', 'probability'), ('before [floors]', 'before_in_floors'),
        ('after [floors]', 'after_in_floors'),
    ),
}  # fmt: skip
_RANKED_BY = {'identify': 'free_run_rms_m', 'discover': 'before_in_floors'}


def index_page(verb: str, rows: Sequence[Row]) -> str:
    """Return the page: numbers of data sets, errors, failures, links to every report."""
    done = [row for row in rows if row['state'] == 'done']
    bad = [row for row in rows if row['state'] != 'done']
    sections = []
    if done:
        by = _RANKED_BY.get(verb, 'seconds')
        ranked = sorted(done, key=lambda row: -largest_if_unknown(_number(row.get(by))))
        shown = _COLUMNS.get(verb, ())
        cells = [
            (
                f'[{row["name"]}]({row["report"]})',
                *(_cell(name, row.get(name)) for _, name in shown),
            )
            for row in ranked[:_SHOWN]
        ]
        text = _summary(verb, ranked)
        page = table(('data', *(heading for heading, _ in shown)), cells)
        sections.append(PageSection('Results, the largest error first', text, (), (page,)))
    if bad:
        cells = [(row['name'], row['state'], row['error']) for row in bad[:_SHOWN]]
        why = table(('data', 'state', 'why'), cells)
        sections.append(PageSection('Refused and failed data sets', '', (), (why,)))
    summary = f'{len(done)} of {counted(len(rows), "data set")} went through `{verb}`'
    summary += f', {len(bad)} did not.' if bad else '.'
    sections.append(PageSection('Complete table', 'All columns, in SI units: `results.csv`.'))
    return render(f'Batch: {verb} over {counted(len(rows), "data set")}', summary, sections)


def _summary(verb: str, ranked: Sequence[Row]) -> str:
    if verb == 'identify':
        middle = micrometres(_number(ranked[len(ranked) // 2]['free_run_rms_m']))
        return f'Free-run error of the worst record of each. Median of the data sets: {middle} µm.'
    if verb == 'discover':
        names = [name for row in ranked for name in str(row['effects']).split('; ') if name]
        counts = sorted({(-names.count(name), name) for name in names})
        often = (
            ', '.join(f'`{name}` {counted(-count, "time")}' for count, name in counts) or 'nothing'
        )
        return f'Gap on held-out records in multiples of the noise. Named: {often}.'
    return ''


def _cell(name: str, value: Any) -> Any:
    if name.endswith('_rms_m'):
        return micrometres(_number(value))
    return f'{value:.3g}' if isinstance(value, float) else value


def _number(value: float | None) -> float:
    return math.inf if value is None else float(value)
