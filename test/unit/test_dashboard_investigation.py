"""The investigation on the live page: its form, its steps with reasons, beliefs over time."""

from dashboard_fakes import Backend

from piezo_hysteresis.dashboard.backend import InvestigationOrder
from piezo_hysteresis.dashboard.investigation_form import InvestigationForm, steps_words
from piezo_hysteresis.dashboard.live import BackgroundJob, ShownBelief
from piezo_hysteresis.dashboard.panel import Controls

BELIEFS = [
    ShownBelief('run', 1, 'sine 33 Hz', 'has a chance', '', (('none', 0.5), ('creep', 0.1)), 0.0),
    ShownBelief('judge', 1, 'sine 33 Hz', 'has a chance', '', (('none', 0.5),), 0.0),
    ShownBelief('run', 2, 'step <b>', 'tells a from b', 'nothing new', (('creep', 0.9),), 1.6),
]


def form(orders):
    return InvestigationForm(orders.append, lambda: orders.append('cancel'), lambda: 'new')


def test_the_button_asks_with_limits_and_budget():
    orders = []
    shown = form(orders)
    shown._low.value, shown._high.value, shown._slew.value = -1.0, 2.0, 300.0
    shown.box._press()
    assert orders == [InvestigationOrder(-1.0, 2.0, 300.0, 200.0, 'new')]


def test_an_impossible_range_is_told_and_not_asked():
    orders = []
    shown = form(orders)
    shown._low.value, shown._high.value = 2.0, 1.0
    shown.box._press()
    assert orders == []
    assert 'below the lowest' in shown.box.words.text


def test_steps_come_with_their_reason_and_what_they_answered():
    words = steps_words(BELIEFS)
    assert words.index('step &lt;b&gt;') < words.index('sine 33 Hz')  # the newest first
    assert 'tells a from b' in words
    assert 'nothing new' in words
    assert steps_words([]) == ''


def test_beliefs_are_drawn_over_actuator_time():
    shown = form([])
    shown.refresh(BackgroundJob('running', 0.1, 'runs'), BELIEFS, True, 0.0)
    plot = shown._chances
    assert plot.figure.visible
    assert [item.label.value for item in plot._legend.items] == ['creep', 'none']
    assert list(plot._sources[0].data['x']) == [0.0, 0.0, 1.6]
    assert list(plot._sources[0].data['y']) == [0.1, 0.0, 0.9]


def test_the_page_holds_it_and_starts_it():
    backend = Backend()
    backend.live('stage').investigations_offered = True
    controls = Controls(backend, 'stage')
    controls.refresh()
    assert 'investigation' in [root.name for root in controls.roots]
    controls._investigation.box._press()
    assert isinstance(backend.orders[0], InvestigationOrder)
    assert backend.orders[0].name.startswith('investigation_')
