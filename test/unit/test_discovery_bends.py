"""A bend and a gain that leave the same residual are one class, with what separates them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.detection.bends import BENDS, LARGEST_CLASS, Ladder
from piezo_hysteresis.discovery.detection.limits import APART, LookAlike
from piezo_hysteresis.discovery.verdict.verdict import Alternative, NamedEffect
from piezo_hysteresis.identification import identify
from piezo_hysteresis.models import EFFECT_NAMES, ModelFile, named
from piezo_hysteresis.records import Record

DT = 2e-3
SIZES = {'gain': 3e-7, 'spring': 0.0}
LADDER = Ladder((100.0, 70.0, 50.0), 1.0, {'gain': 12.0, 'spring': 2.0}, SIZES)


def sine(bend: float, gain: float, seed: int) -> Record:
    """Return three periods of one amplitude with a curve and a gain beyond a bank of plays."""
    u = 50.0 * np.sin(2.0 * np.pi * DT * np.arange(1500))
    y = 1e-7 * (u + 0.2 * play(u, 8.0) + 0.2 * play(u, 20.0))
    stroke = float(np.ptp(y))
    y = (1.0 + gain) * y + bend * y * np.abs(y) / stroke
    noise = 1e-3 * stroke * np.random.default_rng(seed).standard_normal(u.size)
    return Record(f'week {seed}', DT, u, y + noise)


def play(u: FloatArray, width: float) -> FloatArray:
    """Return the output of a play."""
    found, now = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        now = min(max(now, value - width), value + width)
        found[k] = now
    return found


def effect(one_of: tuple[str, ...]) -> NamedEffect:
    """Return a named effect with three alternatives."""
    others = tuple(Alternative(name, 0.2) for name in ('b', 'c', 'd'))
    return NamedEffect('a', 'a', 0.4, 1e-6, 1e-6, 1e-7, {}, others, (), one_of=one_of)


def test_bends_are_curves_without_a_memory_and_a_gain() -> None:
    assert set(EFFECT_NAMES) | {'parameter_shift'} >= BENDS
    assert {'parameter_shift', 'sensor_nonlinearity', 'stiffness'} < BENDS
    assert not BENDS & {'creep', 'hysteresis', 'offset', 'transport_delay', 'gain_decay'}


def test_a_computed_class_is_the_class_of_the_effect() -> None:
    assert effect(()).effect_class == ('a', 'b', 'c', 'd')
    assert effect(('a', 'd', 'b')).effect_class == ('a', 'd', 'b')


def test_a_look_alike_with_a_probability_is_listed_once() -> None:
    alike = (LookAlike('b', 3.0), LookAlike('e', 5.8))
    found = replace(effect(()), look_alikes=alike)
    assert found.only_alike == alike[1:]
    assert found.effect_class == ('a', 'b', 'c', 'd', 'e')


def test_a_ladder_says_what_it_separates_and_what_it_does_not() -> None:
    first, second = LADDER.sentences('curve', 'V')
    assert 'To distinguish curve, gain: record the drive of 1 Hz at three amplitudes' in first
    assert '100, 70, 50 V' in first
    assert '0.3 µm rms from gain, 12 standard deviations' in first
    assert 'To distinguish curve, spring: record a second channel' in second
    assert f'2 of {APART:g}' in second
    (only,) = replace(LADDER, distances={'gain': 12.0}).sentences('curve', 'V')
    assert only == first


@pytest.mark.component
def test_at_one_amplitude_a_curve_is_a_class_with_three_amplitudes() -> None:
    known = ModelFile.parse(
        identify([sine(0.0, 0.0, 1)], named('prandtl_ishlinskii')).model.text()
    )
    found = discover([sine(0.08, 0.0, 2)], known)
    (first, *_) = found.verdict.effects
    assert 1 < len(first.effect_class) <= LARGEST_CLASS
    assert set(first.effect_class) <= BENDS
    assert 'sensor_nonlinearity' in first.effect_class
    assert first.ladder is not None
    assert len(first.ladder.amplitudes) == 3
    assert first.ladder.amplitudes[0] == pytest.approx(50.0)
    assert set(first.ladder.distances) == set(first.one_of[1:])
    written = found.verdict.to_dict()['effects'][0]
    assert written['one_of'] == list(first.one_of)
    assert written['ladder']['amplitudes'] == list(first.ladder.amplitudes)
    assert found.verdict.next_experiments[0].startswith(f'To distinguish {first.name}')
