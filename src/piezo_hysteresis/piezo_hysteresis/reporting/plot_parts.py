"""Parts of all plots with a uniform style: axes, lines, legends and marks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import (
    BasicTickFormatter,
    FixedTicker,
    Label,
    Legend,
    LegendItem,
    LogTicker,
    Span,
)
from bokeh.plotting import figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.reporting.display_units import MICRO
from piezo_hysteresis.reporting.signals import envelope, thinned

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
