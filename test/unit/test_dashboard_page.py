"""The live page without ROS and without a browser: words and pages."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick
from dashboard_fakes import Backend, filled, live_at

from piezo_hysteresis.dashboard import pictures as page_module
from piezo_hysteresis.dashboard.live_plots import Follower
from piezo_hysteresis.dashboard.live_state import (
    BackgroundJob,
    Gap,
    LogLine,
    NodeState,
    ShownEstimate,
    State,
)
from piezo_hysteresis.dashboard.pictures import Page
from piezo_hysteresis.dashboard.texts import (
    banner,
    estimate_text,
    gap_text,
    job_text,
    status_text,
    tracking_text,
)

# --- words ------------------------------------------------------------------------------------


def test_the_banner_distinguishes_absence_silence_and_loss() -> None:
    time = [100.0]
    live = live_at(time)
    assert 'no node publishes /stage/actuator/state' in banner(live)
    live.published = True
    assert 'Waiting for the first sample' in banner(live)
    live.note('state')
    assert banner(live) == ''
    time[0] += 7.0
    assert 'Stale' in banner(live)
    assert '7 s' in banner(live)
    live.note('state')
    live.nodes['gap_monitor'] = NodeState('gap_monitor', False, 105.0)
    assert 'gap_monitor (for 2 s)' in banner(live)
    live.nodes['gap_monitor'] = NodeState('gap_monitor', True, 107.0)
    assert banner(live) == ''


def test_what_comes_from_outside_is_escaped() -> None:
    evil = '<script>alert(1)</script>'
    live = live_at([0.0])
    live.nodes['n'] = NodeState('n', True, 0.0)
    live.diagnostics['n'] = LogLine(0.0, 'n', 'error', evil)
    live.words.append(LogLine(0.0, evil, 'error', evil))
    gap = Gap(0.0, 1.0, 1.0, 9.0, 1.0, (1,), (1.0,), True, evil)
    estimate = ShownEstimate(0.0, evil, evil, evil, (evil,), (evil,), (1.0,), (0.1,), 0, 0, True)
    texts = [
        status_text(live), gap_text([gap], True), estimate_text([estimate], True),
        job_text(BackgroundJob('failed', 0.0, evil)),
        job_text(BackgroundJob('done', 1.0, evil, ((evil, 1.0),), 2.0, 1.0, f'{evil}"onclick=x')),
    ]  # fmt: skip
    for text in texts:
        assert '<script' not in text
        assert '"onclick' not in text


def test_values_are_shown_in_micrometres_and_floors() -> None:
    assert '1.5 µm' in tracking_text(1.5e-6, 50e-6)
    assert '3 %' in tracking_text(1.5e-6, 50e-6)
    assert 'No reference' in tracking_text(math.nan, 1.0)
    gap = Gap(0.0, 2e-6, 2e-8, 100.0, 5.0, (1, 3), (1e-7, 1.9e-6), True, 'resonance')
    words = gap_text([gap], True)
    assert '100 noise floors' in words
    assert 'resonance' in words
    assert 'at 3×' in words
    assert 'No gap monitor' in gap_text([], False)
    mean = Gap(0.0, 4.1e-6, 2e-8, 205.0, 23.0, (0, 1), (4e-6, 1e-7), True, 'drift or an offset')
    words = gap_text([mean], True, stroke=200e-6, untracked=0.05e-6)
    assert '4.1 µm rms' in words
    assert '2 % of the motion' in words
    assert 'largest component in the mean' in words
    assert 'tracking is not affected' in words
    assert 'affected' not in gap_text([mean], True, stroke=200e-6, untracked=3e-6)
    known = dataclasses.replace(mean, beyond=False)
    assert 'within the known discrepancy of the model' in gap_text([known], True)
    estimate = ShownEstimate(
        0.0, 'classical', 'rls', '', ('A', 'f'), ('m/V', 'Hz'), (1.2e-4, 68.0), (1e-7, 0.0),
        1e-8, math.nan, True,
    )  # fmt: skip
    table = estimate_text([estimate], True)
    assert '<td>120</td>' in table
    assert '± 0.1' in table
    assert 'held' in table


# --- axes and pages ---------------------------------------------------------------------------


def test_an_axis_is_calm_and_leaves_a_zoom_alone() -> None:
    follower = Follower()
    follower.fit(-1.0, 1.0)
    first = (follower.range.start, follower.range.end)
    assert first[0] < -1.0
    assert first[1] > 1.0
    follower.fit(-0.9, 0.95)
    assert (follower.range.start, follower.range.end) == first
    follower.fit(-3.0, 1.0)
    assert follower.range.start < -3.0
    follower.fit(-0.1, 0.1)
    assert follower.range.start > -0.2
    follower.range.update(start=0.0, end=0.05)  # a person
    follower.fit(-5.0, 5.0)
    assert (follower.range.start, follower.range.end) == (0.0, 0.05)
    follower.range.update(start=follower.range.reset_start, end=follower.range.reset_end)
    follower.fit(-5.0, 5.0)
    assert follower.range.end > 5.0
    follower.fit(math.nan, 1.0)
    assert follower.range.end > 5.0


@pytest.mark.component
def test_a_page_shows_what_is_known() -> None:
    backend = Backend()
    filled(backend)
    document = Document()
    Page(document, backend, 'stage')
    by_name = document.get_model_by_name
    loop = by_name('loop.last').data
    assert np.max(loop['x']) == pytest.approx(1.0, abs=1e-3)
    assert np.max(loop['y']) == pytest.approx(60.0, abs=0.1)  # µm
    trace = by_name('trace.displacement').data
    assert trace['x'][-1] == 0.0
    assert trace['x'][0] == pytest.approx(-2.0, abs=0.01)
    assert np.max(by_name('error.error').data['y']) == pytest.approx(10.0, abs=0.1)
    harmonics = by_name('spectrum.harmonics').data
    assert harmonics['order'][0] == '1×'
    assert harmonics['y'][0] == pytest.approx(60.0, abs=0.1)
    assert '7.07 µm' in by_name('tracking').text
    assert by_name('excitation.voltage.amplitude.slider').value == 1.0
    by_name('simulator.effects.creep.switch').active = True
    assert backend.sent[-1][:3] == ('simulator', 'effects.creep', True)


def test_a_sweep_is_sent_and_mistakes_are_reported() -> None:
    backend = Backend()
    filled(backend)
    document = Document()
    page = Page(document, backend, 'stage')
    by_name = document.get_model_by_name

    def start(**values: str) -> Any:
        for name, value in values.items():
            by_name(f'sweep.{name}').value = value
        document.callbacks.trigger_event(ButtonClick(by_name('sweep.start')))
        return by_name('sweep.words').text

    assert 'no list of numbers' in start(frequencies='fast')
    assert 'no name of a bag' in start(frequencies='1, 2', name='../outside')
    assert backend.orders == []
    start(name='mine')
    assert backend.orders[0].frequencies == (1.0, 2.0)
    backend.live('stage').sweep = BackgroundJob('running', 0.42, '1 Hz at 1 V')
    page.refresh()
    assert by_name('sweep.bar').value == 42
    assert by_name('sweep.start').disabled
    assert not by_name('sweep.cancel').disabled


@pytest.mark.component
def test_several_readers_have_pages_of_their_own() -> None:
    backend = Backend()
    filled(backend)
    documents = [Document(), Document()]
    pages = [Page(document, backend, 'stage') for document in documents]
    documents[0].get_model_by_name('hold').active = True
    backend.live('stage').signals.add_states([State(5000, 5_000_000_000, 9.0, 0.0)])
    for page in pages:
        page.refresh()
        page.refresh()
    newest = [d.get_model_by_name('voltage.voltage').data['y'][-1] for d in documents]
    assert newest[0] < 2.0  # held
    assert newest[1] == 9.0


def test_a_browser_gets_no_more_pictures_than_it_draws() -> None:
    backend = Backend()
    live = filled(backend)
    document = Document()
    page = Page(document, backend, 'stage')

    def newest(volt: float) -> Any:
        k = live.signals.newest + 1
        live.signals.add_states([State(k, k * 1_000_000, volt, 0.0)])
        page.refresh()
        return document.get_model_by_name('voltage.voltage').data['y'][-1]

    assert newest(7.0) == 7.0
    assert newest(8.0) == 7.0  # the one before has not been drawn
    document.get_model_by_name('seen').tags = document.get_model_by_name('pulse').tags
    assert newest(9.0) == 9.0


def test_a_page_goes_over_to_an_actuator_that_appears(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_module, 'SLOWLY', 0.0)
    backend = Backend(names=())
    document, chosen = Document(), Document()
    page = Page(document, backend, '')
    other = Page(chosen, backend, 'stage_y', chosen=True)
    backend.names = ['stage_x']
    for each in (page, other):
        each.refresh()
    assert document.get_model_by_name('actuator').value == 'stage_x'
    assert chosen.get_model_by_name('actuator').value == 'stage_y'
    assert chosen.get_model_by_name('actuator').options == ['stage_x', 'stage_y']
