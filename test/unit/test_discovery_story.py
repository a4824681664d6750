"""The papers' story in small: a mode that harmonics of slow drives meet is found and explained."""

from __future__ import annotations

import pytest

from piezo_hysteresis.discovery import Verdict, discover
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

pytestmark = pytest.mark.slow

MODE, DAMPING = 68.0, 0.015


def bimorph(hysteresis: bool) -> list[Record]:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': 1.0, 'duration': 1.5}
        for f in (2, 5, 14, 18, 23, 40)
    ]
    effects = {
        'effects.play': False,
        'effects.sensor_nonlinearity': False,
        'effects.bouc_wen': hysteresis,
    }
    return simulate('fdk_pzba_00030', plan, effects, 5)


def mode_of(verdict: Verdict) -> None:
    """Check frequency and damping against the truth and their own intervals."""
    assert verdict.verdict == 'named', verdict.summary
    (effect,) = verdict.effects
    assert effect.name == 'resonance'
    for name, true in (('resonance_frequency', MODE), ('resonance_damping', DAMPING)):
        number = effect.parameters[name]
        assert number.value == pytest.approx(true, rel=1e-2)
        assert number.std is not None
        assert 0.0 < number.std < 1e-2 * true
    assert 'resonance at 68 Hz' in verdict.summary
    assert verdict.held_out.before_in_floors > 20
    assert verdict.held_out.after_in_floors < 1.2


def test_the_mode_is_named_with_the_drives_whose_harmonics_meet_it() -> None:
    verdict = discover(bimorph(hysteresis=True), named('classical'), workers=2).verdict
    mode_of(verdict)
    (effect,) = verdict.effects
    orders = {each['frequency_hz']: each['order'] for each in effect.drives}
    assert orders == {14.0: 5, 23.0: 3}
    # the third harmonic of a loop is larger than the fifth, and nearer to the mode here
    assert effect.drives[0]['frequency_hz'] == 23.0
    assert '23 Hz (order 3, 69 Hz' in effect.evidence[-1]
    rows = verdict.over_frequency
    assert [row['frequency_hz'] for row in rows] == [2, 5, 14, 18, 23, 40]
    assert 0 < sum(row['held_out'] for row in rows) < len(rows)
    assert all(row['after_in_floors'] < 1.3 < row['before_in_floors'] for row in rows)


def test_a_mode_takes_the_place_of_the_autoregression_that_imitates_it() -> None:
    verdict = discover(bimorph(hysteresis=False), named('extended'), workers=2).verdict
    mode_of(verdict)
    assert verdict.effects[0].variant == 'series_mode'
