"""Investigations: criterion, choice, folder, continuing and repeating."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.common.parameter_table import range_refusal
from piezo_hysteresis.experiments.planned_experiment import (
    ExperimentLimits,
    InvestigationError,
    catalogue,
    granted_range,
    known_range,
)
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.investigation.experiment_choice import (
    LARGEST,
    SMALLEST,
    detection_probability,
    discrimination,
    entropy,
    hidden_share,
)
from piezo_hysteresis.investigation.session import Investigation, Rules, Stop, investigate
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record
from piezo_sim.plant import Plant
from piezo_sim.sweep import grid, simulate

PRESET, RATE, LIMITS = 'generic_bouc_wen', 1000.0, ExperimentLimits(-1.0, 1.0, slew=700.0)
QUIET = {'effects.noise': True, 'sensor.noise_rms': 2e-8}


@pytest.fixture(scope='module')
def model() -> ModelFile:
    specs = grid('sine', [1.0, 5.0, 20.0, 50.0], [1.0, 0.5], {'duration': 2.5, 'ramp': 0.2})
    records = simulate(PRESET, specs, QUIET, 1, RATE)
    return identify(records, named('classical')).model


def actuator(**effects: Any) -> Callable[..., Any]:
    """Return an actuator that moved before, which no record shows."""
    plant = Plant.from_preset(PRESET, RATE, 3, QUIET | effects)
    plant.run(0.8 * np.sin(2.0 * np.pi * 5.0 * np.arange(2050) / RATE))
    clock = 0.0

    def run(experiment: Any) -> Record:
        nonlocal clock
        plant.run(np.zeros(300))
        voltage = experiment.voltage(RATE)
        start, clock = clock + 0.3, clock + 0.3 + voltage.size / RATE
        return Record(experiment.name, 1.0 / RATE, voltage, plant.run(voltage), start=start)

    return run


@pytest.mark.component
def test_creep_is_named_and_confirmed_in_a_tenth_of_the_budget(model: ModelFile) -> None:
    investigation = Investigation(model, LIMITS, RATE)
    stop = investigate(investigation, actuator(**{'effects.creep': True}))
    assert stop.reason == 'sure'
    assert investigation.belief.names == ('creep',)
    assert investigation.spent < 0.1 * investigation.rules.budget
    names = [answer.after.names for answer in investigation.answers]
    assert names[-2:] == [('creep',), ('creep',)]


@pytest.mark.slow
def test_where_nothing_is_missing_it_stops_early(model: ModelFile) -> None:
    investigation = Investigation(model, LIMITS, RATE)
    stop = investigate(investigation, actuator())
    assert stop.reason == 'nothing'
    assert investigation.belief.names == ()
    assert investigation.spent < 0.1 * investigation.rules.budget


@pytest.mark.slow
def test_the_same_records_lead_to_the_same_choices_and_beliefs(model: ModelFile) -> None:
    first = Investigation(model, LIMITS, RATE)
    investigate(first, actuator(**{'effects.saturation': True, 'amplifier.clip_high': 0.8}))
    again = Investigation(model, LIMITS, RATE)
    for answer, record in zip(first.answers, first.records, strict=True):
        choice = again.next()
        assert not isinstance(choice, Stop)
        assert choice.experiment == answer.experiment
        assert again.take(choice.experiment, record).after.chances == answer.after.chances
    assert again.next() == first.next()


@pytest.mark.slow
def test_a_budget_is_not_exceeded(model: ModelFile) -> None:
    investigation = Investigation(model, LIMITS, RATE, Rules(budget=2.0))
    stop = investigate(investigation, actuator())
    assert stop.reason == 'budget'
    assert 0.0 < investigation.spent <= 2.0


@pytest.mark.component
def test_experiments_keep_the_stroke_that_the_model_predicts(model: ModelFile) -> None:
    every = Investigation(model, LIMITS, RATE).outlooks
    most = 0.6 * max(each.stroke for each in every)
    with pytest.raises(InvestigationError, match='stroke'):
        Investigation(model, ExperimentLimits(-1.0, 1.0, stroke=1e-9), RATE)
    with pytest.raises(InvestigationError, match='stroke'):
        # the conditioning alone takes the whole range of voltages
        Investigation(model, ExperimentLimits(-1.0, 1.0, stroke=most), RATE)


def test_a_model_without_discrepancy_is_refused(model: ModelFile) -> None:
    bare = ModelFile(model.model, model.values)
    with pytest.raises(InvestigationError, match='identify it again'):
        Investigation(bare, LIMITS, RATE)


def test_the_default_range_is_that_of_the_evaluated_records(model: Any) -> None:
    known = max(each.amplitude for each in model.discrepancy.conditions)
    assert known == pytest.approx(1.0, rel=1e-3)
    assert known_range(-5.0, 5.0, model) == (-known, known)
    assert known_range(-0.5, 5.0, model) == (-0.5, known)
    assert known_range(0.0, 150.0, model) == (0.0, 2.0 * known)


NAN, INF = float('nan'), float('inf')
NO_RANGES = [
    (0.3, -0.3),
    (-0.3, NAN),
    (NAN, 0.3),
    (-INF, INF),
    (0.0, -0.3),
    (0.3, 0.0),
    (1.0, 1.0),
]


@pytest.mark.parametrize(('low', 'high'), NO_RANGES)
def test_limits_that_are_given_are_kept_or_refused(low: Any, high: Any, model: ModelFile) -> None:
    assert range_refusal(low, high)
    with pytest.raises(InvestigationError, match='voltage limits'):
        granted_range((low, high), (-1.0, 1.0), model)


@pytest.mark.parametrize('number', [NAN, -INF, -1.0, INF])
def test_fields_of_a_goal_without_sense_are_named(number: float) -> None:
    for name in ('slew', 'frequency', 'stroke', 'heat', 'budget', 'sure'):
        if number == INF and name in ('slew', 'stroke', 'heat'):
            continue  # no limit
        kind: Any = Rules if name in ('budget', 'sure') else partial(ExperimentLimits, -1.0, 1.0)
        with pytest.raises(InvestigationError, match=name):
            kind(**{name: number})


def test_one_limit_alone_is_refused_and_none_is_what_is_known(model: ModelFile) -> None:
    assert 'highest voltage is not given' in range_refusal(-0.3, None)
    assert 'lowest voltage is not given' in range_refusal(None, 0.3)
    assert range_refusal(None, None) == range_refusal(-0.3, 0.3) == ''
    assert granted_range((-0.3, 0.2), (-1.0, 1.0), model) == (-0.3, 0.2)
    assert granted_range((-3.0, 0.2), (0.0, 0.0), model) == (-3.0, 0.2)
    assert granted_range((0.0, 0.0), (-0.5, 1.0), model) == known_range(-0.5, 1.0, model)
    with pytest.raises(InvestigationError, match=r'exceed the -1 \.\. 1 V'):
        granted_range((-3.0, 0.2), (-1.0, 1.0), model)
    with pytest.raises(InvestigationError, match='does not publish its voltage range'):
        granted_range((0.0, 0.0), (0.0, 0.0), model)

    with pytest.raises(InvestigationError, match=r'5 \.\. 95 V exclude 0 V'):
        granted_range((5.0, 95.0), (-20.0, 130.0), model)


@pytest.mark.parametrize(
    ('low', 'high', 'rest', 'at_rest'),
    [(5.0, 95.0, 0.0, 5.0), (5.0, 95.0, 50.0, 50.0), (-9.0, -2.0, 0.0, -2.0), (-1, 1, 0.0, 0.0)],
)
def test_experiments_begin_and_end_at_the_permitted_voltage_nearest_to_rest(
    low: Any, high: float, rest: float, at_rest: float
) -> None:
    limits = ExperimentLimits(low, high, 20.0 * (high - low), 20.0, rest=rest)
    assert limits.rest == at_rest
    for each in catalogue(limits, RATE):
        voltage = each.voltage(RATE)
        assert voltage[0] == pytest.approx(at_rest, abs=1e-6 * (high - low))
        assert voltage[-1] == pytest.approx(at_rest, abs=0.05 * (high - low))
        assert not limits.refusal(voltage, 1.0 / RATE)


@pytest.mark.parametrize(('low', 'high'), [(0.0, 0.0), (NAN, 1.0)])
def test_a_range_without_voltages_is_refused(low: Any, high: float) -> None:
    with pytest.raises(InvestigationError):
        ExperimentLimits(low, high)


def test_rivals_with_equal_predictions_are_not_distinguished() -> None:
    chances = np.array([0.5, 0.5])
    assert discrimination(chances, ['creep', 'drift'], np.zeros((2, 2))) == pytest.approx(0.0)


def test_a_certain_distinction_is_worth_the_whole_entropy() -> None:
    chances = np.array([0.7, 0.2, 0.1])
    for nats in (50.0, 5000.0):
        gained = discrimination(chances, ['a', 'b', 'c'], nats * (1.0 - np.eye(3)))
        assert gained == pytest.approx(entropy(chances))


def test_two_variants_of_one_effect_need_not_be_distinguished() -> None:
    chances = np.array([0.5, 0.5])
    assert discrimination(chances, ['creep', 'creep'], 9.0 * (1.0 - np.eye(2))) == 0.0


def test_more_difference_is_worth_more_and_even_rivals_most() -> None:
    apart = 1.0 - np.eye(2)
    even, sure = np.array([0.5, 0.5]), np.array([0.95, 0.05])
    worth = [discrimination(even, ['a', 'b'], nats * apart) for nats in (0.1, 1.0, 10.0)]
    assert worth == sorted(worth)
    assert discrimination(sure, ['a', 'b'], 10.0 * apart) < worth[-1]


def test_sizes_are_hidden_by_their_logarithm() -> None:
    middle = np.sqrt(SMALLEST * LARGEST)
    found = hidden_share(np.array([0.0, SMALLEST, middle, LARGEST, np.inf]))
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 1.0, 1.0])


def test_an_experiment_without_smaller_detectable_sizes_has_no_information() -> None:
    weights, seen = np.array([0.3, 0.2]), np.array([0.2, np.inf])
    assert detection_probability(weights, seen, np.array([0.2, np.inf]), 0.5) == 0.0
    assert detection_probability(weights, seen, np.array([0.5, SMALLEST]), 0.5) > 0.2


def test_a_rival_that_is_out_of_the_question_asks_nothing() -> None:
    # a live course met this: the only likely rival is far from what an impossible one would show
    chances, far = np.array([1.0, 0.0, 0.0]), 2000.0 * (1.0 - np.eye(3))
    with np.errstate(all='raise', under='ignore'):
        assert discrimination(chances, ['drift', 'creep', 'gain_decay'], far) == 0.0
