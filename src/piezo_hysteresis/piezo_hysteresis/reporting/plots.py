"""Plots with a uniform style, and their axes, lines, legends and marks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import (
    BasicTickFormatter,
    ColumnDataSource,
    FactorRange,
    FixedTicker,
    HoverTool,
    Label,
    Legend,
    LegendItem,
    LogTicker,
    Range1d,
    Span,
)
from bokeh.plotting import figure
from bokeh.transform import dodge

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.reporting.display_units import MICRO
from piezo_hysteresis.reporting.page import Plot
from piezo_hysteresis.reporting.signals import amplitude_spectrum, envelope, thinned

#: Okabe and Ito: distinct with any colour vision, and by lightness in print.
PALETTE = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#000000')
GREY = '#8c959f'
#: The role of a line has the same colour in all reports and figures.
ROLES = {
    'uncompensated': PALETTE[1],
    'feedforward': PALETTE[0],
    'attenuated': PALETTE[2],
    'fed_back': PALETTE[3],
    'everything': PALETTE[4],
    'before': PALETTE[1],
    'after': PALETTE[0],
    'model': PALETTE[0],
    'error': PALETTE[1],
    'lost': '#20242a',
}
#: Roles that overlap others: their lines are dashed, so that both stay visible.
_ON_TOP = {'attenuated', 'after', 'model'}
_FEW_DECADES = 300.0
#: Colour of marks on axes, readable on white.
MARK = '#7a2a58'
_HEIGHT = 250
_WIDE_LEGEND = 44  # characters of a legend line above a plot on a phone


@dataclass(frozen=True)
class Curve:
    """A line of a plot."""

    label: str  # name in the legend
    x: FloatArray  # (n,)
    y: FloatArray  # (n,)
    role: str = ''  # one of `ROLES`, which fixes its colour; '' takes the next colour


def new_axes(title: str, x_label: str, y_label: str, **options: Any) -> Any:
    """Return an empty plot with the uniform style."""
    plot = figure(
        title=title, x_axis_label=x_label, y_axis_label=y_label, frame_height=_HEIGHT,
        sizing_mode='stretch_width', tools='pan,box_zoom,wheel_zoom,reset,save',
        active_drag='box_zoom', toolbar_location='above', min_border_right=18, **options,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.toolbar.stylesheets = ['@media print { :host { display: none !important; } }']
    plot.title.text_font_size = '14px'
    plot.grid.grid_line_color = '#e6e9ec'
    plot.axis.minor_tick_line_color = None
    plot.axis.axis_label_text_font_style = 'normal'
    plot.axis.axis_label_text_font_size = '13px'
    plot.axis.major_label_text_font_size = '12px'
    plot.outline_line_color = '#d0d7de'
    return plot


def draw_lines(
    plot: Any,
    curves: Sequence[Curve],
    x_factor: float,
    y_factor: float,
    *,
    markers: bool = False,
    ground: bool = False,
    overlaid: bool = False,
    more: Sequence[tuple[str, Any]] = (),
) -> None:
    """Draw lines; `more` are additional entries of the legend.

    A `ground` is wide and grey, so that it stays visible below other curves; with `overlaid`,
    curves that overlap others are dashed.
    """
    ground = ground and len(curves) > 1 and not curves[0].role
    colours = (GREY, *PALETTE) if ground else PALETTE
    items = []
    for k, curve in enumerate(curves):
        x, y = thinned(np.asarray(curve.x, float), np.asarray(curve.y, float))
        colour = ROLES.get(curve.role) or colours[k % len(colours)]
        if curve.role == 'lost':
            source = {'x': curve.x * x_factor, 'y': curve.y * y_factor}
            cross = plot.scatter('x', 'y', source=source, color=colour, size=7, marker='x')
            items.append((curve.label, [cross]))
            continue
        broken = overlaid and k > 0 and curve.role in _ON_TOP
        line = plot.line(
            'x', 'y', source={'x': x * x_factor, 'y': y * y_factor}, color=colour,
            line_width=4.0 if ground and k == 0 else 1.8 if broken else 1.5, line_join='round',
            line_dash=[7, 4] if broken else 'solid',
        )  # fmt: skip
        drawn = [line]
        if markers:
            drawn.append(
                plot.scatter(
                    'x', 'y', source=line.data_source, color=colour, size=7,
                    marker=('circle', 'square', 'triangle')[k % 3],
                )
            )  # fmt: skip
        items.append((curve.label, drawn))
    if len(items) + len(more) > 1:
        add_legend(plot, [*items, *more])


def draw_bands(plot: Any, curves: Sequence[Curve], y_factor: float, count: int) -> None:
    """Draw each curve as a band between the smallest and largest value of `count` intervals."""
    items = []
    for k, curve in enumerate(curves):
        x, low, high = envelope(np.asarray(curve.x, float), np.asarray(curve.y, float), count)
        source = {'x': x, 'low': low * y_factor, 'high': high * y_factor}
        colour = ROLES.get(curve.role) or PALETTE[k % len(PALETTE)]
        band = plot.varea_step(
            'x', 'low', 'high', source=source, color=colour, alpha=(0.35, 0.75)[k > 0],
            step_mode='after',
        )  # fmt: skip
        items.append((curve.label, band))
    if len(items) > 1:
        add_legend(plot, items)


def add_legend(plot: Any, items: Sequence[tuple[str, Any]]) -> None:
    """Place the legend above the plot, where it covers nothing, wrapped for a phone."""
    rows = [
        LegendItem(label=label, renderers=drawn if isinstance(drawn, list) else [drawn])
        for label, drawn in items
    ]
    longest = max(len(label) for label, _ in items) + 6  # the page adapts it to its width
    plot.add_layout(
        Legend(
            items=rows, ncols=max(1, min(len(rows), _WIDE_LEGEND // longest)),
            click_policy='hide', border_line_color=None, padding=0, margin=4, spacing=14,
            location='left',
            label_text_font_size='12px', glyph_width=26, label_height=14, glyph_height=14,
        ),
        'above',
    )  # fmt: skip


def draw_floor(plot: Any, floor: float | None) -> list[tuple[str, Any]]:
    """Draw the noise floor [m] as a horizontal line, if known, and return its legend entry."""
    if floor is None or not floor > 0:
        return []
    look = {'line_dash': 'dotted', 'line_color': '#000000', 'line_width': 1.5}
    plot.add_layout(Span(location=MICRO * floor, dimension='width', level='underlay', **look))
    # a label in the plot would cover bars or lines; an invisible line provides the legend entry
    nowhere = plot.line([0.0, 0.0], [np.nan, np.nan], **look)
    return [(f'noise floor, {MICRO * floor:.3g} µm', nowhere)]


def draw_mark(plot: Any, place: float, words: str, colour: str = GREY, low: bool = False) -> None:
    """Mark a position on the x axis by a dotted line and a label."""
    look = {'line_dash': 'dotted', 'line_color': colour, 'line_width': 1, 'level': 'underlay'}
    plot.add_layout(Span(location=place, dimension='height', **look))
    height = 4 if low else _HEIGHT - 16
    text = {'text': words, 'text_font_size': '11px', 'text_color': colour, 'x_offset': 2}
    # a low label is left of its line, so that it does not cover that of a harmonic there
    if low:
        text |= {'x_offset': -3, 'text_align': 'right'}
    plot.add_layout(Label(x=place, y=height, y_units='screen', **text))


def readable_decades(axis: Any, values: Iterable[float]) -> None:
    """Label a logarithmic axis by plain numbers, several per decade on a short axis."""
    known = [value for value in values if np.isfinite(value) and value > 0]
    few = bool(known) and max(known) / min(known) < _FEW_DECADES
    if few:
        first, last = (
            int(np.floor(np.log10(min(known)))) - 1,
            int(np.ceil(np.log10(max(known)))) + 1,
        )
        ticks = [m * 10.0**k for k in range(first, last + 1) for m in (1, 2, 5)]
        axis.ticker = FixedTicker(ticks=ticks)
    else:
        axis.ticker = LogTicker(mantissas=[1], desired_num_ticks=7)
    # no custom formatter: the content security policy forbids scripts made from strings
    axis.formatter = BasicTickFormatter(power_limit_low=-4, power_limit_high=4)


def loop_figure(curves: Sequence[Curve], title: str, caption: str, input_unit: str = 'V') -> Plot:
    """Draw displacement [m] over voltage [V] (or force [N], or reference [m])."""
    name, factor, unit = {
        'V': ('voltage', 1.0, 'V'),
        'N': ('force', 1.0, 'N'),
        'm': ('reference', MICRO, 'µm'),
    }[input_unit]
    plot = new_axes(title, f'{name} [{unit}]', 'displacement [µm]')
    draw_lines(plot, curves, factor, MICRO, ground=True, overlaid=True)
    return Plot(plot, caption)


#: Crossings of its mean up to which a drive makes a loop and not a block: six periods.
_CROSSINGS = 12


def response_figure(
    drive: FloatArray,  # [s] (n,)
    time: FloatArray,  # [s] (n,)
    responses: Sequence[tuple[str, FloatArray, str]],  # [m]
    title: str,
    caption: str,
    input_unit: str = 'V',
) -> Plot:
    """Draw displacements [m] over the drive, or over time where loops would merge into a block.

    Over time, the stretch is drawn in which the first two responses differ most.
    """
    above = drive > float(np.mean(drive))
    crossings = np.flatnonzero(above[1:] != above[:-1])
    if crossings.size <= _CROSSINGS:
        loops = [Curve(label, drive, y, role) for label, y, role in responses]
        return loop_figure(loops, title, caption, input_unit)
    length = max(_CROSSINGS * drive.size // crossings.size, 2)
    error = np.abs(responses[0][1] - responses[1][1])
    first = length * (int(np.argmax(error)) // length)
    part = slice(first, first + length)
    traces = [Curve(label, time[part], y[part], role) for label, y, role in responses]
    caption = f'{caption} Over time, because many small loops would overlap.'
    return trace_figure(traces, title, caption)


def trace_figure(
    curves: Sequence[Curve],
    title: str,
    caption: str,
    y_label: str = 'displacement',
    *,
    ground: bool = True,
) -> Plot:
    """Draw displacements or errors [m] over time [s]."""
    plot = new_axes(title, 'time [s]', f'{y_label} [µm]')
    draw_lines(plot, curves, 1.0, MICRO, ground=ground, overlaid=ground)
    return Plot(plot, caption)


#: Number of periods from which a trace merges into a block and is drawn as a band.
_PERIODS_AS_LINES = 8
_BANDS = 240


def band_figure(
    curves: Sequence[Curve], title: str, caption: str, y_label: str, frequency: float
) -> Plot:  # frequency [Hz]
    """Draw errors [m] over time [s], as bands where lines would merge into a block."""
    spans = [float(np.ptp(curve.x)) for curve in curves if len(curve.x)]
    periods = max(spans, default=0.0) * frequency
    if 0.0 < periods <= _PERIODS_AS_LINES:
        return trace_figure(curves, title, caption, y_label, ground=False)
    count = min(_BANDS, max(int(periods), 1)) if periods else _BANDS
    plot = new_axes(title, 'time [s]', f'{y_label} [µm]')
    draw_bands(plot, curves, MICRO, count)
    note = 'Band: smallest to largest value of each ' + ('period.' if periods else 'interval.')
    if periods > _BANDS:
        note = f'Band: smallest to largest value of every {periods / _BANDS:.0f} periods.'
    return Plot(plot, f'{caption} {note}'.strip())


def xy_figure(
    curves: Sequence[Curve],
    title: str,
    caption: str,
    x_label: str,
    y_label: str,
    *,
    log_x: bool = False,
    log_y: bool = False,
    markers: bool = True,
    floor: float | None = None,  # [m]
) -> Plot:
    """Draw displacements [m] over any quantity; the labels contain the units, that of y is µm."""
    kinds = {'x_axis_type': 'log' if log_x else 'auto', 'y_axis_type': 'log' if log_y else 'auto'}
    plot = new_axes(title, x_label, y_label, **kinds)
    more = draw_floor(plot, floor)
    draw_lines(plot, curves, 1.0, MICRO, markers=markers, more=more)
    if log_y:
        drawn = [MICRO * v for c in curves for v in np.asarray(c.y, float)]
        readable_decades(plot.yaxis[0], [*drawn, MICRO * (floor or 0.0)])
    if floor and log_y:
        # the axis range does not adapt to annotations
        values = [MICRO * v for c in curves for v in np.asarray(c.y)[np.asarray(c.y) > 0]]
        plot.y_range = Range1d(
            min([MICRO * floor, *values]) / 2, max([MICRO * floor, *values]) * 2
        )
    return Plot(plot, caption)


def spectrum_figure(
    signals: Sequence[tuple[str, FloatArray]],  # [m]
    dt: float,  # [s]
    title: str,
    caption: str,
    *,
    roles: Sequence[str] = (),
    fundamental: float = 0.0,  # [Hz]
    orders: Sequence[int] = (1, 3, 5, 7),
    marks: Mapping[str, float] | None = None,  # [Hz]
    highest: float | None = None,  # [Hz]
) -> Plot:
    """Draw amplitude spectra with the harmonics of the drive marked."""
    end = min(0.5 / dt, highest or (12 * fundamental if fundamental > 0 else np.inf))
    plot = new_axes(title, 'frequency [Hz]', 'amplitude [µm]', y_axis_type='log', x_range=(0, end))
    curves = []
    named = [*roles, *[''] * len(signals)]
    for (label, signal), role in zip(signals, named, strict=False):
        frequency, amplitude = amplitude_spectrum(signal, dt)
        inside = frequency <= end
        # thinned here, so that only one whole spectrum exists at a time
        x, y = thinned(frequency[inside], amplitude[inside])
        curves.append(Curve(label, x, np.maximum(y, 1e-13), role))
    draw_lines(plot, curves, 1.0, MICRO, ground=True)
    for order in orders:
        if 0 < order * fundamental < end:
            draw_mark(plot, order * fundamental, f'{order}×')
    for shown, place in (marks or {}).items():
        if 0 < place < end:
            draw_mark(plot, place, shown, colour=MARK, low=True)
    return Plot(plot, caption)


# Characters of equally wide labels that fit below the axis side by side.
_LEVEL_CHARACTERS = 60
#: Largest number of pairs of bars with labelled values.
_LABELLED = 6


def _label_bars(plot: Any, names: Sequence[str], values: Sequence[float], shift: float) -> None:
    """Write the value [m] above each bar, in µm."""
    known = [(name, MICRO * v) for name, v in zip(names, values, strict=True) if np.isfinite(v)]
    source = ColumnDataSource(
        {
            'x': [name for name, _ in known],
            'y': [value for _, value in known],
            'text': [f'{value:.3g}' for _, value in known],
        }
    )
    place = dodge('x', shift, range=plot.x_range)
    plot.text(
        x=place, y='y', text='text', source=source, text_align='center', text_baseline='bottom',
        text_font_size='11px', y_offset=-2, background_fill_color='#ffffff',
        background_fill_alpha=0.85,
    )  # fmt: skip


def bars_before_after(
    frequencies: Sequence[float | str],  # [Hz]
    before: Sequence[float],  # [m]
    after: Sequence[float] | None,  # [m]
    floor: float | None,  # [m]
    *,
    title: str = 'Error before and after',
    caption: str = '',
    labels: tuple[str, str] = ('before', 'after'),
) -> Plot:
    """Draw errors [m] before and after as pairs of bars on a logarithmic axis."""
    names = [f if isinstance(f, str) else f'{f:g} Hz' for f in frequencies]
    pairs = (
        [(labels[0], before)] if after is None else [*zip(labels, (before, after), strict=True)]
    )
    width, middle = 0.8 / len(pairs), 0.5 * (len(pairs) - 1)
    values = [MICRO * v for _, rows in pairs for v in rows if np.isfinite(v) and v > 0]
    known = [*values, *([MICRO * floor] if floor and floor > 0 else [])] or [1.0]
    bottom = min(known) / 2
    ends = (bottom, max(known) * 1.9)
    places = FactorRange(*names, range_padding=0.05)
    plot = new_axes(title, '', 'rms error [µm]', y_axis_type='log', x_range=places, y_range=ends)
    if len(names) * max(map(len, names), default=0) > _LEVEL_CHARACTERS:
        plot.xaxis.major_label_orientation = 1.1
    items = []
    for k, (label, rows) in enumerate(pairs):
        offset = width * (k - middle)
        source = {'x': names, 'top': [MICRO * v if np.isfinite(v) else bottom for v in rows]}
        bars = plot.vbar(
            x=dodge('x', offset, range=places), top='top', bottom=bottom, width=0.9 * width,
            source=source, name='bars', line_color=None,
            fill_color=(ROLES['before'], ROLES['after'])[k],
            hatch_pattern=(None, 'right_diagonal_line')[k], hatch_color='white', hatch_alpha=0.6,
        )  # fmt: skip
        if len(names) <= _LABELLED:
            _label_bars(plot, names, rows, offset)
        items.append((label, bars))
        columns = [('record', '@x'), (label, '@top{0.0000} µm')]
        plot.add_tools(HoverTool(renderers=[bars], tooltips=columns))
    readable_decades(plot.yaxis[0], known)
    add_legend(plot, [*items, *draw_floor(plot, floor)])
    return Plot(plot, caption)
