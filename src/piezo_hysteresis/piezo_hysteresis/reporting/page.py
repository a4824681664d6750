"""Page of a report: its template, HTML and CSS for screen, phone and print.

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

# Bokeh needs only inline scripts and styles, and generated images.
PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:">
<title>{{ title }}</title>
<style>{{ style }}</style>
{{ library }}
</head>
<body>
<main>
<h1>{{ title }}</h1>
<p class="verdict">{{ verdict }}</p>
{{ body }}
<footer>piezo_hysteresis {{ version }}, {{ date }}. Plots: choose a tool above a plot to zoom or move; a click
on a name in a legend hides its line.</footer>
</main>
{{ script }}
<script>
{{ exports }}
const touch = matchMedia('(pointer: coarse)').matches;
function suit(plot) {
  // A finger on a plot scrolls the page until a tool is chosen.
  if (touch) for (const tool of plot.toolbar.tools) if (tool.active === true) tool.active = false;
}
function wrap(plot, width) {
  // As many names of a legend side by side as there is room for.
  for (const legend of plot.above.filter((part) => part.type === 'Legend')) {
    const longest = Math.max(...legend.items.map((item) => item.label.value.length));
    legend.ncols = Math.max(1, Math.floor((width - 80) / (6.5 * longest + 44)));
  }
}
document.addEventListener('DOMContentLoaded', () => {
  const figures = [...document.querySelectorAll('figure')];
  const timer = setInterval(() => {
    const plots = (window.Bokeh?.documents ?? []).flatMap((page) => page.roots());
    if (plots.length < figures.length) return;
    clearInterval(timer);
    plots.forEach(suit);
    addExports();
    const wrapAll = () => plots.forEach((plot) => wrap(plot, figures[0].clientWidth));
    wrapAll();
    addEventListener('resize', wrapAll);  // a phone that is turned
  }, 50);
});
// Canvases keep the width that they have on the screen: on paper each is scaled to the page.
const PAPER = 540;  // three of them below each other
addEventListener('beforeprint', () => {
  for (const part of document.querySelectorAll('details:not([open])')) part.open = true;
  for (const figure of document.querySelectorAll('figure')) {
    const width = figure.clientWidth;
    figure.style.width = width + 'px';
    figure.style.zoom = Math.min(1, PAPER / width);
  }
});
addEventListener('afterprint', () => {
  for (const figure of document.querySelectorAll('figure'))
    figure.style.zoom = figure.style.width = '';
});
</script>
</body>
</html>
"""  # noqa: E501

STYLE = """
:root { color-scheme: light; --ink: #1b1f24; --soft: #57606a; --line: #d0d7de; --mark: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); overflow-wrap: break-word;
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1200px; margin: 0 auto; padding: 1rem clamp(.75rem, 3vw, 2rem) 3rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: .6rem 0; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .4rem; padding-top: .8rem;
  border-top: 1px solid var(--line); }
details { border-top: 1px solid var(--line); margin-top: .8rem; }
details h2 { display: inline; border: 0; margin: 0; padding: 0; font-size: 1.05rem; }
summary { cursor: pointer; padding: .6rem 0; }
p, li { max-width: 75ch; }
.verdict { font-size: 1.15rem; max-width: none; margin: .6rem 0 1rem; padding: .8rem 1rem;
  background: #f2f8fc; border-left: 5px solid var(--mark); }
.plots { display: grid; gap: 1.2rem; margin: .8rem 0;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 460px), 1fr)); }
.plots > :last-child:nth-child(odd):not(:only-child) { grid-column: 1 / -1; }
figure { margin: 0; min-width: 0; }
figcaption, .caption { color: var(--soft); font-size: .9rem; }
.caption { margin: 1rem 0 0; }
/* Shadows at an edge say that there is more behind it; those in the table's own colour move along
   with it and cover them at the end. */
.wide { overflow-x: auto; margin: .3rem 0 .8rem;
  background: linear-gradient(to right, #fff 30%, #fff0) 0 0 / 40px 100% no-repeat local,
    linear-gradient(to left, #fff 30%, #fff0) 100% 0 / 40px 100% no-repeat local,
    radial-gradient(farthest-side at 0 50%, #1b1f2455, #1b1f2400) 0 0 / 14px 100% no-repeat scroll,
    radial-gradient(farthest-side at 100% 50%, #1b1f2455, #1b1f2400) 100% 0 / 14px 100% no-repeat
    scroll; }
table { border-collapse: collapse; width: max-content; font-size: .92rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .9rem .3rem 0; text-align: left; vertical-align: top;
  max-width: 46ch; border-bottom: 1px solid var(--line); }
th { border-bottom: 2px solid var(--soft); }
.number { text-align: right; }
td.number { white-space: nowrap; }
code { background: #f3f4f6; padding: .05em .3em; border-radius: 3px; font-size: .9em; }
footer { margin-top: 2.5rem; color: var(--soft); font-size: .85rem; }
@page { size: A4; margin: 16mm 15mm 18mm; }
@media print {
  body { font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  figure, tr, .verdict { break-inside: avoid; }
  h1, h2, h2 + p, .caption { break-after: avoid; }
  p { break-inside: avoid; }
  .plots { break-before: avoid; }
  h2 { margin-top: 1.2rem; }
  .plots { display: block; }
  figure { margin-bottom: .8rem; }
  p, li { max-width: none; }
  .wide { overflow: visible; background: none; }
  table { width: 100%; font-size: 9pt; }
  th, td { padding-right: .5rem; }
}
"""


EXPORT_STYLE = """
.export { display: flex; gap: .4rem; justify-content: flex-end; margin: .1rem 0; }
.export button { font: inherit; font-size: .75rem; color: var(--soft); background: none;
  border: 1px solid var(--line); border-radius: 3px; padding: 0 .4rem; cursor: pointer; }
@media print { .export { display: none; } }
"""

# Plain functions: the content security policy of a report forbids scripts made from strings.
EXPORT_SCRIPT = """
const DRAWN_TEXT = new Set(['Text', 'VSpan', 'HSpan']);
function seriesOf(plot) {
  // Names of the legend by renderer.
  const names = new Map();
  for (const part of [...plot.above, ...plot.center].filter((each) => each.type === 'Legend'))
    for (const item of part.items)
      for (const renderer of item.renderers) names.set(renderer.id, item.label.value ?? '');
  return names;
}
function csvOf(plot) {
  // One row per point in the visible range of x: series, x, y, or low and high of a band.
  const names = seriesOf(plot);
  const {start, end} = plot.x_range;
  const [low, high] = [Math.min(start, end), Math.max(start, end)];
  const rows = [['series', plot.below[0].axis_label || 'x', plot.left[0].axis_label || 'y',
    'low', 'high']];
  const seen = new Set();
  for (const renderer of plot.renderers) {
    const source = renderer.data_source;
    if (!source || !renderer.visible || DRAWN_TEXT.has(renderer.glyph.type)) continue;
    if (seen.has(source.id)) continue;  // a line and its markers share their points
    seen.add(source.id);
    const column = (name) => source.get_column?.(name) ?? source.data[name];
    const [x, y, below, above] = [column('x'), column('y') ?? column('top'), column('low'),
      column('high')];
    for (let k = 0; k < (x?.length ?? 0); k++) {
      if (typeof x[k] === 'number' && (x[k] < low || x[k] > high)) continue;
      if (!above && !Number.isFinite(y[k])) continue;
      rows.push([names.get(renderer.id) || source.name || plot.title.text, x[k], y?.[k] ?? '',
        below?.[k] ?? '', above?.[k] ?? '']);
    }
  }
  const cell = (value) => typeof value === 'string' && /[",\\n]/.test(value)
    ? `"${value.replaceAll('"', '""')}"` : String(value);
  return rows.map((row) => row.map(cell).join(',')).join('\\n') + '\\n';
}
function offer(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
function viewOf(plot) {
  for (const view of Bokeh.index) if (view.model.id === plot.id) return view;
  return null;
}
function addExports() {
  const plots = (window.Bokeh?.documents ?? []).flatMap((page) => page.roots());
  for (const plot of plots.filter((each) => each.type === 'Figure')) {
    const place = [...document.querySelectorAll('[data-root-id]')]
      .find((each) => each.dataset.rootId === plot.id);
    if (!place || place.nextElementSibling?.className === 'export') continue;
    const file = (plot.title.text || 'plot').toLowerCase().replace(/[^a-z0-9]+/g, '_');
    const bar = document.createElement('div');
    bar.className = 'export';
    const button = (text, title, act) => {
      const made = document.createElement('button');
      Object.assign(made, {type: 'button', textContent: text, title, onclick: act});
      bar.append(made);
    };
    button('CSV', 'Export the visible data as CSV',
      () => offer(new Blob([csvOf(plot)], {type: 'text/csv'}), `${file}.csv`));
    button('PNG', 'Export this plot as PNG', async () => {
      const view = viewOf(plot);
      if (view) offer(await view.export('png', true).to_blob(), `${file}.png`);
    });
    place.after(bar);
  }
}
"""


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
