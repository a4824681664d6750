"""Export buttons of each plot: CSV of the visible range, and PNG."""

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
