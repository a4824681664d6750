"""The report: self-contained, honest about what it was given, whole or not at all."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.reporting.display_units import micrometres, shown, with_deviation
from piezo_hysteresis.reporting.folding import Value, folded
from piezo_hysteresis.reporting.page import PageSection, Plot, Table, render, table, write_report
from piezo_hysteresis.reporting.plots import (
    PALETTE,
    Curve,
    bars_before_after,
    loop_figure,
    response_figure,
    spectrum_figure,
    trace_figure,
    xy_figure,
)
from piezo_hysteresis.reporting.signals import amplitude_spectrum, last_periods, thinned

TIME = np.arange(2000.0) * 1e-3
SINE = 5e-5 * np.sin(2 * np.pi * 7 * TIME)


class Page(HTMLParser):
    """Collects what a browser would fetch, the text it shows and the tags it opens."""

    FETCHING = frozenset({'src', 'href', 'srcset', 'poster', 'action', 'data', 'background'})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: Any, attrs: Any) -> None:
        self.tags.append(tag)
        if tag not in ('meta', 'link', 'img', 'br'):
            self.open.append(tag)
        self.fetched += [value for name, value in attrs if name in self.FETCHING]

    def handle_endtag(self, tag: Any) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: Any) -> None:
        if self.open and self.open[-1] not in ('script', 'style'):
            self.words.append(data)

    @property
    def text(self) -> str:
        return ' '.join(' '.join(self.words).split())


def every_figure() -> tuple[Plot, Plot, Plot, Plot, Plot]:
    return (
        loop_figure([Curve('measured', SINE, SINE), Curve('model', SINE, SINE)], 'loop', 'a', 'V'),
        trace_figure([Curve('error', TIME, SINE)], 'trace', 'b'),
        spectrum_figure([('x', SINE)], 1e-3, 's', 'c', fundamental=7.0, marks={'mode': 68.0}),
        bars_before_after([1.0, 23.0], [1e-6, 4e-5], [2e-8, 3e-8], 2e-8, caption='d'),
        xy_figure([Curve('e', np.array([1.0, 9.0]), np.array([1e-6, 2e-6]))], 't', 'e', 'x', 'y',
                  log_y=True, floor=2e-8),
    )  # fmt: skip


def test_a_page_fetches_nothing_and_is_well_formed() -> None:
    text = render('Title', 'It works.', [PageSection('One', 'Some text.', every_figure())])
    page = Page(text)
    assert page.fetched == []
    assert page.open == []
    assert '@import' not in text
    assert 'url(http' not in text
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy
    assert "default-src 'none'" in policy.group(1)
    assert 'http' not in policy.group(1)


@pytest.mark.component
def test_the_verdict_comes_before_every_section_and_every_plot_has_its_place() -> None:
    sections = [PageSection('First part', '', every_figure()), PageSection('Second part', 'End.')]
    text = render('Title', 'The verdict.', sections)
    shown_text = Page(text).text
    places = [shown_text.index(w) for w in ('The verdict.', 'First part', 'Second part')]
    assert places == sorted(places)
    roots = re.findall(r'data-root-id="([^"]+)"', text)
    assert len(roots) == len(set(roots)) == len(every_figure())
    assert text.count('<figcaption>') == len(every_figure())


def test_a_page_without_plots_carries_no_library() -> None:
    text = render('Title', 'Fine.', [PageSection('One', 'Words.', (), (table(['a'], [[1]]),))])
    assert len(text) < 20_000


def test_words_of_a_user_stay_words() -> None:
    name = '<script>alert(1)</script>&"'
    rows = table([name], [[name]], name)
    figure = trace_figure([Curve('</script><b>', TIME, SINE)], name, name)
    text = render(name, name, [PageSection(name, f'{name}\n\n- {name}', (figure,), (rows,))])
    page = Page(text)
    assert page.open == []
    assert 'b' not in page.tags
    assert page.text.count('alert(1)') >= 6


def test_prose_has_paragraphs_lists_and_typed_words() -> None:
    text = render('t', 'v', [PageSection('s', 'One `word`.\n\n- a\n- b\n\nTwo\nlines.')])
    assert '<p>One <code>word</code>.</p>' in text
    assert '<ul><li>a</li><li>b</li></ul>' in text
    assert '<p>Two lines.</p>' in text


def test_tables_mark_unknown_values_and_refuse_ragged_rows() -> None:
    rows = table(['a', 'b', 'c'], [[1.23456789, None, True], [float('nan'), 'x', 3]]).rows
    assert rows == (('1.235', '–', 'yes'), ('–', 'x', '3'))
    with pytest.raises(ValueError, match='1 cells under 2 headers'):
        Table(('a', 'b'), (('x',),))


def test_a_report_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / 'deep' / 'report.html'
    write_report(target, 't', 'v', [PageSection('s')])
    assert target.read_text(encoding='utf-8').startswith('<!DOCTYPE html>')
    assert [p.name for p in target.parent.iterdir()] == ['report.html']
    blocked = tmp_path / 'file'
    blocked.write_text('x')
    with pytest.raises(PiezoError, match='name another folder'):
        write_report(blocked / 'report.html', 't', 'v', [])


def axis_labels(plot: Plot) -> Any:
    return plot.figure.xaxis[0].axis_label, plot.figure.yaxis[0].axis_label


def test_axes_carry_units_and_displacements_are_drawn_in_micrometres() -> None:
    loop, trace, spectrum, bars, _ = every_figure()
    assert axis_labels(loop) == ('voltage [V]', 'displacement [µm]')
    assert axis_labels(trace) == ('time [s]', 'displacement [µm]')
    assert axis_labels(spectrum) == ('frequency [Hz]', 'amplitude [µm]')
    assert axis_labels(bars)[1] == 'rms error [µm]'
    data = trace.figure.renderers[0].data_source.data
    np.testing.assert_allclose(np.max(data['y']), 50.0, rtol=1e-3)
    for plot in every_figure():
        assert plot.figure.sizing_mode == 'stretch_width'


@pytest.mark.parametrize(('name', 'level'), [('7 Hz', True), ('reversal curves', False)])
def test_labels_of_bars_turn_where_they_would_overlap(name: str, level: bool) -> None:
    names = [f'{name} {k}' for k in range(5)]
    plot = bars_before_after(names, [1e-6] * 5, [1e-7] * 5, None).figure
    assert (plot.xaxis[0].major_label_orientation == 'horizontal') == level


def test_bars_show_the_pairs_they_were_given_and_the_floor_lies_inside() -> None:
    plot = bars_before_after([1.0, 23.0], [1e-6, 4e-5], [2e-8, float('nan')], 1e-8).figure
    tops = [list(r.data_source.data['top']) for r in plot.renderers if r.name == 'bars']
    assert tops[0] == pytest.approx([1.0, 40.0])
    assert tops[1][0] == pytest.approx(0.02)
    assert tops[1][1] == plot.y_range.start  # what is not known has no height
    assert plot.y_range.start < 0.01 < plot.y_range.end


def test_the_palette_is_distinguishable_in_grey() -> None:
    def lightness(colour: str) -> Any:
        r, g, b = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
        return 0.2126 * r**2.2 + 0.7152 * g**2.2 + 0.0722 * b**2.2

    first = [lightness(colour) for colour in PALETTE[:2]]
    assert abs(first[0] - first[1]) > 0.05
    assert len(set(PALETTE)) == len(PALETTE)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=3000),
    st.integers(min_value=4, max_value=500),
)
def test_thinning_keeps_the_extremes_in_order(values: Any, points: Any) -> None:
    y = np.array(values)
    x = np.arange(y.size, dtype=float)
    xs, ys = thinned(x, y, points)
    assert ys.size <= max(points, 4) or ys.size == y.size <= points
    assert (ys.max(), ys.min()) == (y.max(), y.min())
    assert (xs[0], xs[-1]) == (x[0], x[-1])
    assert np.all(np.diff(xs) > 0)
    np.testing.assert_array_equal(ys, y[xs.astype(int)])


def test_a_single_spike_survives_thinning() -> None:
    y = np.zeros(1_000_000)
    y[123_456] = 1.0
    xs, ys = thinned(np.arange(y.size, dtype=float), y)
    assert xs[np.argmax(ys)] == 123_456


def test_a_path_at_one_voltage_is_thinned() -> None:
    y = np.concatenate([np.linspace(0.0, 1.0, 9000), np.ones(9000)])
    xs, ys = thinned(np.full(y.size, 100.0), y)
    assert np.all(xs == 100.0)
    assert np.isclose(np.ptp(ys), 1.0)


@pytest.mark.parametrize('steps', [7, 90])
def test_a_thinned_staircase_keeps_its_corners(steps: int) -> None:
    x = np.repeat(np.r_[0:steps, steps:0:-1].astype(float), 500)
    y = 2e-5 * np.roll(x, 3)
    xs, ys = thinned(x, y)
    assert xs.size <= 3000
    drawn = {*zip(xs.tolist(), ys.tolist(), strict=True)}
    corners = np.flatnonzero((np.diff(x) != 0.0) | (np.diff(y) != 0.0))
    assert {*zip(x[corners].tolist(), y[corners].tolist(), strict=True)} <= drawn


def test_a_thinned_loop_keeps_the_turning_points_of_both_axes() -> None:
    phase = np.linspace(0.0, 60.0, 100_000)
    size = 1.0 - phase / 100.0
    x, y = size * np.sin(phase), size * np.sin(phase - 0.3)
    x[12345], y[67890] = 5.0, -7.0
    xs, ys = thinned(x, y, 600)
    assert xs.size <= 600
    assert ys[np.argmax(xs)] == y[12345]
    assert xs[np.argmin(ys)] == x[67890]
    for whole, part in ((x, xs), (y, ys)):
        inner = whole[1:-1]
        turns = inner[np.sign(np.diff(whole[:-1])) != np.sign(np.diff(whole[1:]))]
        assert max(float(np.min(np.abs(part - turn))) for turn in turns) < 1e-2


def test_lost_points_of_a_path_are_left_out() -> None:
    x = np.sin(np.linspace(0.0, 9.0, 10_000))
    x[100:200] = np.nan
    assert np.all(np.isfinite(thinned(x, x)[0]))


def test_a_drive_with_many_reversals_is_drawn_over_time() -> None:
    drive = np.random.default_rng(0).normal(size=2000)
    model = np.where(np.arange(2000) == 1234, 2.0, 0.0)
    responses = [('measured', 0.0 * drive, ''), ('model', model, 'model')]
    assert axis_labels(response_figure(drive, TIME, responses, 't', 'c'))[0] == 'time [s]'
    few = response_figure(SINE[:500], TIME[:500], [(n, y[:500], r) for n, y, r in responses],
                          't', 'c')  # fmt: skip
    assert axis_labels(few)[0] == 'voltage [V]'


@pytest.mark.parametrize('offset', [0.0, 1e3])
def test_a_spectrum_reads_the_amplitude_of_a_sine(offset: float) -> None:
    frequency, amplitude = amplitude_spectrum(offset + 3 * np.sin(2 * np.pi * 50 * TIME), 1e-3)
    assert frequency[np.argmax(amplitude)] == pytest.approx(50.0)
    assert amplitude.max() == pytest.approx(3.0, rel=1e-9)
    assert np.max(amplitude[frequency > 60]) < 1e-9 * max(offset, 1.0)
    assert amplitude[0] < 1e-9 * max(offset, 1.0)


def test_last_periods() -> None:
    assert last_periods(1000, 10.0, 1e-3, 2) == slice(799, 1000)
    assert last_periods(1000, 0.0, 1e-3, 2, warm_up=100) == slice(100, 1000)
    assert last_periods(1000, 10.0, 1e-3, 20, warm_up=100) == slice(100, 1000)


def test_numbers_as_people_read_them() -> None:
    assert shown('m/V') == ('µm/V', 1e6)
    assert shown('1/m^2') == ('1/µm²', 1e-12)
    assert shown('Hz') == ('Hz', 1.0)
    assert micrometres(4.32064e-5) == '43.2'
    assert micrometres(float('nan')) == micrometres(None) == '–'
    assert with_deviation(203.66, 18.0) == ('204', '18')
    assert with_deviation(67.968467, 0.0411) == ('67.968', '0.041')
    assert with_deviation(0.0, None) == ('0', 'held')
    assert with_deviation(1.0, float('inf'))[1] == 'not determined'
    unknown = Value('offset', 2e-6, float('inf'), 'm')
    assert folded([unknown]) == [('offset', 'not determined', '')]
    assert with_deviation(0.001, 5.0) == ('0.001', '5')


def test_links_lead_only_to_pages_in_the_folder() -> None:
    page = render('t', 'see [one](one/report.html), [two](http://x/y) [three](javascript:f)', [])
    assert '<a href="one/report.html">one</a>' in page
    assert page.count('<a ') == 1


def test_a_folded_section_shows_its_title_alone() -> None:
    section = PageSection('More', 'Words.', folded=True)
    text = render('Title', 'Fine.', [PageSection('One', 'Words.'), section])
    assert '<details>\n<summary><h2>More</h2></summary>' in text
    assert text.count('<details>') == text.count('</details>') == 1


def test_every_plot_of_a_page_can_be_exported() -> None:
    text = render('Title', 'Fine.', [PageSection('One', '', every_figure()[:1])])
    assert 'function csvOf(plot)' in text
    assert 'addExports();' in text
    assert '.export {' in text
