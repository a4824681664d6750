"""Sliders, switches and typed words of the live page, without ROS and without a browser."""

from __future__ import annotations

import math

import pytest
from dashboard_fakes import Backend, amplitude

from piezo_hysteresis.dashboard.controls import (
    ParameterState,
    described,
    groups_of,
    reach,
    refusal_text,
)
from piezo_hysteresis.dashboard.forms import numbers
from piezo_hysteresis.dashboard.panel import ParameterRow
from piezo_hysteresis.errors import PiezoError


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
