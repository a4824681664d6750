"""Rules of an investigation, and what went before a record."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from frozen_rounds import FROZEN

from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.initial_conditions.record_start import first_guess
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.investigation.experiment_choice import (
    Belief,
    CandidateModel,
    ExperimentChoice,
    distances,
)
from piezo_hysteresis.investigation.predict import in_use
from piezo_hysteresis.investigation.session import LONGEST, History, Investigation, Rules, Stop
from piezo_hysteresis.models import Model, ModelFile, candidates, named
from piezo_hysteresis.records import Record

RATE = 500.0
GIVEN = ModelFile.load(FROZEN / 'plays.yaml')


@pytest.fixture(scope='module')
def prepared() -> Investigation:
    """Return an investigation whose experiments have been predicted."""
    return Investigation(GIVEN, ExperimentLimits(-1.0, 1.0, slew=700.0), RATE)


@pytest.fixture
def course(prepared: Investigation) -> Investigation:
    """Return it before the first experiment."""
    prepared.rules, prepared.answers, prepared.records = Rules(), [], []
    prepared.evaluated = 0.0
    prepared.belief = replace(a_belief('none'), chances=prepared.hidden.chances(()))
    return prepared


def a_belief(verdict: str, chance: float = 0.5, *names: str, left: bool = False) -> Belief:
    """Return what is believed: `names`, the least sure of them with this probability."""
    first = names[0] if names else 'none'
    return Belief(verdict, names, {first: chance}, (first, chance), (), left, 1.0)


def run(course: Investigation, after: Belief) -> ExperimentChoice:
    """Run the next experiment, after which `after` is believed."""
    choice = course.next()
    assert isinstance(choice, ExperimentChoice)
    voltage = choice.experiment.voltage(RATE)
    course.keep(choice.experiment, Record('r', 1.0 / RATE, voltage, 1e-5 * voltage), after)
    return choice


def stopped(course: Investigation, after: Belief, most: int = 60) -> tuple[int, Stop]:
    """Run experiments that change no belief until it stops."""
    for number in range(most):
        if isinstance(course.next(), Stop):
            stop = course.next()
            assert isinstance(stop, Stop)
            return number, stop
        run(course, after)
    pytest.fail(f'no stop after {most} experiments')


def test_a_sure_name_is_confirmed_by_one_more_experiment(course: Investigation) -> None:
    number, stop = stopped(course, a_belief('named', 0.95, 'creep'))
    assert (number, stop.reason) == (2, 'sure')
    assert stop.words == 'creep: sure, and confirmed by another experiment'


def test_a_sure_name_is_separated_from_what_resembles_it(course: Investigation) -> None:
    """What the records cannot distinguish, an allowed experiment does before the end."""
    base = in_use(GIVEN)
    every = {each.effect.variant: each for each in candidates(base.model, 1.0, 1e-5)}
    models = [
        base.with_candidate(every[name], every[name].values(base.values, every[name].starts[0]))
        for name in ('creep', 'drift')
    ]
    alternatives = tuple(CandidateModel(each.effect, 0.5, each, {}) for each in models)
    alike = replace(a_belief('named', 0.95, 'creep'), candidates=alternatives, alike=True)
    for _ in range(2):
        run(course, alike)
    choice = course.next()
    assert isinstance(choice, ExperimentChoice)
    assert choice.discrimination > 0.5
    assert 'distinguishes creep and drift' in choice.why
    assert distances(alternatives, course.outlooks[0]).shape == (2, 2)
    run(course, replace(alike, alike=False))
    assert isinstance(course.next(), Stop)


def test_a_name_below_the_limit_is_not_sure(course: Investigation) -> None:
    _, stop = stopped(course, a_belief('named', 0.89, 'creep'))
    assert stop.reason != 'sure'


def test_a_name_that_changes_is_confirmed_anew(course: Investigation) -> None:
    run(course, a_belief('named', 0.95, 'creep'))
    run(course, a_belief('named', 0.95, 'drift'))
    assert isinstance(course.next(), ExperimentChoice)
    run(course, a_belief('named', 0.95, 'drift'))
    stop = course.next()
    assert isinstance(stop, Stop)
    assert stop.words.startswith('drift: sure')


def test_more_confirmations_can_be_requested(course: Investigation) -> None:
    course.rules = Rules(confirmed=3)
    number, stop = stopped(course, a_belief('named', 0.95, 'creep'))
    assert (number, stop.reason) == (4, 'sure')


def test_where_nothing_shows_every_effect_was_looked_for(course: Investigation) -> None:
    number, stop = stopped(course, a_belief('none'))
    assert stop.reason == 'nothing'
    assert 1 < number < 30
    assert course.spent < course.rules.budget
    # an experiment that might show something new is never left out
    assert all(each.first_detection < course.rules.quiet for each in course.ranked())


def test_what_has_no_name_is_given_up_after_some_experiments(course: Investigation) -> None:
    number, stop = stopped(course, a_belief('unknown', 0.3, left=True))
    assert stop.reason == 'exhausted'
    assert number >= course.rules.nameless


def test_a_budget_ends_it_before_it_is_exceeded(course: Investigation) -> None:
    course.rules = Rules(budget=2.0)
    _, stop = stopped(course, a_belief('named', 0.5, 'creep'))
    assert stop.reason == 'budget'
    assert 0.0 < course.spent <= 2.0


def test_the_time_of_the_evaluations_ends_it(course: Investigation) -> None:
    run(course, a_belief('named', 0.5, 'creep'))
    course.evaluated = course.rules.time_limit + 1.0
    stop = course.next()
    assert isinstance(stop, Stop)
    assert stop.reason == 'time'
    assert stop.words == 'the evaluations took 121 s without a result'


def test_an_experiment_is_run_twice_at_the_most(course: Investigation) -> None:
    stopped(course, a_belief('named', 0.5, 'creep'))
    runs = [course.done.count(name) for name in set(course.done)]
    assert max(runs) <= 2


def test_experiments_keep_the_limits(course: Investigation) -> None:
    stopped(course, a_belief('unknown', 0.3, left=True))
    for answer in course.answers:
        voltage = answer.experiment.voltage(RATE)
        assert np.all(np.abs(voltage) <= 1.0)
        assert np.all(np.abs(np.diff(voltage)) * RATE <= 700.0 * (1.0 + 1e-9))


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
