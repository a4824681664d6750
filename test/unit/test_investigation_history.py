"""What went before a record of an investigation: known, limited, and carried into the next one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.identification.initial_conditions.record_start import first_guess
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.identification.targets import whole
from piezo_hysteresis.investigation.session import LONGEST, History
from piezo_hysteresis.models import Model, candidates, named
from piezo_hysteresis.records import Record

DT = 1e-3


def record(voltage: Any, start: float, name: str = 'r') -> Record:
    return Record(name, DT, voltage, 1e-6 * np.asarray(voltage), start=start)


def test_a_record_that_follows_at_rest_has_all_that_went_before() -> None:
    history = History()
    first = history.following(record([0.0, 1.0, 0.5], 100.0))
    assert first.before is None
    assert (first.start, first.info.start) == (0.0, 'estimate')
    second = history.following(record([0.0, 2.0], 100.005))
    np.testing.assert_array_equal(second.before, [0.0, 1.0, 0.5, 0.0, 0.0])
    assert second.start == pytest.approx(0.005)
    third = history.following(record([3.0], 100.007))
    np.testing.assert_array_equal(third.before, [0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 2.0])


@pytest.mark.parametrize('rest', [0.0, 5.0])
def test_a_state_is_estimated_until_the_history_is_known_long_enough(rest: float) -> None:
    history = History(rest)
    starts = [
        history.following(record([rest, 1.0], start)).info.start
        for start in (100.0, 100.5, 100.0 + 0.99 * LONGEST, 100.0 + LONGEST)
    ]
    assert starts == ['estimate', 'estimate', 'estimate', 'step']


def test_nothing_is_known_where_the_clock_or_the_actuator_was_started_anew() -> None:
    history = History()
    history.following(record([0.0, 1.0], 5.0))
    assert history.following(record([0.0, 1.0], 0.0)).before is None
    assert history.following(record([0.0, 1.0], 0.01)).before is not None
    history.discard()
    assert not history.known
    assert history.following(record([0.0, 1.0], 0.02)).before is None


def test_old_history_is_omitted() -> None:
    history, ticks = History(), round(LONGEST / DT)
    history.following(record(np.ones(ticks), 0.0))
    second = history.following(record([0.0, 1.0], LONGEST + 0.002))
    assert second.before is not None
    assert second.before.size == ticks
    np.testing.assert_array_equal(second.before[-3:], [1.0, 0.0, 0.0])
    third = history.following(record([0.0], 1e6))
    np.testing.assert_array_equal(third.before, np.zeros(ticks))


def test_a_model_rests_at_another_voltage_before_the_first_experiment() -> None:
    history = History(rest=5.0)
    assert history.following(record([5.0, 9.0, 5.0], 0.0)).before is None
    second = history.following(record([5.0, 7.0], 0.005))
    assert second.before is not None
    assert second.before.size == round(LONGEST / DT)
    np.testing.assert_array_equal(second.before[-6:], [5.0, 5.0, 9.0, 5.0, 5.0, 5.0])
    assert set(second.before[:-4]) == {5.0}


def test_a_section_knows_what_went_before_it() -> None:
    history = History()
    history.following(record([1.0], 0.0))
    part = history.following(record([2.0, 3.0, 4.0], DT)).section(1, 3)
    np.testing.assert_array_equal(part.before, [1.0, 2.0])


def creeping() -> tuple[Model, dict[str, float]]:
    base = named('classical')
    creep = next(c for c in candidates(base, 1.0, 1e-4) if c.effect.variant == 'creep')
    return creep.model, creep.values(base.defaults(), creep.starts[0])


def residual_of(seen: Record) -> float:
    (found,) = predictions(*creeping(), [whole(seen, begins=first_guess(seen))])
    return float(np.max(np.abs(found.residual)))


def test_creep_of_earlier_motion_continues_in_every_record() -> None:
    """Also that before the first experiment, of which nothing is known."""
    swing = np.sin(2 * np.pi * 5.0 * DT * np.arange(1000))
    rest = np.zeros(300)
    course = np.concatenate([np.ones(1000), rest, swing, rest, swing])
    (found,) = predictions(*creeping(), [whole(record(course, 0.0))])
    y, stroke = found.displacement, float(np.ptp(found.displacement))
    first, second = (Record('r', DT, swing, y[k : k + 1000], start=k * DT) for k in (1300, 2600))
    history = History()
    assert residual_of(history.following(first)) < 1e-4 * stroke
    follows = history.following(second)
    assert residual_of(follows) < 1e-4 * stroke
    at_rest = replace(follows, info=replace(follows.info, start='step'))
    assert residual_of(at_rest) > 1e-3 * stroke
