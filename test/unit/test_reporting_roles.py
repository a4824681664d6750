"""One colour per run, elements on one line, spikes that are seen, axes that can be read."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bokeh.models import GlyphRenderer, Legend

from piezo_hysteresis.reporting.folding import Value, folded, weights_figures
from piezo_hysteresis.reporting.page import Plot
from piezo_hysteresis.reporting.plots import (
    GREY,
    PALETTE,
    ROLES,
    Curve,
    band_figure,
    bars_before_after,
    loop_figure,
    spectrum_figure,
    trace_figure,
    xy_figure,
)
from piezo_hysteresis.reporting.signals import envelope, stands_out

TIME = np.arange(400.0) * 1e-3
WAVE = 1e-6 * np.sin(2 * np.pi * 5 * TIME)


def glyphs(plot: Plot) -> list[Any]:
    return [each.glyph for each in plot.figure.renderers if isinstance(each, GlyphRenderer)]


def test_a_run_has_one_colour_in_every_plot() -> None:
    def drawn(curves: list[tuple[str, str]]) -> list[Any]:
        return [Curve(name, TIME, WAVE, role) for name, role in curves]

    two = [('feedforward', 'feedforward'), ('both', 'attenuated')]
    many = [('reference', ''), ('none', 'uncompensated'), *two]
    traces = [glyph.line_color for glyph in glyphs(trace_figure(drawn(many), 't', 'c'))]
    loops = [glyph.line_color for glyph in glyphs(loop_figure(drawn(many), 't', 'c'))]
    errors = [glyph.line_color for glyph in glyphs(trace_figure(drawn(two), 't', 'c'))]
    spectra = spectrum_figure(
        [(n, WAVE) for n, _ in two], 1e-3, 't', 'c', roles=[r for _, r in two]
    )
    assert traces == loops == [GREY, *(ROLES[role] for _, role in many[1:])]
    assert errors == traces[2:] == [glyph.line_color for glyph in glyphs(spectra)]
    assert len(set(traces)) == 4


def test_before_and_after_look_alike_as_bars_and_lines() -> None:
    plot = bars_before_after(['a'], [1e-6], [1e-7], None).figure
    bars = [each.glyph.fill_color for each in plot.renderers if each.name == 'bars']
    lines = [
        glyph.line_color
        for glyph in glyphs(
            trace_figure([Curve(r, TIME, WAVE, r) for r in ('before', 'after')], 't', 'c')
        )
    ]
    assert bars == lines == [ROLES['before'], ROLES['after']]


def test_what_lies_on_another_is_broken() -> None:
    curves = [Curve('measured', TIME, WAVE), Curve('model', TIME, WAVE, 'model')]
    below, above = glyphs(loop_figure(curves, 't', 'c'))
    assert list(below.line_dash) == []
    assert list(above.line_dash) == [7, 4]
    assert below.line_width > above.line_width
    assert below.line_color == GREY
    assert above.line_color in PALETTE


@pytest.mark.parametrize(('span', 'many'), [(5.0, True), (1e5, False)])
def test_an_axis_of_few_decades_has_more_than_powers_of_ten(span: float, many: bool) -> None:
    curve = Curve('a', np.arange(2.0), 1e-6 * np.array([1.0, span]))
    plot = xy_figure([curve], 't', 'c', 'x', 'y', log_y=True)
    ticks = getattr(plot.figure.yaxis[0].ticker, 'ticks', [])
    assert ({1.0, 2.0, 5.0} <= set(ticks)) == many


def test_elements_of_one_kind_stand_on_one_line() -> None:
    elements = [Value(f'fine{k}', 1e-6 * k, 1e-7, 'm/V') for k in range(1, 40)]
    others = [Value('A1', 4e-5, 2e-6, 'm/V'), Value('gamma', 0.25, None, '1/V')]
    lines = folded([*others, *elements])
    assert [name for name, _, _ in lines] == ['A1', 'gamma', 'fine1 .. 39']
    assert lines[0][1:] == ('40 ± 2', 'µm/V')
    assert '39 values, the largest fine39, sum 780, 1 .. 39' in lines[2][1]
    assert lines[2][2] == 'µm/V'
    (plot,) = weights_figures([*others, *elements])
    bar = next(each for each in plot.figure.renderers if hasattr(each.glyph, 'top'))
    assert list(bar.data_source.data['y']) == pytest.approx(list(range(1, 40)))


def test_few_elements_are_listed() -> None:
    few = [Value(f'c{k}', 1.0 * k, None, '1') for k in (1, 2, 3)]
    assert [name for name, _, _ in folded(few)] == ['c1', 'c2', 'c3']
    assert weights_figures(few) == ()


def test_a_spike_outside_of_what_is_drawn_is_noticed() -> None:
    error = 1e-7 * np.sin(np.arange(3000.0))
    assert not stands_out(error, error[-100:])
    error[500] = 3e-5
    assert stands_out(error, error[-100:])
    assert not stands_out(error, error)


def test_an_envelope_has_the_extremes_of_every_interval() -> None:
    y = np.array([0.0, 3.0, 1.0, -2.0, np.nan, 5.0, 4.0])
    starts, low, high = envelope(np.arange(7.0), y, 3)
    assert list(starts) == [0.0, 2.0, 5.0, 6.0]
    assert list(low) == [0.0, -2.0, 4.0, 4.0]
    assert list(high) == [3.0, 1.0, 5.0, 5.0]


def test_errors_of_many_periods_are_bands_of_one_period_each() -> None:
    time = np.arange(4000.0) * 1e-3
    curve = Curve('error', time, 1e-6 * np.sin(2 * np.pi * 10 * time), 'before')
    plot = band_figure([curve], 't', 'Error.', 'error', 10.0)
    (band,) = plot.figure.renderers
    assert len(band.data_source.data['x']) == 40
    assert band.data_source.data['high'] == pytest.approx(np.ones(40), abs=1e-2)
    assert plot.caption == 'Error. Band: smallest to largest value of each period.'
    few = band_figure([curve], 't', 'Error.', 'error', 1.0)
    assert 'Band' not in few.caption


def test_the_noise_floor_is_in_the_legend_and_covers_no_bar() -> None:
    plot = bars_before_after(['a'], [1e-6], [1e-7], 2e-8).figure
    (legend,) = plot.select(Legend)
    assert 'noise floor, 0.02 µm' in [item.label.value for item in legend.items]
