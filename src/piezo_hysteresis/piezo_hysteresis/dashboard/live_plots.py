"""Plots of the current signals: loop, traces and spectrum. Input in metres, display in µm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.dashboard.axes import Follower, columns_of, live_axes
from piezo_hysteresis.dashboard.decimate import columns, path
from piezo_hysteresis.dashboard.live_signals import Window
from piezo_hysteresis.dashboard.live_spectrum import live_spectrum, whole_periods
from piezo_hysteresis.reporting.display_units import MICRO
from piezo_hysteresis.reporting.plot_parts import GREY, PALETTE, add_legend

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
