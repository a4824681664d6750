"""Controls, forms and jobs of the live page, without a browser."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick
from dashboard_fakes import Backend, amplitude

from piezo_hysteresis.dashboard.backend import DiscoveryOrder, InvestigationOrder, SweepOrder
from piezo_hysteresis.dashboard.controls import (
    ParameterState,
    described,
    groups_of,
    reach,
    refusal_text,
)
from piezo_hysteresis.dashboard.forms import InvestigationForm, numbers, steps_text
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState, Live
from piezo_hysteresis.dashboard.panel import Controls, ParameterRow
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.dashboard import jobs


def test_a_descriptor_is_read_back() -> None:
    found = described(
        'n', 'mode', 'idle', 'What is published. One of idle, voltage.', 'one of idle, voltage'
    )
    assert (found.sentence, found.unit) == ('What is published.', '')
    assert found.choices == ('idle', 'voltage')
    found = described('n', 'a', 5e-5, 'Amplitude of it. [m]', '', (0.0, 0.01))
    assert (found.sentence, found.unit, found.high) == ('Amplitude of it.', 'm', 0.01)
    assert (found.shown_unit, found.factor) == ('µm', 1e6)
    assert described('n', 'g', 1.0, 'x. [V]', '', (0.0, 1.7e308)).high == math.inf


@pytest.mark.parametrize(
    ('value', 'unit', 'low', 'high', 'start', 'end'),
    [
        (1.0, 'V', 0.0, 500.0, 0.0, 5.0),  # cut to what is usual
        (8e-5, 'm', 0.0, 0.01, 0.0, 500.0),  # µm
        (-0.3, '1/V', -1e4, 1e4, -1.0, 1.0),
        (0.9995, '1', 0.9, 1.0, 0.9, 1.0),  # narrow ranges are shown whole
        (1.0, 'Hz', 1.0, 1e5, 1.0, 5.0),
        (400.0, 'V', 0.0, 500.0, 0.0, 500.0),
        (0.0, 'Hz', 0.0, 1e4, 0.0, 5.0),
        (7, '', 0, 999, 0.0, 50.0),
    ],
)
def test_a_slider_spans_what_is_usual(
    value: float, unit: str, low: float, high: float, start: float, end: float
) -> None:
    span = reach(ParameterState('n', 'p', value, '', unit, low, high))
    assert (span.start, span.end) == (start, end)
    assert span.end > span.start
    assert 0.0 < span.step <= 0.05 * (span.end - span.start)


def test_a_number_at_zero_learns_its_size_from_its_relatives() -> None:
    offset = ParameterState('n', 'reference.offset', 0.0, '', 'm', -0.01, 0.01)
    relative = ParameterState('n', 'reference.amplitude', 5e-5, '', 'm', 0.0, 0.01)
    span = reach(offset, [offset, relative])
    assert (span.start, span.end) == (-200.0, 200.0)


def test_parameters_are_grouped_without_read_only_ones() -> None:
    rows = [
        ParameterState('n', 'rate', 1.0, read_only=True),
        ParameterState('n', 'plant.gain', 1.0),
        ParameterState('n', 'use_sim_time', False),
        ParameterState('n', 'mode', 'idle'),
    ]
    groups = groups_of(rows)
    assert {name: [p.name for p in group] for name, group in groups.items()} == {
        '': ['mode'],
        'plant': ['plant.gain'],
    }


def test_typed_lists_keep_their_type() -> None:
    assert ParameterState('n', 'orders', [1, 3]).parse('[0, 2 5]') == [0, 2, 5]
    assert ParameterState('n', 'zeros', [1.0]).parse('1, 2.5') == [1.0, 2.5]
    assert ParameterState('n', 'orders', [1]).parse('three') == ['three']  # the node says why not
    assert ParameterState('n', 'topics', ['']).parse('a b') == ['a', 'b']


def test_typed_sweeps_are_read_or_refused() -> None:
    assert numbers('1, 2.5; 3 4', 'f') == (1.0, 2.5, 3.0, 4.0)
    for text in ('', 'one, two'):
        with pytest.raises(PiezoError, match='frequencies'):
            numbers(text, 'frequencies')


def test_a_refused_control_reverts_with_the_reason() -> None:
    backend = Backend()
    row = ParameterRow(amplitude(), lambda *a: backend.set_parameters('', a[0], {a[1]: a[2]}))
    slider, box = row.root.children[1].children
    box.value = 9000.0
    node, name, value, answer = backend.sent.pop()
    assert (node, name, value) == ('excitation', 'voltage.amplitude', 9000.0)
    row.refresh(lambda *_: amplitude())
    assert box.value == 9000.0  # nobody has answered yet
    answer.give('voltage.amplitude = 9000 V is outside 0 .. 500 V')
    row.refresh(lambda *_: amplitude())
    assert (box.value, slider.value) == (1.0, 1.0)
    reason = row.root.children[2]
    assert 'lies between 0 and 500 V' in reason.text
    assert reason.visible
    assert backend.sent == []  # going back is no wish of the reader

    slider.value = 2.0
    backend.sent.pop()[3].give()
    row.refresh(lambda *_: amplitude(2.0))
    assert (box.value, reason.visible) == (2.0, False)


def test_a_dragged_slider_sends_only_the_newest_value() -> None:
    backend = Backend()
    row = ParameterRow(amplitude(), lambda *a: backend.set_parameters('', a[0], {a[1]: a[2]}))
    slider = row.root.children[1].children[0]
    for value in (1.5, 2.0, 2.5, 3.0):
        slider.value = value
    assert [entry[2] for entry in backend.sent] == [1.5]
    backend.sent[0][3].give()
    row.refresh(lambda *_: amplitude(1.5))
    assert [entry[2] for entry in backend.sent] == [1.5, 3.0]
    assert slider.value == 3.0  # does not jump back under the finger
    backend.sent[1][3].give()
    row.refresh(lambda *_: amplitude(3.0))
    row.refresh(lambda *_: amplitude(0.7))  # somebody else sets it
    assert slider.value == 0.7
    assert len(backend.sent) == 2


def test_a_range_is_reported_in_the_unit_of_the_page() -> None:
    size = ParameterState('excitation', 'reference.amplitude', 1e-4, '', 'm', 0.0, 0.01)
    for text in (
        'Parameter reference.amplitude out of range Min: 0.0, Max: 0.01, value: 0.5',
        'reference.amplitude = 0.5 m is outside 0 .. 0.01 m',
    ):
        assert refusal_text(size, text) == 'reference.amplitude lies between 0 and 10000 µm'
    assert refusal_text(size, 'mode: a sweep is running') == 'mode: a sweep is running'


STATES = [
    InvestigationState(0, '', '', '', (('none', 0.5), ('creep', 0.1)), 0.0),
    InvestigationState(1, 'sine 33 Hz', 'has a chance', 'nothing new', (('none', 0.5),), 0.0),
    InvestigationState(2, 'step <b>', 'tells a from b', 'creep', (('creep', 0.9),), 1.6),
]


def form(orders: list[Any]) -> InvestigationForm:
    return InvestigationForm(orders.append, lambda: orders.append('cancel'), lambda: 'new')


def page_of(*roots: Any) -> Any:
    """Return how widgets are found by their names, and how a button is pressed."""
    document = Document()
    for root in roots:
        document.add_root(root)

    def press(name: str) -> None:
        document.callbacks.trigger_event(ButtonClick(document.get_model_by_name(name)))

    return document.get_model_by_name, press


def asked(orders: list[object], **values: Any) -> Any:
    """Press the button with these limits; return what the page says then."""
    by_name, press = page_of(form(orders).root)
    for name, value in values.items():
        by_name(f'investigation.{name}').value = value
    press('investigation.start')
    return by_name('investigation.words').text


def test_the_button_asks_with_limits_and_budget() -> None:
    orders: list[object] = []
    asked(orders, low=-1.0, high=2.0, slew=300.0)
    assert orders == [InvestigationOrder(-1.0, 2.0, 300.0, 200.0, 'new')]


def test_an_impossible_range_is_reported_and_not_sent() -> None:
    orders: list[object] = []
    assert 'is not below' in asked(orders, low=2.0, high=1.0)
    assert 'highest voltage is not given' in asked(orders, low=-2.0)
    assert 'lowest voltage is not given' in asked(orders, high=2.0)
    assert 'not finite' in asked(orders, low=float('nan'), high=2.0)
    assert orders == []


def test_steps_come_with_their_reason_and_what_they_answered() -> None:
    words = steps_text(STATES)
    assert words.index('step &lt;b&gt;') < words.index('sine 33 Hz')  # the newest first
    assert 'tells a from b' in words
    assert 'nothing new' in words
    assert steps_text([]) == ''


def test_beliefs_are_drawn_over_actuator_time() -> None:
    shown = form([])
    shown.refresh(BackgroundJob('running', 0.1, 'runs'), STATES, True, 0.0)
    by_name, _ = page_of(shown.root)
    figure = by_name('investigation.chances')
    assert figure.visible
    assert [item.label.value for item in figure.legend.items] == ['creep', 'none']
    drawn = figure.renderers[0].data_source.data
    assert list(drawn['x']) == [0.0, 0.0, 1.6]
    assert list(drawn['y']) == [0.1, 0.0, 0.9]


def test_the_page_holds_it_and_starts_it() -> None:
    backend = Backend()
    backend.live('stage').investigations_offered = True
    controls = Controls(backend, 'stage')
    controls.refresh()
    assert 'investigation' in [root.name for root in controls.roots]
    _, press = page_of(*controls.roots)
    press('investigation.start')
    assert isinstance(backend.orders[0], InvestigationOrder)
    assert backend.orders[0].name.startswith('investigation_')


@pytest.fixture
def live() -> Live:
    return Live('stage')


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Return the verbs that are started; none runs."""
    found: list[list[str]] = []
    monkeypatch.setattr(jobs.VerbJob, 'start', lambda job, verb, outcome: found.append(verb))
    return found


@pytest.mark.parametrize(
    ('bag', 'baseline'), [('../secret', 'classical'), ('/etc', 'classical'), ('bag', '--out=/')]
)
def test_a_foreign_page_names_no_path_and_no_option(
    bag: str, baseline: str, live: Live, started: list[Any], tmp_path: Path
) -> None:
    page: Any = None
    jobs.Jobs(page, live, tmp_path).run_discovery(DiscoveryOrder((bag,), baseline))
    assert started == []
    assert live.discovery.phase == 'failed'


def test_an_investigation_gets_the_limits_and_the_folder_of_the_page(
    live: Live, started: list[Any], tmp_path: Path
) -> None:
    page: Any = None
    one = jobs.Jobs(page, live, tmp_path)
    one.run_investigation(InvestigationOrder(-1.0, 2.0, 300.0, 60.0, 'first'))
    (verb,) = started
    assert verb[:5] == ['investigate', '--low=-1.0', '--high=2.0', '--slew=300.0', '--budget=60.0']
    assert str(tmp_path / 'investigations' / 'first') in verb
    one.run_investigation(InvestigationOrder(0.0, 0.0, 0.0, 0.0, '../../first'))
    assert (len(started), live.investigation.phase) == (1, 'failed')


def test_a_sweep_is_the_verb_call_with_the_fields_of_the_page(
    live: Live, started: list[Any], tmp_path: Path
) -> None:
    page: Any = None
    jobs.Jobs(page, live, tmp_path).run_sweep(
        SweepOrder((1.0, 5.0), (0.5,), 2.0, 1.0, 0.0, 'first')
    )
    ((verb, name, goal),) = started
    assert (verb, name) == ('call', '/stage/run_sweep')
    fields = json.loads(goal)
    assert (fields['frequencies'], fields['seconds'], fields['warm_up']) == ([1.0, 5.0], 2.0, 1.0)
    assert fields['bag'] == str(tmp_path / 'sweeps' / 'first')


@pytest.mark.component
@pytest.mark.parametrize('success', [True, False])
def test_a_sweep_shows_its_progress_and_then_its_records(
    success: bool, live: Live, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 'record: a, frequency: 5.0, amplitude: 1.0, seconds_left: 7.6, fraction: 0.25'
    answer = f"success: {str(success).lower()}\nmessage: '2 records: done'\nnames:\n- a\n- b"
    verb = tmp_path / 'verb'
    verb.write_text(
        f'#!/bin/sh\necho "{now}"\nsleep 1\necho "{answer}"\nexit {int(not success)}\n'
    )
    verb.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(verb))
    job = jobs.VerbJob(live, 'sweep')
    job.start(['call'], jobs.sweep_outcome)
    seen = set()
    end = time.monotonic() + 60.0
    while live.sweep.busy and time.monotonic() < end:
        job.watch()
        seen.add((live.sweep.fraction, live.sweep.text))
    assert (0.25, '5.0 Hz at 1.0 V, 8 s left') in seen
    assert live.sweep.phase == ('done' if success else 'failed')
    assert live.sweep.text == '2 records: done'
    assert live.sweep.records == ('a', 'b')


@pytest.mark.component
def test_a_verb_that_fails_says_why(live: Live) -> None:
    job = jobs.VerbJob(live, 'discovery')
    job.start(['discovr'], lambda _: pytest.fail('it has no outcome'))
    assert live.discovery.busy
    end = time.monotonic() + 60.0
    while live.discovery.busy and time.monotonic() < end:
        job.watch()
    assert live.discovery.phase == 'failed'
    assert live.discovery.text.startswith('there is no verb discovr')


def test_the_journal_gives_the_beliefs_before_the_first_experiment_and_after_each(
    tmp_path: Path,
) -> None:
    journal = tmp_path / 'journal.jsonl'
    assert jobs.states_of(journal) == []
    line = {
        'number': 1, 'experiment': 'sine 33 Hz', 'why': 'has a chance', 'answer': 'creep',
        'before': {'chances': {'none': 0.5}}, 'after': {'chances': {'creep': 0.9}}, 'spent': 1.6,
    }  # fmt: skip
    journal.write_text(f'{json.dumps({"investigation": 1})}\n{json.dumps(line)}\n')
    first, second = jobs.states_of(journal)
    assert (first.number, first.chances, first.seconds) == (0, (('none', 0.5),), 0.0)
    assert (second.answer, second.chances, second.seconds) == ('creep', (('creep', 0.9),), 1.6)
