"""The investigation on the live page: its form, its steps with reasons, beliefs over time."""

from __future__ import annotations

from typing import Any

from bokeh.document import Document
from bokeh.events import ButtonClick
from dashboard_fakes import Backend

from piezo_hysteresis.dashboard.backend import InvestigationOrder
from piezo_hysteresis.dashboard.forms import InvestigationForm, steps_text
from piezo_hysteresis.dashboard.live_state import BackgroundJob, InvestigationState
from piezo_hysteresis.dashboard.panel import Controls

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
