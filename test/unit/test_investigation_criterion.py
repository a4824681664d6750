"""Expected information of an experiment, in plain numbers."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.investigation.experiment_choice import (
    LARGEST,
    SMALLEST,
    detection_probability,
    discrimination,
    entropy,
    hidden_share,
)


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
