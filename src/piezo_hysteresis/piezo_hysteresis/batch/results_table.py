"""The results of a batch as one table: CSV, Parquet and a page with links to the reports."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.batch.tasks import Row
from piezo_hysteresis.reporting.display_units import micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.page import PageSection, Plot, Table, render, table
from piezo_hysteresis.reporting.plots import Curve, xy_figure

_SHOWN = 1000  # largest number of rows of the page; the table has all


def write_tables(out: str | Path, verb: str, rows: Sequence[Row]) -> list[str]:
    """Write results.csv, results.parquet and index.html.

    Parameters
    ----------
    out : str or Path
        Folder.
    verb : str
        Name of the verb.
    rows : sequence of dict
        One per job.

    Returns
    -------
    list of str
        Remarks for the user.

    Raises
    ------
    PiezoError
        If the folder cannot be written.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row))
    files: dict[str, bytes | str] = {'results.csv': as_csv(columns, rows)}
    notes = []
    try:
        files['results.parquet'] = as_parquet(columns, rows)
    except ModuleNotFoundError:
        notes.append('results.parquet needs pyarrow; results.csv is complete')
    files['index.html'] = index_page(verb, rows, list(files))
    write_folder(out, files, f'batch {verb}')
    return notes


def as_csv(columns: Sequence[str], rows: Sequence[Row]) -> str:
    """Return the table as CSV; unknown values are empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def as_parquet(columns: Sequence[str], rows: Sequence[Row]) -> bytes:
    """Return the table as a Parquet file; unknown values are null.

    Raises
    ------
    ModuleNotFoundError
        Without pyarrow.
    """
    import pyarrow
    import pyarrow.parquet

    kinds = {bool: pyarrow.bool_(), int: pyarrow.int64(), float: pyarrow.float64()}
    arrays = {}
    for name in columns:
        values = [row.get(name) for row in rows]
        known = {type(value) for value in values if value is not None}
        kind = kinds.get(known.pop(), pyarrow.string()) if len(known) == 1 else pyarrow.string()
        arrays[name] = pyarrow.array(values, kind)
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(arrays), sink)
    return bytes(sink.getvalue().to_pybytes())


def index_page(verb: str, rows: Sequence[Row], tables: Sequence[str]) -> str:
    """Return the page: numbers of jobs, errors, failures, links to every report."""
    done = [row for row in rows if row['state'] == 'done']
    bad = [row for row in rows if row['state'] != 'done']
    summarized = _identified if verb == 'identify' else _discovered
    sections = [summarized(done)] if done else []
    if bad:
        cells = [(row['name'], row['state'], row['error']) for row in bad[:_SHOWN]]
        why = table(('data', 'state', 'why'), cells)
        sections.append(PageSection('Refused and failed data sets', '', (), (why,)))
    summary = f'{len(done)} of {len(rows)} data sets went through `{verb}`'
    summary += f', {len(bad)} did not.' if bad else '.'
    text = f'All columns, in SI units: {", ".join(f"`{name}`" for name in tables)}.'
    sections.append(PageSection('Complete table', text))
    return render(f'Batch: {verb} over {len(rows)} data sets', summary, sections)


def _identified(rows: Sequence[Row]) -> PageSection:
    ranked = sorted(rows, key=lambda row: _size(row['free_run_rms_m']))
    cells = [
        (
            _link(row),
            row['model'],
            micrometres(row['free_run_rms_m']),
            f'{_size(row["nrmse_percent"]):.3g}',
            micrometres(row['noise_floor_rms_m']),
            row['converged'],
            row['warnings'],
        )
        for row in reversed(ranked[-_SHOWN:])
    ]
    headers = ('data', 'model', 'free run [µm]', '% of std', 'noise floor [µm]', 'converged',
               'warnings')  # fmt: skip
    middle = ranked[len(ranked) // 2]
    text = (
        'Free-run error of the worst record of each, the largest first. Half of the data sets '
        f'are below {micrometres(middle["free_run_rms_m"])} µm.'
    )
    return _section(
        'How well do the models follow?', text, ranked, 'free_run_rms_m', headers, cells
    )


def _discovered(rows: Sequence[Row]) -> PageSection:
    ranked = sorted(rows, key=lambda row: _size(row['before_in_floors']))
    cells = [
        (
            _link(row),
            row['verdict'],
            row['effects'],
            row['probability'],
            row['before_in_floors'],
            row['after_in_floors'],
        )
        for row in reversed(ranked[-_SHOWN:])
    ]
    headers = ('data', 'verdict', 'effects', 'probability', 'before [floors]', 'after [floors]')
    names = [name for row in rows for name in str(row['effects']).split('; ') if name]
    counts = sorted({(-names.count(name), name) for name in names})
    often = ', '.join(f'`{name}` {-count} times' for count, name in counts) or 'nothing'
    text = f'Gap on held-out records in multiples of the noise, the largest first. Named: {often}.'
    return PageSection('Missing effects', text, (), (_table(headers, cells),))


def _section(
    title: str, text: str, ranked: Sequence[Row], column: str, headers: Any, cells: Any
) -> PageSection:
    sizes = np.array([_size(row[column]) for row in ranked])
    known = sizes[np.isfinite(sizes)]
    figures: tuple[Plot, ...] = ()
    if known.size > 1:
        share = 100.0 * (np.arange(known.size) + 1.0) / sizes.size
        curve = Curve('free run', share, known)
        caption = 'Every data set, from the best to the worst.'
        figures = (
            xy_figure([curve], 'Errors', caption, 'share of the data sets [%]', 'rms error [µm]',
                      log_y=True),
        )  # fmt: skip
    return PageSection(title, text, figures, (_table(headers, cells),))


def _table(headers: Any, cells: Any) -> Table:
    return table(headers, cells)


def _link(row: Row) -> str:
    return f'[{row["name"]}]({row["report"]})'


def _size(value: float | None) -> float:
    return float('inf') if value is None else float(value)
