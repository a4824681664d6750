"""The simulation of the lottery agrees with its description, and results are counted correctly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies.reliability import classes, said_in
from studies.worlds.lottery import Row, exam, sets
from studies.worlds.lottery_world import (
    EFFECTS,
    Actuator,
    Conditions,
    clean,
    drawn_actuator,
    drawn_conditions,
    recorded,
    with_hidden,
)

ACTUATOR = Actuator(10.0, 1e-5, 0.3, 1.0, 0.2, 0.05, 0.05)
CONDITIONS = Conditions(
    1000.0, 'rest', 1e-3, False, False, 0.0, 12, ('sine', 'sine'), ((1.0, 0.002), (0.5, 0.004))
)


def hidden(**sizes: float) -> list[np.ndarray]:
    """Return the strokes of the actuator with effects of these sizes."""
    named = {name.replace('_', ' '): size for name, size in sizes.items()}
    return [y for _, y in clean(replace(ACTUATOR, sizes=named), CONDITIONS)]


@pytest.mark.component
def test_a_delay_comes_later_and_a_falling_gain_falls() -> None:
    plain, late, falling = hidden(), hidden(delay=3.0), hidden(falling_gain=0.2)
    assert late[0][3:] == pytest.approx(plain[0][:-3])
    assert falling[0][-1] == pytest.approx(0.8 * plain[0][-1], rel=1e-3)
    assert falling[0][0] == plain[0][0]


def test_the_quasi_static_loop_agrees_with_its_parameters() -> None:
    slow = replace(CONDITIONS, drives=((1.0, 1 / 3000),), kinds=('sine',))
    ((voltage, stroke),) = clean(ACTUATOR, slow)
    turn = int(np.argmax(voltage))
    # from rest h follows dh = (1 - (beta + gamma) h) du
    h = (1.0 - np.exp(-1.2)) / 1.2
    assert stroke[turn + 2] == pytest.approx(1.0 + 0.3 * h, rel=2e-3)


def test_records_have_the_noise_and_the_steps_of_their_conditions() -> None:
    random = np.random.default_rng(0)
    fine = recorded(ACTUATOR, replace(CONDITIONS, bits=16), random)
    noise = fine[0].displacement - ACTUATOR.metres * hidden()[0]
    assert noise.std() == pytest.approx(1e-3 * ACTUATOR.metres, rel=0.1)
    (first, _) = recorded(ACTUATOR, replace(CONDITIONS, bits=8), random)
    levels = np.unique(first.displacement)
    assert np.diff(levels).min() == pytest.approx(3.0 / 2**8 * ACTUATOR.metres)
    assert np.ptp(first.voltage) == pytest.approx(20.0, rel=1e-3)


@pytest.mark.parametrize('start', ['step', 'mid-period', 'remanent'])
def test_records_start_at_their_stated_state(start: str) -> None:
    (voltage, stroke), _ = clean(ACTUATOR, replace(CONDITIONS, start=start))
    if start == 'remanent':
        assert voltage[0] == 0.0
        assert abs(stroke[0]) > 0.02  # where it was left
    else:
        assert abs(voltage[0]) > 0.1
        assert (abs(stroke[0]) > 0.1) == (start == 'mid-period')


@pytest.mark.component
@pytest.mark.parametrize('name', ['creep', 'tone', 'lag'])
def test_what_hides_can_be_seen_and_a_seed_draws_the_same(name: str) -> None:
    def drawn() -> tuple[Actuator, Conditions]:
        random = np.random.default_rng(5)
        conditions, plain = drawn_conditions(random), drawn_actuator(random)
        return with_hidden(plain, conditions, [name], random), conditions

    actuator, conditions = drawn()
    assert drawn() == (actuator, conditions)
    plain = clean(replace(actuator, sizes={}), conditions)
    seen = clean(actuator, conditions)
    change = max(float(np.std(z - y)) for (_, y), (_, z) in zip(plain, seen, strict=True))
    assert change > conditions.noise


def test_sets_hide_every_effect_once_before_any_twice() -> None:
    drawn = sets([11, 2, 1, 2])
    assert sorted(hidden[0] for kind, hidden in drawn if kind == 'single') == sorted(EFFECTS)
    assert all(len(set(hidden)) == 2 for kind, hidden in drawn if kind == 'pair')


def test_names_are_counted_from_the_rows() -> None:
    refused = Row('null', (), CONDITIONS, None, 'too short', 1.0)
    found = exam([refused, replace(refused, kind='single', hidden=('delay',))], 3)
    assert found.counts['first'] == found.counts['none'] == (0, 1)
    assert found.rows[0]['reported'] == 'refused: too short'
    assert said_in(found.rows) == []
    told = {**found.rows[1], 'reported': 'transport_delay 0.66 (or amplifier_lag); creep 0.60'}
    names = said_in([told])
    assert names == [(0.66, True), (0.60, False)]
    (both,) = classes(names)
    assert (both.named, both.right, both.share) == (2, 1, 0.5)
    low, high = both.interval
    assert low == pytest.approx(0.0126, abs=1e-3)
    assert high == pytest.approx(0.9874, abs=1e-3)
