"""One self-contained HTML report: the verdict first, then sections of prose, plots and tables.

The page asks the network for nothing: scripts and styles are inside, and a content security policy
makes the browser hold it to that. It reads on a phone and prints on white paper.
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
from piezo_hysteresis.reporting.page_export import EXPORT_SCRIPT, EXPORT_STYLE
from piezo_hysteresis.reporting.page_style import PAGE, STYLE


@dataclass(frozen=True)
class Plot:
    """A zoomable plot and what it shows.

    Attributes
    ----------
    figure : bokeh.plotting.figure
        Made by `piezo_hysteresis.reporting.plots`.
    caption : str
        What to see in it, in one or two sentences; read aloud where the plot cannot be seen.
    """

    figure: Any
    caption: str


@dataclass(frozen=True)
class Table:
    """A table of formatted texts and numbers.

    Attributes
    ----------
    headers : tuple of str
        One per column, with the unit.
    rows : tuple of tuple of str
        As many cells each as there are headers.
    caption : str
        What it shows; may be empty.

    Raises
    ------
    ValueError
        If a row has another number of cells than there are headers.
    """

    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ''

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.headers):
                raise ValueError(f'a row of {len(row)} cells under {len(self.headers)} headers')


@dataclass(frozen=True)
class PageSection:
    """A part of the report.

    Attributes
    ----------
    title : str
        Subject of the part.
    text : str
        Plain text: an empty line starts a paragraph, ``- `` an item of a list, ```` `...` ````
        marks what is typed,
        ``[words](page.html)`` leads to a page beside this one.
    figures : tuple of Plot
        Side by side where the screen is wide enough.
    tables : tuple of Table
        Below each other, after the figures.
    folded : bool
        Whether only the title shows until a reader opens the section; printed in full.
    """

    title: str
    text: str = ''
    figures: tuple[Plot, ...] = ()
    tables: tuple[Table, ...] = ()
    folded: bool = False


def table(headers: Sequence[str], rows: Sequence[Sequence[object]], caption: str = '') -> Table:
    """Return a table; numbers get four significant digits, what is not known a dash."""
    cells = tuple(tuple(_cell(value) for value in row) for row in rows)
    return Table(tuple(headers), cells, caption)


def render(title: str, verdict: str, sections: Sequence[PageSection]) -> str:
    """Return the whole page as HTML.

    Parameters
    ----------
    title : str
        Heading of the page.
    verdict : str
        What came out, in one sentence.
    sections : sequence of PageSection
        In the order in which they are read.
    """
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
    """Write the page that `render` makes, whole or not at all.

    Raises
    ------
    PiezoError
        If the file cannot be written.
    """
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
    # to pages beside this one only: an address with a scheme stays as it is typed
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
