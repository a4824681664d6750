"""Creep of two elements is distinguished from logarithmic creep."""

from __future__ import annotations

import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

pytestmark = pytest.mark.slow

ELEMENTS = {
    'creep.gain_1': 0.045,
    'creep.time_1': 0.4,
    'creep.gain_2': 0.07,
    'creep.time_2': 4.0,
    'creep.gain_3': 0.0,
}


def records(hidden: dict[str, float | bool]) -> list[Record]:
    plan = [
        *(
            {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 2.0}
            for f, a in ((1, 1.0), (3, 1.0), (9, 1.0), (31, 1.0), (9, 0.5))
        ),
        {'kind': 'step', 'amplitude': 0.8, 'duration': 15.0, 'warm_up': 0.0},
    ]
    return simulate('generic_bouc_wen', plan, hidden, 5)


@pytest.mark.parametrize(
    ('hidden', 'variant'),
    [
        ({'effects.creep': True, **ELEMENTS}, 'creep_pair'),
        ({'effects.log_creep': True, 'log_creep.gain': 0.05}, 'logarithmic_creep'),
    ],
)
def test_the_law_of_the_creep_is_recognised(hidden: dict[str, float | bool], variant: str) -> None:
    result = discover(records(hidden), named('classical'), seed=1, workers=1)
    verdict = result.verdict
    assert [effect.name for effect in verdict.effects] == ['creep']
    assert verdict.effects[0].variant == variant
    assert verdict.held_out.after_in_floors < 1.2
    if variant == 'creep_pair':
        values = result.final.values
        assert values['creep_share'] == pytest.approx(ELEMENTS['creep.gain_1'], rel=0.05)
        assert values['creep_time'] == pytest.approx(ELEMENTS['creep.time_1'], rel=0.05)
        assert values['slow_creep_share'] == pytest.approx(ELEMENTS['creep.gain_2'], rel=0.05)
        slow = values['creep_time'] * values['slow_creep_ratio']
        assert slow == pytest.approx(ELEMENTS['creep.time_2'], rel=0.05)
