"""The light, the line and the banner of the page: what they say of a loop, and when they stop."""

from __future__ import annotations

import math
from typing import Any

import pytest
from dashboard_fakes import live_at

from piezo_hysteresis.dashboard.controls import ParameterState
from piezo_hysteresis.dashboard.forms import Form
from piezo_hysteresis.dashboard.live_state import (
    BackgroundJob,
    Counters,
    Gap,
    Live,
    LogLine,
    NodeState,
)
from piezo_hysteresis.dashboard.texts import (
    LOG_SHOWN,
    MUTE,
    banner,
    estimate_text,
    gap_text,
    overall,
    pulse,
    status_text,
    time_text,
)
from piezo_hysteresis.reporting.display_units import clock


def running(time: list[Any], mode: str = 'reference', **said: tuple[Any, ...]) -> Live:
    """Return a loop whose nodes have `said` their level and words."""
    live = live_at(time)
    live.published = True
    live.note('state')
    nodes = {'excitation': ('ok', 'reference: sine'), 'feedforward': ('ok', 'corrects'), **said}
    for name, (level, text) in nodes.items():
        live.nodes[name] = NodeState(name, True, 0.0)
        live.diagnostics[name] = LogLine(time[0], name, level, text)
    live.nodes['excitation'] = NodeState(
        'excitation', True, 0.0, {'mode': ParameterState('excitation', 'mode', mode)}
    )
    return live


def test_the_light_is_red_where_the_reference_is_not_followed() -> None:
    live = running([100.0])
    assert overall(live, (1e-7, 1e-4)).level == 'ok'
    assert 'dot ok' in pulse(live, (1e-7, 1e-4))
    bad = overall(live, (7.9e-4, 1e-3))
    assert bad.level == 'error'
    assert '79 %' in bad.text
    assert 'dot error' in pulse(live, (7.9e-4, 1e-3))


@pytest.mark.parametrize('level', ['warning', 'error'])
def test_the_light_is_that_of_the_worst_node_and_names_it(level: str) -> None:
    live = running([100.0], attenuation=(level, 'the voltage is cut'))
    found = overall(live)
    assert found.level == level
    assert found.text == 'attenuation: the voltage is cut'
    live.nodes['attenuation'] = NodeState('attenuation', False, 100.0)
    assert overall(live).level == 'ok'  # a node that has gone is told of by the banner
    assert 'attenuation' in banner(live)


def test_a_compensated_gap_raises_no_alarm() -> None:
    live = running([100.0], gap_monitor=('warning', 'record a sweep and run discover'))
    live.gaps.append(Gap(100.0, 6e-6, 1e-8, 600.0, 23.0, (0,), (6e-6,), True, 'drift'))
    assert 'gap_monitor' in overall(live, (5e-6, 8e-5)).text
    assert overall(live, (5e-8, 8e-5)).text == ''
    assert 'gap_monitor' in overall(live).text  # nothing is tracked


@pytest.mark.parametrize('name', ['gap_monitor', 'identification', 'recorder'])
def test_a_node_that_watches_the_loop_does_not_change_its_light(name: str) -> None:
    live = running([100.0], 'reference', **{name: ('error', 'no model')})
    found = overall(live, (1e-7, 1e-4))
    assert found.level == 'ok'
    assert found.text == f'{name}: no model'


def test_a_node_without_recent_status_is_not_ok() -> None:
    time = [100.0]
    live = running(time)
    time[0] += MUTE + 1.0
    live.note('state')
    assert overall(live).level == 'warning'
    assert 'reported 6 s ago' in overall(live).text


def test_links_without_input_are_ok_at_rest() -> None:
    words = 'no input since tick 9: the voltage is ramped to safety'
    live = running([100.0], mode='idle', feedforward=('warning', words))
    assert overall(live).level == 'ok'
    assert 'rests' in status_text(live)
    live = running([100.0], mode='reference', feedforward=('warning', words))
    assert overall(live).level == 'warning'


def test_the_banner_states_the_remedy() -> None:
    time = [100.0]
    live = running(time, mode='idle')
    time[0] += 20.0
    assert 'choose a mode under Drive' in banner(live)
    assert 'calm' in banner(live)
    live.diagnostics['excitation'] = LogLine(time[0], 'excitation', 'error', 'no actuator/state')
    assert 'has stopped (no actuator/state)' in banner(live)
    assert 'choose a mode again' in banner(live)
    assert 'calm' not in banner(live)
    live.published = False
    assert 'Start the simulator' in banner(live)


def test_words_of_the_log_go_away() -> None:
    time = [100.0]
    live = running(time)
    live.words.append(LogLine(100.0, 'feedforward', 'warning', 'no input'))
    assert 'no input' in status_text(live)
    time[0] += LOG_SHOWN + 1.0
    assert 'no input' not in status_text(live)


def test_counters_have_a_description() -> None:
    live = running([100.0])
    live.counters['feedforward'] = Counters(100.0, 5, 0.0, {'doubled': 3, 'strange': 1})
    assert 'messages that came twice' in status_text(live)
    assert 'strange 1' in status_text(live)


def test_empty_panels_give_the_command_of_this_actuator() -> None:
    assert 'node gap_monitor -p model_file:=MODEL.yaml -r __ns:=/stage' in gap_text(
        [], False, 'stage'
    )
    assert 'node identification</code>' in estimate_text([], False)


def test_a_job_shows_elapsed_and_remaining_time() -> None:
    job = BackgroundJob('running', 0.25, 'fits', since=100.0)
    assert time_text(job, 130.0) == 'since 30 s, about 1 min 30 s left'
    assert time_text(BackgroundJob('running', 0.0, 'reads', since=100.0), 103.0) == 'since 3 s'
    assert time_text(BackgroundJob('done', 1.0, 'fine', since=100.0), 130.0) == ''
    assert time_text(BackgroundJob('asked'), 1.0) == ''
    form = Form('sweep', (), lambda: None, lambda: None)
    _, bar, shown = form.root.children
    assert not form.show_job(job, 130.0)
    assert '1 min 30 s left' in shown.text
    assert math.isclose(bar.value, 25)
    assert form.show_job(BackgroundJob(), 140.0, '<p>hint</p>')
    assert shown.text == '<p>hint</p>'


@pytest.mark.parametrize(
    ('seconds', 'words'), [(0.2, '0 s'), (59.4, '59 s'), (185, '3 min 05 s'), (7800, '2 h 10 min')]
)
def test_times_are_rounded_for_display(seconds: float, words: str) -> None:
    assert clock(seconds) == words
