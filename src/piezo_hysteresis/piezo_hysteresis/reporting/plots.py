"""Zoomable plots of one look: loops, traces, spectra, before and after. Metres in, µm drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import FactorRange, HoverTool, Label, Legend, LegendItem, Range1d, Span
from bokeh.plotting import figure
from bokeh.transform import dodge

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.reporting.page import Plot
from piezo_hysteresis.reporting.signals import amplitude_spectrum, thinned

#: Okabe and Ito: told apart with any colour vision, and by lightness in print.
PALETTE = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#000000')
GREY = '#8c959f'
MICRO = 1e6
_HEIGHT = 250
_WIDE_LEGEND = 44  # characters that fit beside each other above a plot on a phone


@dataclass(frozen=True)
class Curve:
    """A line of a plot.

    Attributes
    ----------
    label : str
        Its name in the legend.
    x, y : ndarray, shape (n,)
        In SI units.
    """

    label: str
    x: FloatArray
    y: FloatArray


def loop_figure(curves: Sequence[Curve], title: str, caption: str, input_unit: str = 'V') -> Plot:
    """Draw displacement [m] over voltage [V] (or force [N], or reference [m]).

    Parameters
    ----------
    curves : sequence of Curve
        Whole loops, the measured one first.
    title, caption : str
        Above and below the plot.
    input_unit : str
        ``V``, ``N`` or ``m`` (a reference).
    """
    name, factor, unit = {
        'V': ('voltage', 1.0, 'V'),
        'N': ('force', 1.0, 'N'),
        'm': ('reference', MICRO, 'µm'),
    }[input_unit]
    plot = _axes(title, f'{name} [{unit}]', 'displacement [µm]')
    _lines(plot, curves, factor, MICRO, ground=True)
    return Plot(plot, caption)


def trace_figure(
    curves: Sequence[Curve],
    title: str,
    caption: str,
    y_label: str = 'displacement',
    *,
    ground: bool = True,
) -> Plot:
    """Draw displacements or errors [m] over time [s].

    Parameters
    ----------
    curves : sequence of Curve
        What is measured or desired first.
    title, caption, y_label : str
        Words around the plot.
    ground : bool
        Whether the first curve is a broad grey ground for the others.
    """
    plot = _axes(title, 'time [s]', f'{y_label} [µm]')
    _lines(plot, curves, 1.0, MICRO, ground=ground)
    return Plot(plot, caption)


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
    floor: float | None = None,
) -> Plot:
    """Draw displacements [m] over anything; the labels hold the units, that of y is µm.

    Parameters
    ----------
    curves : sequence of Curve
        x as it is labelled, y in metres.
    title, caption, x_label, y_label : str
        Words around the plot.
    log_x, log_y : bool
        Logarithmic axes.
    markers : bool
        Whether the points are shown.
    floor : float, optional
        Noise floor [m], drawn across.
    """
    kinds = {'x_axis_type': 'log' if log_x else 'auto', 'y_axis_type': 'log' if log_y else 'auto'}
    plot = _axes(title, x_label, y_label, **kinds)
    _lines(plot, curves, 1.0, MICRO, markers=markers)
    if floor and log_y:
        # an axis never grows to hold an annotation
        values = [MICRO * v for c in curves for v in np.asarray(c.y)[np.asarray(c.y) > 0]]
        plot.y_range = Range1d(
            min([MICRO * floor, *values]) / 2, max([MICRO * floor, *values]) * 2
        )
    _floor(plot, floor)
    return Plot(plot, caption)


def spectrum_figure(
    signals: Sequence[tuple[str, FloatArray]],
    dt: float,
    title: str,
    caption: str,
    *,
    fundamental: float = 0.0,
    orders: Sequence[int] = (1, 3, 5, 7),
    marks: Mapping[str, float] | None = None,
    highest: float | None = None,
) -> Plot:
    """Draw amplitude spectra with the harmonics of the drive marked.

    Parameters
    ----------
    signals : sequence of (str, ndarray)
        Labels and displacements or errors [m], whole periods.
    dt : float
        Sampling interval [s].
    title, caption : str
        Above and below the plot.
    fundamental : float
        Frequency of the drive [Hz]; 0 for none.
    orders : sequence of int
        Harmonics that are marked.
    marks : mapping of str to float, optional
        Further frequencies to mark [Hz], such as a resonance.
    highest : float, optional
        Where the axis ends [Hz]; at 12 times the fundamental where not given.
    """
    end = min(0.5 / dt, highest or (12 * fundamental if fundamental > 0 else np.inf))
    plot = _axes(title, 'frequency [Hz]', 'amplitude [µm]', y_axis_type='log', x_range=(0, end))
    curves = []
    for label, signal in signals:
        frequency, amplitude = amplitude_spectrum(signal, dt)
        inside = frequency <= end
        curves.append(Curve(label, frequency[inside], np.maximum(amplitude[inside], 1e-13)))
    _lines(plot, curves, 1.0, MICRO, ground=True)
    for order in orders:
        if 0 < order * fundamental < end:
            _mark(plot, order * fundamental, f'{order}×')
    for words, place in (marks or {}).items():
        if 0 < place < end:
            _mark(plot, place, words, colour=PALETTE[3], low=True)
    return Plot(plot, caption)


def bars_before_after(
    frequencies: Sequence[float | str],
    before: Sequence[float],
    after: Sequence[float],
    floor: float | None,
    *,
    title: str = 'Error before and after',
    caption: str = '',
    labels: tuple[str, str] = ('before', 'after'),
) -> Plot:
    """Draw errors [m] before and after side by side on a logarithmic axis.

    Parameters
    ----------
    frequencies : sequence of float or str
        Of the records [Hz], or their names; one pair of bars each, none twice.
    before, after : sequence of float
        Rms errors [m].
    floor : float or None
        Noise floor [m]; where bars reach it nothing is left to explain.
    title, caption : str
        Above and below the plot.
    labels : tuple of str
        What the two bars are.
    """
    names = [f if isinstance(f, str) else f'{f:g} Hz' for f in frequencies]
    values = [MICRO * v for v in (*before, *after) if np.isfinite(v) and v > 0]
    known = [*values, *([MICRO * floor] if floor and floor > 0 else [])] or [1.0]
    bottom = min(known) / 2
    ends = (bottom, max(known) * 1.6)
    places = FactorRange(*names, range_padding=0.05)
    plot = _axes(title, '', 'rms error [µm]', y_axis_type='log', x_range=places, y_range=ends)
    if len(names) > 5:
        plot.xaxis.major_label_orientation = 1.1
    items = []
    for k, (label, rows) in enumerate(zip(labels, (before, after), strict=True)):
        source = {'x': names, 'top': [MICRO * v if np.isfinite(v) else bottom for v in rows]}
        bars = plot.vbar(
            x=dodge('x', -0.2 + 0.4 * k, range=places), top='top', bottom=bottom, width=0.36,
            source=source, fill_color=(GREY, PALETTE[0])[k], line_color=None,
            hatch_pattern=(None, 'right_diagonal_line')[k], hatch_color='white', hatch_alpha=0.6,
        )  # fmt: skip
        items.append((label, bars))
        words = [('record', '@x'), (label, '@top{0.0000} µm')]
        plot.add_tools(HoverTool(renderers=[bars], tooltips=words))
    _legend(plot, items)
    _floor(plot, floor)
    return Plot(plot, caption)


def _axes(title: str, x_label: str, y_label: str, **options: Any) -> Any:
    plot = figure(
        title=title, x_axis_label=x_label, y_axis_label=y_label, frame_height=_HEIGHT,
        sizing_mode='stretch_width', tools='pan,box_zoom,wheel_zoom,reset,save',
        active_drag='box_zoom', toolbar_location='above', min_border_right=18, **options,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.title.text_font_size = '14px'
    plot.grid.grid_line_color = '#e6e9ec'
    plot.axis.minor_tick_line_color = None
    plot.axis.axis_label_text_font_style = 'normal'
    plot.axis.axis_label_text_font_size = '13px'
    plot.axis.major_label_text_font_size = '12px'
    plot.outline_line_color = '#d0d7de'
    return plot


def _lines(
    plot: Any,
    curves: Sequence[Curve],
    x_factor: float,
    y_factor: float,
    *,
    markers: bool = False,
    ground: bool = False,
) -> None:
    """Draw lines; a `ground` is broad and grey, so that what lies on it leaves it visible."""
    ground = ground and len(curves) > 1
    colours = (GREY, *PALETTE) if ground else PALETTE
    items = []
    for k, curve in enumerate(curves):
        x, y = thinned(np.asarray(curve.x, float), np.asarray(curve.y, float))
        colour = colours[k % len(colours)]
        line = plot.line(
            'x', 'y', source={'x': x * x_factor, 'y': y * y_factor}, color=colour,
            line_width=4.0 if ground and k == 0 else 1.5, line_join='round',
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
    if len(items) > 1:
        _legend(plot, items)


def _legend(plot: Any, items: Sequence[tuple[str, Any]]) -> None:
    """Put the legend above the plot, where it covers nothing, wrapped for a phone."""
    rows = [
        LegendItem(label=label, renderers=drawn if isinstance(drawn, list) else [drawn])
        for label, drawn in items
    ]
    longest = max(len(label) for label, _ in items) + 6  # the page refines it by its width
    plot.add_layout(
        Legend(
            items=rows, ncols=max(1, min(len(rows), _WIDE_LEGEND // longest)),
            click_policy='hide', border_line_color=None, padding=0, margin=4, spacing=14,
            location='left',
            label_text_font_size='12px', glyph_width=26, label_height=14, glyph_height=14,
        ),
        'above',
    )  # fmt: skip


def _floor(plot: Any, floor: float | None) -> None:
    if floor is None or not floor > 0:
        return
    plot.add_layout(
        Span(location=MICRO * floor, dimension='width', line_dash='dotted', line_color='#000000',
             line_width=1.5)
    )  # fmt: skip
    plot.add_layout(
        Label(x=6, x_units='screen', y=MICRO * floor, text='noise floor', text_font_size='11px',
              y_offset=2)
    )  # fmt: skip


def _mark(plot: Any, place: float, words: str, colour: str = GREY, low: bool = False) -> None:
    look = {'line_dash': 'dotted', 'line_color': colour, 'line_width': 1, 'level': 'underlay'}
    plot.add_layout(Span(location=place, dimension='height', **look))
    height = 4 if low else _HEIGHT - 16
    text = {'text': words, 'text_font_size': '11px', 'text_color': colour, 'x_offset': 2}
    plot.add_layout(Label(x=place, y=height, y_units='screen', **text))
