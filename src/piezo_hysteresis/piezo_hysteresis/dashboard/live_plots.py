"""Plots of the current signals: loop, traces and spectrum. Input in metres, display in µm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.models import ColumnDataSource, HoverTool, Label, Range1d, Span

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.dashboard.live_state import Gap, ShownEstimate, Window
from piezo_hysteresis.reporting.display_units import MICRO, shown
from piezo_hysteresis.reporting.plots import GREY, PALETTE, add_legend, new_axes
from piezo_hysteresis.reporting.signals import amplitude_spectrum

HEIGHT = 230


class Follower:
    """Range around the data: it grows immediately and shrinks only if much of it is empty."""

    def __init__(self, logarithmic: bool = False, floor: float = 1e-3) -> None:
        start, end = (0.1, 10.0) if logarithmic else (-1.0, 1.0)
        self.range = Range1d(start, end)
        self._logarithmic, self._floor = logarithmic, floor
        self._set = (start, end)

    def fit(self, low: float, high: float) -> None:
        """Extend the range to `low` .. `high`."""
        if not (math.isfinite(low) and math.isfinite(high)):
            return
        if (self.range.start, self.range.end) != self._set:
            return  # the user has zoomed; the reset tool restores the automatic range
        limits = self._decades(low, high) if self._logarithmic else self._linear(low, high)
        if limits != self._set:
            self._set = limits
            start, end = limits
            self.range.update(start=start, end=end, reset_start=start, reset_end=end)

    def _decades(self, low: float, high: float) -> tuple[float, float]:
        bottom = math.floor(math.log10(max(low, self._floor)))
        top = math.ceil(math.log10(max(high, self._floor) * 1.2))
        return 10.0**bottom, 10.0 ** max(top, bottom + 1)

    def _linear(self, low: float, high: float) -> tuple[float, float]:
        span = max(high - low, self._floor)
        start, end = self._set
        inside = start <= low - 0.01 * span and high + 0.01 * span <= end
        if inside and span > 0.6 * (end - start):
            return self._set
        middle = 0.5 * (low + high)
        return middle - 0.6 * span, middle + 0.6 * span


def live_axes(title: str, x_label: str, y_label: str, x: Any, y: Any, **options: Any) -> Any:
    """Return an empty plot in the style of the reports, with less height and inactive tools."""
    plot = new_axes(title, x_label, y_label, x_range=x, y_range=y, **options)
    plot.frame_height = HEIGHT
    plot.toolbar.active_drag = None  # a finger on a plot scrolls the page
    plot.toolbar.autohide = True
    plot.toolbar.stylesheets = [':host(.bk-hidden) { visibility: hidden; }']
    return plot


def columns_of(plot: Any) -> int:
    """Return the number of pixel columns of the plot in the browser."""
    try:
        width = int(plot.inner_width)
    except UnsetValueError:  # not on a screen yet
        width = 0
    return min(max(width, 300), 1600)


def columns(first: int, values: FloatArray, pixels: int) -> tuple[IntArray, FloatArray]:
    """Return the smallest and the largest value of every pixel column with their positions.

    Columns hold equal numbers of samples and begin at multiples of that number, for any part of
    the signal: a peak keeps its height while it moves across the screen.
    """
    # values (n,)
    if pixels < 1:
        raise ValueError(f'{pixels} pixel columns: give at least 1')
    samples = np.arange(first, first + values.size)
    width = math.ceil(values.size / pixels)
    if width <= 2:
        return samples, values
    before = first % width
    after = -(before + values.size) % width
    blocks = np.pad(values, (before, after), constant_values=np.nan).reshape(-1, width)
    empty = np.isnan(blocks)
    low = np.where(empty, np.inf, blocks).argmin(axis=1)
    high = np.where(empty, -np.inf, blocks).argmax(axis=1)
    within = np.sort(np.stack([low, high], axis=1), axis=1)
    rows = np.arange(len(blocks))[:, None]
    drawn = blocks[rows, within]
    places = first - before + rows * width + within
    # a column without values may begin before the signal or end behind it
    inside = np.clip(places, first, first + values.size - 1)
    return inside.ravel(), drawn.ravel()


def path(x: FloatArray, y: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:  # x, y (n,)
    """Return at most `points` points of a curve in the plane, with the extremes of both axes."""
    if x.size <= points:
        return x, y
    width = math.ceil(x.size / (points // 4))
    missing = -x.size % width
    keep = []
    for values in (x, y):
        blocks = np.pad(values, (0, missing), constant_values=np.nan).reshape(-1, width)
        empty = np.isnan(blocks)
        keep.append(np.where(empty, np.inf, blocks).argmin(axis=1))
        keep.append(np.where(empty, -np.inf, blocks).argmax(axis=1))
    places = np.sort(np.stack(keep, axis=1), axis=1) + width * np.arange(len(keep[0]))[:, None]
    order = np.unique(np.minimum(places.ravel(), x.size - 1))
    return x[order], y[order]


ORDERS = (1, 2, 3, 4, 5, 7, 9)
LONGEST = 1 << 15
SHORTEST = 32


@dataclass(frozen=True)
class Spectrum:
    """Lines of a spectrum and the harmonics of the drive."""

    frequency: FloatArray  # frequency [Hz], shape (n,)
    amplitude: FloatArray  # amplitude [m] of each line, shape (n,)
    orders: tuple[int, ...] = ()  # harmonic orders below half the sampling rate
    harmonics: FloatArray = field(default_factory=lambda: np.empty(0))  # [m]


def unbroken_end(signal: FloatArray) -> FloatArray:
    """Return the end of `signal` after the last missing sample."""
    missing = np.flatnonzero(np.isnan(signal))
    if missing.size and missing[-1] == signal.size - 1:
        # the reference of the last tick may not have arrived
        return unbroken_end(signal[:-1]) if signal.size > 1 else signal[:0]
    return signal[missing[-1] + 1 :] if missing.size else signal


def live_spectrum(
    signal: FloatArray, dt: float, fundamental: float, orders: tuple[int, ...] = ORDERS
) -> Spectrum | None:  # signal [m] (n,); dt [s]; fundamental [Hz]
    """Return the spectrum of the last whole periods of `signal`, None if it is too short."""
    end = unbroken_end(signal)[-LONGEST:]
    end = end[end.size - whole_periods(end.size, fundamental, dt) :]
    if end.size < SHORTEST:
        return None
    frequency, amplitude = amplitude_spectrum(end, dt)
    inside = tuple(k for k in orders if 0 < k * fundamental < 0.5 / dt)
    return Spectrum(frequency, amplitude, inside, _projected(end, dt, fundamental, inside))


def whole_periods(n: int, frequency: float, dt: float) -> int:
    """Return the number of samples in whole periods among `n`; all if there is no whole period."""
    periods = math.floor(n * frequency * dt + 1e-9)
    return min(n, round(periods / (frequency * dt))) if periods > 0 else n


def _projected(
    signal: FloatArray, dt: float, fundamental: float, orders: tuple[int, ...]
) -> FloatArray:
    """Return the amplitude at each order by projection on its phasor.

    A period need not be a whole number of samples. From two periods on, a Hann window separates
    the orders, because its zeros are at the other orders. A single period has no window.
    """
    turn = fundamental * dt * np.arange(signal.size)
    window = np.ones(signal.size)
    if turn[-1] > 1.5:
        window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(signal.size) / signal.size)
    window /= window.sum()
    centred = window * (signal - np.sum(window * signal))
    return np.array([2 * abs(np.sum(centred * np.exp(-2j * np.pi * k * turn))) for k in orders])


SECONDS = 120.0
BAND = 2.0  # standard deviations


class GapPlot:
    """The gap in multiples of the noise floor over the last minutes."""

    def __init__(self) -> None:
        self._y = Follower(logarithmic=True, floor=0.1)
        self.figure = live_axes(
            'Gap between model and measurement', 'seconds before now', 'noise floors',
            Range1d(-SECONDS, 1.0), self._y.range, y_axis_type='log',
        )  # fmt: skip
        self.figure.name = 'gap'
        self.figure.yaxis.ticker.mantissas = [1]  # only powers of ten; others would overlap
        self._source = ColumnDataSource(
            {'x': [], 'y': [], 'colour': [], 'marker': []}, name='gap.floors'
        )
        self.figure.line('x', 'y', source=self._source, color=GREY)
        self.figure.scatter('x', 'y', source=self._source, color='colour', marker='marker', size=6)
        line = {'line_dash': 'dotted', 'line_color': '#000000', 'line_width': 1.5}
        self.figure.add_layout(Span(location=1.0, dimension='width', **line))
        self.figure.add_layout(
            Label(x=6, x_units='screen', y=1.0, text='noise floor', text_font_size='11px',
                  y_offset=2)
        )  # fmt: skip

    def show(self, gaps: Sequence[Gap], now: float) -> None:
        """Draw the received values."""
        recent = [gap for gap in gaps if now - gap.at < SECONDS]
        self._source.data = {
            'x': [gap.at - now for gap in recent],
            'y': [max(gap.floors, 1e-3) for gap in recent],
            'colour': [PALETTE[1 if gap.beyond else 0] for gap in recent],
            'marker': ['square' if gap.beyond else 'circle' for gap in recent],
        }
        sizes = [1.0, *(gap.floors for gap in recent if math.isfinite(gap.floors))]
        self._y.fit(min(0.5, *sizes), max(3.0, *sizes))


class EstimatePlot:
    """One estimated parameter with its band over the last minutes."""

    def __init__(self) -> None:
        self.parameter = ''
        self._y = Follower(floor=1e-9)
        self.figure = live_axes(
            'Parameter estimate', 'seconds before now', 'value', Range1d(-SECONDS, 1.0),
            self._y.range,
        )  # fmt: skip
        self.figure.name = 'estimate'
        self._source = ColumnDataSource(
            {'x': [], 'y': [], 'low': [], 'high': []}, name='estimate.values'
        )
        self.figure.varea(
            'x', 'low', 'high', source=self._source, fill_color=PALETTE[0], fill_alpha=0.2
        )
        self.figure.line('x', 'y', source=self._source, color=PALETTE[0], line_width=1.8)

    def show(self, estimates: Sequence[ShownEstimate], now: float) -> None:
        """Draw the received values of the selected parameter."""
        name = self.parameter
        recent = [e for e in estimates if now - e.at < SECONDS and name in e.names]
        if not recent:
            self._source.data = {'x': [], 'y': [], 'low': [], 'high': []}
            return
        unit, factor = shown(recent[-1].units[recent[-1].names.index(name)])
        places = [e.names.index(name) for e in recent]
        value = factor * np.array([e.values[k] for e, k in zip(recent, places, strict=True)])
        spread = BAND * abs(factor) * np.nan_to_num(
            [e.deviations[k] for e, k in zip(recent, places, strict=True)], posinf=0.0
        )  # fmt: skip
        self._source.data = {
            'x': [e.at - now for e in recent],
            'y': value,
            'low': value - spread,
            'high': value + spread,
        }
        self.figure.yaxis.axis_label = f'{name} [{unit}]' if unit else name
        tail = slice(-max(3, len(recent) // 2), None)  # the range excludes the initial transient
        low, high = float(np.min((value - spread)[tail])), float(np.max((value + spread)[tail]))
        self._y.fit(low, max(high, low + 1e-3 * abs(low)))


LOOP_POINTS = 1600
LOOP_SECONDS = 2.0
SPECTRUM_SECONDS = 4.0
SMALLEST = 1e-13  # drawn on logarithmic axes instead of zero [m]


@dataclass(frozen=True)
class PageState:
    """Common data of all plots at one instant."""

    window: Window  # the last samples, longer than any plot needs
    seconds: float  # time span of the traces [s]
    fundamental: float  # frequencies [Hz]
    resonance: float  # 0 if there is none


def _ends(*signals: FloatArray) -> tuple[float, float]:
    known = [s[np.isfinite(s)] for s in signals]
    known = [s for s in known if s.size]
    if not known:
        return np.nan, np.nan
    return min(float(s.min()) for s in known), max(float(s.max()) for s in known)


class LoopPlot:
    """Displacement over voltage or reference; the last period is drawn on top of earlier ones."""

    def __init__(self) -> None:
        self.input = 'voltage'
        self._x, self._y = Follower(), Follower()
        self.figure = live_axes(
            'Hysteresis loop', 'voltage [V]', 'displacement [µm]', self._x.range, self._y.range
        )
        self.figure.name = 'loop'
        self._before = ColumnDataSource({'x': [], 'y': []}, name='loop.before')
        self._last = ColumnDataSource({'x': [], 'y': []}, name='loop.last')
        before = self.figure.line('x', 'y', source=self._before, color=GREY, line_width=3.0)
        last = self.figure.line('x', 'y', source=self._last, color=PALETTE[0], line_width=1.8)
        add_legend(self.figure, [('last period', [last]), ('before', [before])])

    def show(self, scene: PageState) -> None:
        """Draw the end of the window."""
        seconds = LOOP_SECONDS
        if scene.fundamental > 0.0:
            seconds = max(2.0 / scene.fundamental, 0.1)
        window = scene.window.last(min(seconds, 10.0))
        x, label = window.voltage, 'voltage [V]'
        if self.input == 'reference':
            x, label = MICRO * window.reference, 'reference [µm]'
        self.figure.xaxis.axis_label = label
        y = MICRO * window.displacement
        count = len(window) // 2 + 1 if scene.fundamental > 0.0 else len(window)
        for source, part in (
            (self._before, slice(0, len(window) - count + 1)),
            (self._last, slice(len(window) - count, None)),
        ):
            across, up = path(x[part], y[part], LOOP_POINTS)
            source.data = {'x': across, 'y': up}
        self._x.fit(*_ends(x))
        self._y.fit(*_ends(y))


class TracePlot:
    """Signals over the last seconds, with the extremes of every pixel column."""

    def __init__(
        self,
        title: str,
        y_label: str,
        lines: Sequence[tuple[str, str, str, float]],
        factor: float,
        time: Range1d,
        name: str,
    ) -> None:
        self._factor, self._y = factor, Follower(floor=1e-4)
        self.figure = live_axes(title, 'seconds before now', y_label, time, self._y.range)
        self.figure.name = name
        self._sources: dict[str, ColumnDataSource] = {}
        items = []
        for signal, label, colour, width in lines:
            source = ColumnDataSource({'x': [], 'y': []}, name=f'{name}.{signal}')
            self._sources[signal] = source
            drawn = self.figure.line(
                'x', 'y', source=source, color=colour, line_width=width, line_join='bevel'
            )
            items.append((label, [drawn]))
        if len(items) > 1:
            add_legend(self.figure, items)

    def show(self, scene: PageState) -> None:
        """Draw the end of the window."""
        window = scene.window.last(scene.seconds)
        pixels = columns_of(self.figure)
        ends = []
        for signal, source in self._sources.items():
            values = self._factor * np.asarray(getattr(window, signal))
            samples, drawn = columns(window.first, values, pixels)
            source.data = {'x': (samples - window.newest) * window.dt, 'y': drawn}
            ends.append(drawn)
        self._y.fit(*_ends(*ends))


class SpectrumPlot:
    """Amplitude spectrum with the harmonics of the drive and the resonance marked."""

    def __init__(self) -> None:
        self.signal = 'displacement'
        self._x, self._y = Range1d(0.0, 100.0), Follower(logarithmic=True, floor=1e-5)
        self.figure = live_axes(
            'Spectrum', 'frequency [Hz]', 'amplitude [µm]', self._x, self._y.range,
            y_axis_type='log',
        )  # fmt: skip
        self.figure.name = 'spectrum'
        self._line = ColumnDataSource({'x': [], 'y': []}, name='spectrum.line')
        self._marks = ColumnDataSource({'x': [], 'words': [], 'top': [], 'colour': []})
        self._peaks = ColumnDataSource(
            {'x': [], 'y': [], 'order': [], 'share': []}, name='spectrum.harmonics'
        )
        self.figure.vspan(
            x='x', source=self._marks, line_color='colour', line_dash='dotted', level='underlay'
        )
        self.figure.text(
            'x', 'top', text='words', source=self._marks, text_color='colour',
            text_font_size='11px', x_offset=2, y_offset=13,
        )  # fmt: skip
        self.figure.line('x', 'y', source=self._line, color=GREY, line_width=1.2)
        peaks = self.figure.scatter('x', 'y', source=self._peaks, color=PALETTE[1], size=8)
        tips = [('order', '@order'), ('at', '@x{0.0} Hz'), ('amplitude', '@y{0.0000} µm'),
                 ('of the first', '@share{0.00} %')]  # fmt: skip
        self.figure.add_tools(HoverTool(renderers=[peaks], tooltips=tips))

    def show(self, scene: PageState) -> None:
        """Draw the spectrum of the end of the window."""
        window = scene.window.last(SPECTRUM_SECONDS)
        spectrum = live_spectrum(getattr(window, self.signal), window.dt, scene.fundamental)
        if spectrum is None:
            self._line.data = {'x': [], 'y': []}
            return
        end = self._end(window, scene)
        inside = spectrum.frequency <= end
        y = MICRO * np.maximum(spectrum.amplitude[inside], SMALLEST)
        places, drawn = columns(0, np.log(y), columns_of(self.figure))
        self._line.data = {'x': spectrum.frequency[inside][places], 'y': np.exp(drawn)}
        peaks = MICRO * np.maximum(spectrum.harmonics, SMALLEST)
        high = max(float(y.max()), float(peaks.max(initial=0.0)))
        # the lowest lines are random: the tenth percentile shows the noise level
        self._y.fit(float(np.percentile(y, 10)), high * 3)
        self._mark(scene, spectrum.orders, peaks, end)

    def _end(self, window: Window, scene: PageState) -> float:
        half = 0.5 / window.dt
        reach = max(10.0 * scene.fundamental, 1.3 * scene.resonance) or 100.0
        end = min(half, reach)
        if self._x.reset_end != end:
            self._x.update(start=0.0, end=end, reset_start=0.0, reset_end=end)
        return end

    def _mark(
        self, scene: PageState, orders: Sequence[int], peaks: FloatArray, end: float
    ) -> None:
        shown = [k for k, order in enumerate(orders) if order * scene.fundamental <= end]
        places = [orders[k] * scene.fundamental for k in shown]
        first = peaks[0] if len(peaks) else 1.0
        self._peaks.data = {
            'x': places,
            'y': [float(peaks[k]) for k in shown],
            'order': [f'{orders[k]}×' for k in shown],
            'share': [100.0 * float(peaks[k] / first) for k in shown],
        }
        labels = [f'{orders[k]}×' for k in shown]
        colours = ['#57606a'] * len(shown)
        if 0.0 < scene.resonance <= end:
            places, labels = [*places, scene.resonance], [*labels, '']
            colours.append(PALETTE[3])
        top = [float(self._y.range.end)] * len(places)
        marks = {'x': places, 'words': labels, 'top': top, 'colour': colours}
        if marks != dict(self._marks.data):
            self._marks.data = marks


def error_rms(window: Window, fundamental: float) -> tuple[float, float]:
    """Return rms of the tracking error [m] over the last whole periods, and of the reference."""
    end = window.last(max(1.0, 1.0 / fundamental if fundamental > 0.0 else 1.0))
    n = whole_periods(len(end), fundamental, end.dt)
    error, reference = end.error[-n:], end.reference[-n:]
    known = np.isfinite(error)
    if not known.any():
        return np.nan, np.nan
    return (
        float(np.sqrt(np.mean(error[known] ** 2))),
        float(np.std(reference[np.isfinite(reference)])),
    )


def new_traces() -> tuple[Any, list[TracePlot]]:
    """Return the time axis and the traces on it."""
    time = Range1d(-2.0, 0.0)
    followed = (
        ('reference', 'reference', GREY, 4.0),
        ('displacement', 'measured', PALETTE[0], 1.5),
    )
    return time, [
        TracePlot('Displacement', 'displacement [µm]', followed, MICRO, time, 'trace'),
        TracePlot(
            'Tracking error', 'measured minus reference [µm]',
            (('error', 'error', PALETTE[1], 1.3),), MICRO, time, 'error',
        ),
        TracePlot(
            'Voltage', 'voltage [V]', (('voltage', 'voltage', PALETTE[2], 1.5),), 1.0, time,
            'voltage',
        ),
    ]  # fmt: skip
