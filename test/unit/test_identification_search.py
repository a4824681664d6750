"""Searches: they find known minima, are seeded, stay in their box and count honestly."""

import numpy as np
import pytest

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.global_search import METHODS, search

LOW, HIGH = np.array([-2.0, -1.0, 0.0]), np.array([2.0, 3.0, 50.0])


def bowl(x: np.ndarray) -> float:
    return float((x[0] - 0.5) ** 2 + (x[1] - 1.0) ** 2 + 0.01 * (x[2] - 7.0) ** 2) + 1e-9


def valley(x: np.ndarray) -> float:
    return float(100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2) + 1e-9


@pytest.mark.parametrize('method', METHODS)
def test_finds_the_bottom_of_a_bowl(method: str) -> None:
    found = search(bowl, LOW, HIGH, method=method, seed=1, max_evaluations=6000)
    np.testing.assert_allclose(found.x, [0.5, 1.0, 7.0], atol=2e-3)
    assert found.cost == bowl(found.x)
    assert list(found.history) == sorted(found.history, reverse=True)


@pytest.mark.parametrize('method', ['pso', 'de'])
def test_follows_a_curved_valley(method: str) -> None:
    found = search(valley, np.full(2, -2.0), np.full(2, 2.0), method=method, seed=2)
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-2)


@pytest.mark.parametrize('method', METHODS)
def test_same_seed_same_answer_other_seed_other_way(method: str) -> None:
    one, same, other = (
        search(bowl, LOW, HIGH, method=method, seed=seed, max_evaluations=300)
        for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(one.x, same.x)
    assert one.history == same.history
    assert one.history != other.history


@pytest.mark.parametrize('method', METHODS)
def test_stays_in_the_box_and_in_the_budget(method: str) -> None:
    seen: list[np.ndarray] = []

    def cost(x: np.ndarray) -> float:
        seen.append(x.copy())
        return float(x.sum())

    found = search(cost, LOW, HIGH, method=method, max_evaluations=500)
    points = np.array(seen)
    assert np.all(points >= LOW - 1e-12)
    assert np.all(points <= HIGH + 1e-12)
    assert len(seen) == found.evaluations <= 500
    assert np.all(found.x - LOW < 0.1 * (HIGH - LOW))


@pytest.mark.parametrize('method', METHODS)
def test_impossible_points_are_survived(method: str) -> None:
    def cost(x: np.ndarray) -> float:
        return bowl(x) if x[0] > 0 else float('inf')

    found = search(cost, LOW, HIGH, method=method, seed=3, max_evaluations=4000)
    assert found.x[0] > 0
    assert found.cost < 1e-2


def test_an_unfinished_search_is_reported() -> None:
    found = search(valley, np.full(2, -2.0), np.full(2, 2.0), max_evaluations=30)
    assert not found.converged
    assert '30 evaluations' in found.message


def test_wrong_arguments_are_named() -> None:
    with pytest.raises(IdentificationError, match='pso'):
        search(bowl, LOW, HIGH, method='ants')
    with pytest.raises(IdentificationError, match='finite bounds'):
        search(bowl, LOW, np.array([2.0, np.inf, 1.0]))
    with pytest.raises(IdentificationError, match='impossible'):
        search(lambda _: float('inf'), LOW, HIGH, max_evaluations=100)
