"""Every decision rule on synthetic numbers: cases that it accepts and that it rejects."""

from __future__ import annotations

from dataclasses import fields
from math import inf, nan

import pytest

from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.discovery.selection import rules
from piezo_hysteresis.discovery.selection.policy import HELD, POLICY, SelectionPolicy, rows
from piezo_hysteresis.errors import IdentificationError


@pytest.mark.parametrize(
    ('excess', 'by_record', 'gap'),
    [
        (0.0, [0.0, 0.0], False),
        (0.029, [0.1, -0.1], False),
        (0.031, [0.0, 0.0], True),
        # one record of many: 20 % and what 5000 samples scatter by
        (0.0, [0.24, 0.0], False),
        (0.0, [0.27, 0.0], True),
        (nan, [0.0, 0.0], True),
        (inf, [0.0, 0.0], True),
        (0.0, [nan, 0.0], True),
    ],
)
def test_a_gap_is_more_than_noise(excess: float, by_record: list[float], gap: bool) -> None:
    assert rules.shows_a_gap(excess, by_record, [0.02, 0.02], 0.0, POLICY) is gap


def test_a_noise_that_is_badly_known_opens_no_gap() -> None:
    assert rules.shows_a_gap(0.1, [0.1], [0.02], 0.01, POLICY)
    assert not rules.shows_a_gap(0.1, [0.1], [0.02], 0.03, POLICY)


def test_the_coarsest_law_sets_the_remaining_error_of_the_actuator() -> None:
    assert rules.model_discrepancy([], 100.0) == 0.0
    assert rules.model_discrepancy([0.02, 0.07], 100.0) == pytest.approx(0.49)
    assert rules.model_discrepancy([0.07], -0.5) == 0.0


@pytest.mark.parametrize(
    ('before', 'after', 'known', 'worth'),
    [
        (1.0, 0.76, 0.0, False),
        (1.0, 0.74, 0.0, True),
        # of what the laws are known to miss nothing is given a name
        (1.0, 0.0, 1.0, False),
        # of little more nearly all must go
        (1.5, 0.2, 1.0, False),
        (1.5, 0.1, 1.0, True),
        # of much more the discrepancy hardly counts
        (10.0, 6.4, 1.0, True),
    ],
)
def test_what_is_worth_a_name(before: float, after: float, known: float, worth: bool) -> None:
    assert rules.explains_enough(before, after, known, POLICY) is worth


def test_what_promises_to_become_worth_a_name_is_fitted_on() -> None:
    policy = POLICY.but(min_share=0.2, promising=0.5)
    assert rules.is_promising(10.0, 9.0, 0.0, policy)
    assert not rules.is_promising(10.0, 9.1, 0.0, policy)
    assert not rules.is_promising(10.0, 9.0, 0.1, policy)
    assert not rules.is_promising(10.0, nan, 0.0, policy)


def test_a_candidate_must_promise_a_part_of_what_a_name_asks_for() -> None:
    policy = POLICY.but(min_share=0.2, required_score_share=0.05, min_score=1e-4)
    assert rules.min_screening_score(1e6, policy) == pytest.approx(0.01)
    assert rules.min_screening_score(1.0, policy) == pytest.approx(0.005)
    # nothing above the noise, or nothing that can be told, asks for the least there is
    assert [rules.min_screening_score(each, policy) for each in (0.0, -0.5, nan)] == [1e-4] * 3


def test_what_is_sure_is_none_of_chance_and_pays_for_its_parameters() -> None:
    assert rules.is_significant(5.1, 0.01, POLICY)
    assert not rules.is_significant(4.9, 1.0, POLICY)
    assert not rules.is_significant(9.0, -0.01, POLICY)
    assert not rules.is_significant(nan, 1.0, POLICY)


@pytest.mark.parametrize(
    ('simpler', 'richer', 'errors', 'good'),
    [
        (0.02, 0.0, 99.0, True),  # nothing is missing
        (9.0, 1.0, 4.0, True),  # by chance
        (9.0, 8.9, 99.0, True),  # hardly less
        (9.0, 1.0, 99.0, False),
    ],
)
def test_when_a_simpler_model_is_as_good(
    simpler: float, richer: float, errors: float, good: bool
) -> None:
    assert rules.is_as_good(simpler, richer, errors, 0.03, POLICY) is good


def test_held_out_records_veto_what_makes_them_worse() -> None:
    assert rules.is_no_worse(1.0, 1.019, POLICY)
    assert not rules.is_no_worse(1.0, 1.021, POLICY)
    assert not rules.is_no_worse(1.0, nan, POLICY)


@pytest.mark.parametrize(
    ('before', 'after', 'share'),
    [(3.0, 1.0, 1.0), (3.0, 3.0, 0.0), (3.0, 5.0, 0.0), (3.0, inf, 0.0), (1.0, 1.0, 1.0)],
)
def test_the_share_that_was_explained(before: float, after: float, share: float) -> None:
    assert rules.explained(before, after) == pytest.approx(share)


def test_half_of_the_excess_is_half() -> None:
    assert rules.explained(3.0, 5.0**0.5) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ('named', 'left', 'word'),
    [(0, False, 'none'), (0, True, 'unknown'), (1, True, 'named'), (2, False, 'named')],
)
def test_the_word(named: int, left: bool, word: str) -> None:
    assert rules.verdict_name(named, left) == word


def test_every_number_has_unit_meaning_and_source() -> None:
    assert len(rows()) == len(fields(SelectionPolicy))
    for name, value, unit, means, source in rows():
        assert all((value, unit, means.endswith('.'))), name
        assert source.split(':')[0].split(',')[0] in {'derived', 'measured', 'chosen', 'effort'}


def test_numbers_can_be_others_and_impossible_ones_are_refused() -> None:
    assert POLICY.but(min_share=0.5, first_fits=12.0).min_share == 0.5
    assert POLICY.but(first_fits=12.0).first_fits == 12
    assert HELD.variants_first == 1
    for wrong in ({'min_shares': 0.5}, {'min_share': -1.0}, {'min_share': nan}):
        with pytest.raises(IdentificationError, match=r'did you mean min_share|give a number'):
            POLICY.but(**wrong)


def test_a_coarse_law_states_its_inexactness() -> None:
    coarse = {(e.name, e.variant) for e in EFFECTS if e.inexactness > 0.02}
    assert ('friction', 'in_mode') in coarse
    assert ('friction', 'breaking_away') not in coarse
    assert all(0.0 < e.inexactness < 0.2 for e in EFFECTS)


def test_what_takes_less_than_a_tenth_of_the_gap_is_no_headline() -> None:
    assert not rules.reduces_gap_enough(9642.0, 9486.0, POLICY)
    assert rules.reduces_gap_enough(9642.0, 6399.0, POLICY)
    assert rules.reduces_gap_enough(0.1, 0.0, POLICY)  # all of what is beyond the noise
    assert not rules.reduces_gap_enough(8.0, 8.6, POLICY)
    assert rules.reduces_gap_enough(9642.0, 9486.0, POLICY.but(least_gap=0.001))
