"""Self-contained HTML report: the verdict first, then sections of prose, plots and tables.

The page loads nothing from the network: scripts and styles are embedded, and a content security
policy enforces this. The layout is suitable for phones and for print.
"""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bokeh.embed import components
from bokeh.resources import Resources
from jinja2 import Template

from piezo_hysteresis import __version__
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.page_style import EXPORT_SCRIPT, EXPORT_STYLE, PAGE, STYLE


@dataclass(frozen=True)
class Plot:
    """A zoomable plot with a caption."""

    figure: Any  # figure from `piezo_hysteresis.reporting.plots`
    caption: str  # description in one or two sentences; screen readers read it instead of the plot


@dataclass(frozen=True)
class Table:
    """A table of formatted texts and numbers."""

    headers: tuple[str, ...]  # one per column, with the unit
    rows: tuple[tuple[str, ...], ...]  # rows with one cell per header
    caption: str = ''  # description; may be empty

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.headers):
                raise ValueError(f'a row of {len(row)} cells under {len(self.headers)} headers')


@dataclass(frozen=True)
class PageSection:
    """A part of the report."""

    title: str  # title of the section
    text: str = ''
    figures: tuple[Plot, ...] = ()  # figures, side by side on a wide screen
    tables: tuple[Table, ...] = ()  # below each other, after the figures
    folded: bool = False  # whether only the title is visible until a reader opens the section


def table(headers: Sequence[str], rows: Sequence[Sequence[object]], caption: str = '') -> Table:
    """Return a table; numbers get four significant digits, missing values a dash."""
    cells = tuple(tuple(_cell(value) for value in row) for row in rows)
    return Table(tuple(headers), cells, caption)


def render(title: str, verdict: str, sections: Sequence[PageSection]) -> str:
    """Return the complete page as HTML."""
    figures = [plot.figure for section in sections for plot in section.figures]
    script, places = components(figures) if figures else ('', ())
    waiting = iter(places)
    body = [_section(section, [next(waiting) for _ in section.figures]) for section in sections]
    text: str = Template(PAGE, keep_trailing_newline=True).render(
        title=html.escape(title),
        verdict=_inline(verdict),
        style=STYLE + EXPORT_STYLE,
        exports=EXPORT_SCRIPT,
        library=Resources(mode='inline', components=['bokeh']).render() if figures else '',
        body='\n'.join(body),
        script=script,
        version=__version__,
        date=datetime.now(UTC).strftime('%Y-%m-%d %H:%M UTC'),
    )
    return text


def write_report(
    path: str | Path, title: str, verdict: str, sections: Sequence[PageSection]
) -> None:
    """Write the page of `render`; the file is complete or unchanged."""
    target = Path(path)
    write_folder(target.parent, {target.name: render(title, verdict, sections)})


def _section(section: PageSection, places: Sequence[str]) -> str:
    heading = f'<h2>{html.escape(section.title)}</h2>'
    opening, closing = '<section>\n', '\n</section>'
    if section.folded:
        heading = f'<summary>{heading}</summary>'
        opening, closing = '<details>\n', '\n</details>'
    parts = [opening + heading, _prose(section.text)]
    if places:
        plots = ''.join(
            f'<figure role="group" aria-label="{html.escape(plot.caption)}">{place}'
            f'<figcaption>{_inline(plot.caption)}</figcaption></figure>\n'
            for plot, place in zip(section.figures, places, strict=True)
        )
        parts.append(f'<div class="plots">\n{plots}</div>')
    parts += [_table(each) for each in section.tables]
    return '\n'.join(part for part in parts if part) + closing


def _prose(text: str) -> str:
    blocks = []
    for block in re.split(r'\n\s*\n', text.strip()):
        lines = block.strip().splitlines()
        if lines and all(line.lstrip().startswith('- ') for line in lines):
            items = ''.join(f'<li>{_inline(line.lstrip()[2:])}</li>' for line in lines)
            blocks.append(f'<ul>{items}</ul>')
        elif lines:
            blocks.append(f'<p>{_inline(" ".join(lines))}</p>')
    return '\n'.join(blocks)


def _inline(text: str) -> str:
    marked = re.sub(r'`([^`]+)`', r'<code>\1</code>', html.escape(text))
    # links to pages in the same folder only: an address with a scheme stays plain text
    return re.sub(r'\[([^\[\]]+)\]\(([^():\s]+)\)', r'<a href="\2">\1</a>', marked)


def _table(table: Table) -> str:
    right = [
        all(_is_number(row[k]) for row in table.rows) and bool(table.rows)
        for k in range(len(table.headers))
    ]

    def row(cells: Sequence[str], tag: str) -> str:
        inner = ''.join(
            f'<{tag}{" class=number" if r else ""}>{_inline(cell)}</{tag}>'
            for cell, r in zip(cells, right, strict=True)
        )
        return f'<tr>{inner}</tr>'

    caption = f'<p class="caption">{_inline(table.caption)}</p>\n' if table.caption else ''
    rows = '\n'.join(row(cells, 'td') for cells in table.rows)
    return (
        f'{caption}<div class="wide"><table>\n<thead>{row(table.headers, "th")}</thead>\n'
        f'<tbody>{rows}</tbody></table></div>'
    )


def _cell(value: object) -> str:
    if value is None:
        return '–'
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    if isinstance(value, float):
        return f'{value:.4g}' if value == value else '–'
    return str(value)


def _is_number(cell: str) -> bool:
    first = cell.split(' ')[0].split('(')[0].replace('−', '-').rstrip('%')
    try:
        float(first)
    except ValueError:
        return cell in ('–', '')
    return True
