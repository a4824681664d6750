"""Linear algebra that ends in finite numbers and a flag, whatever it is given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import factor, solve_normal
from piezo_hysteresis.discovery.data.tones import sine_frequency
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.identification.recursion import scaled_condition
from piezo_hysteresis.identification.solver import bounded_step, solve
from piezo_hysteresis.identification.uncertainty import covariance
from piezo_hysteresis.numerics import linalg
from piezo_hysteresis.numerics.harmonics import harmonics

BAD = (np.nan, np.inf, -np.inf)


def problem(seed: int = 1, rows: int = 40, columns: int = 5) -> Any:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((rows, columns)), rng.standard_normal(rows)


# --- what has a solution ------------------------------------------------------------------------


def test_the_least_squares_solution_is_numpys_to_the_bit() -> None:
    matrix, target = problem()
    solved = linalg.solve_least_squares(matrix, target)
    assert solved.sound
    np.testing.assert_array_equal(solved.values, np.linalg.lstsq(matrix, target)[0])


@pytest.mark.parametrize('dependent', [False, True])
def test_a_tall_matrix_has_the_solution_of_its_factor(dependent: bool) -> None:
    matrix, target = problem(rows=2000)
    if dependent:
        matrix[:, 4] = matrix[:, 3]
    kept = matrix.copy(), target.copy()
    solved = linalg.solve_least_squares(matrix, target)
    np.testing.assert_allclose(
        solved.values, np.linalg.lstsq(matrix, target)[0], rtol=1e-10, atol=1e-13
    )
    np.testing.assert_array_equal(matrix, kept[0])
    np.testing.assert_array_equal(target, kept[1])


def test_dependent_columns_get_the_smallest_solution() -> None:
    matrix, target = problem()
    matrix[:, 4] = matrix[:, 3]
    solved = linalg.solve_least_squares(matrix, target)
    assert solved.sound
    assert solved.values[3] == pytest.approx(solved.values[4])


def test_a_singular_square_gets_the_least_squares_solution() -> None:
    solved = linalg.solve_square(np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([2.0, 2.0]))
    assert solved.sound
    np.testing.assert_allclose(solved.values, [1.0, 1.0])


def test_huge_numbers_are_solved_where_lapack_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def gives_up(*_: Any, **__: Any) -> None:
        raise np.linalg.LinAlgError('SVD did not converge')

    matrix, target = problem()
    sizes = 10.0 ** np.array([-150.0, -60.0, 0.0, 60.0, 150.0])
    wanted = np.linalg.lstsq(matrix, target)[0]
    monkeypatch.setattr(np.linalg, 'lstsq', gives_up)
    solved = linalg.solve_least_squares(matrix * sizes, target)
    assert solved.sound
    np.testing.assert_allclose(solved.values * sizes, wanted, rtol=1e-10)


def test_the_length_of_a_column_does_not_overflow() -> None:
    matrix, _ = problem()
    np.testing.assert_array_equal(linalg.column_norms(matrix), np.linalg.norm(matrix, axis=0))
    huge = linalg.column_norms(1e200 * matrix)
    np.testing.assert_allclose(huge, 1e200 * np.linalg.norm(matrix, axis=0))
    matrix[3, 1] = np.inf
    assert list(np.isnan(linalg.column_norms(matrix))) == [False, True, False, False, False]


def test_a_line_is_that_of_polyfit() -> None:
    values = np.random.default_rng(2).standard_normal(301).cumsum()
    level, slope = linalg.straight_line(values)
    np.testing.assert_allclose([slope, level], np.polyfit(np.arange(301), values, 1), rtol=1e-9)


# --- what has none ------------------------------------------------------------------------------


@pytest.mark.parametrize('bad', BAD)
def test_what_is_no_number_is_unsound_and_finite(bad: Any) -> None:
    matrix, target = problem()
    spoilt, spoilt_target = matrix.copy(), target.copy()
    spoilt[7, 2], spoilt_target[3] = bad, bad
    for solved in (
        linalg.solve_least_squares(spoilt, target),
        linalg.solve_least_squares(matrix, spoilt_target),
        linalg.solve_square(spoilt[5:10], target[:5]),
    ):
        assert not solved.sound
        np.testing.assert_array_equal(solved.values, np.zeros(5))
    assert linalg.symmetric_eigen(spoilt[5:10]) is None
    assert linalg.right_singular(spoilt) is None


def test_a_solution_that_overflows_is_none() -> None:
    solved = linalg.solve_square(np.array([[1e-300]]), np.array([1e300]))
    assert not solved.sound
    assert solved.values[0] == 0.0


def test_a_failure_is_reported_with_its_subject() -> None:
    with (
        pytest.raises(CompensationError, match='scale it'),
        linalg.failing_as(CompensationError('too hard; scale it')),
    ):
        np.linalg.inv(np.zeros((2, 2)))


# --- where it is used ---------------------------------------------------------------------------


@pytest.mark.parametrize('bad', BAD)
def test_a_step_that_cannot_be_found_ends_a_fit_honestly(bad: Any) -> None:
    factor, rhs = np.eye(3), np.ones(3)
    factor[1, 2] = bad
    one = np.ones(3)
    assert np.all(np.isnan(bounded_step(factor, rhs, 1e-3 * one, -one, one)))

    class Spoilt:
        minimum_steps = np.zeros(3)

        def __init__(self, factor: FloatArray) -> None:
            self.factor = factor

        def linearise(self, x: Any) -> Any:
            return self.factor, rhs, 1.5

        def cost(self, x: Any) -> float:
            return 1.5

    done = solve(Spoilt(factor), np.zeros(3), -one, one)
    assert not done.converged
    assert 'impossible' in done.message
    np.testing.assert_array_equal(done.x, np.zeros(3))


def test_a_fit_whose_derivatives_have_no_finite_squares_is_found() -> None:
    class Steep:
        minimum_steps = np.zeros(2)

        def linearise(self, x: Any) -> Any:
            return 1e200 * np.eye(2), 1e200 * x + 1.0, self.cost(x)

        def cost(self, x: Any) -> float:
            return 0.5 * float(np.sum((1e200 * x + 1.0) ** 2))

    one = np.ones(2)
    done = solve(Steep(), np.zeros(2), -one, one)
    assert done.converged
    np.testing.assert_allclose(done.x, -1e-200 * one)


@pytest.mark.parametrize('bad', BAD)
def test_an_uncertainty_that_cannot_be_found_is_infinite(bad: Any) -> None:
    factor = np.triu(np.ones((2, 2)))
    factor[0, 1] = bad
    found = covariance(factor, 1e-4, ('a', 'b'))
    assert np.all(np.isinf(found.std))
    assert np.isinf(found.condition)
    assert found.directions == ((('a', 1.0),), (('b', 1.0),))
    assert np.isinf(scaled_condition(np.array([[1.0, bad], [bad, 1.0]])))


@pytest.mark.parametrize('bad', BAD)
def test_harmonics_of_what_is_no_number_are_none(bad: Any) -> None:
    error = np.sin(0.01 * np.arange(5000))
    error[100] = bad
    _, phasors, _ = harmonics(error, 10.0, 1e-3)
    np.testing.assert_array_equal(phasors, np.zeros(len(phasors)))
    normal = np.eye(4)
    normal[3, 1] = bad
    flat, solution = np.ravel(normal), np.empty(3)
    assert factor(flat, 3, 100.0, 0) == 4
    assert np.isinf(solve_normal(flat, 100.0, solution))
    assert np.all(solution == 0.0)


def test_a_voltage_that_stands_still_has_no_frequency() -> None:
    assert sine_frequency(np.zeros(1000), 1e-3) == 0.0
    assert sine_frequency(np.full(1000, 3.0), 1e-3) == 0.0


def test_the_normal_equations_of_many_orders_are_solved_over_several_ticks() -> None:
    rng = np.random.default_rng(3)
    basis, truth = rng.standard_normal((1000, 129)), rng.standard_normal(129)
    noise = 0.1 * rng.standard_normal(1000)
    whole = np.column_stack([basis, basis @ truth + noise])
    flat, solution = np.ravel(whole.T @ whole), np.empty(129)
    row, ticks = 0, 0
    while row < 130:
        row, ticks = factor(flat, 129, 1000.0, row), ticks + 1
    assert 10 < ticks < 100
    deviation = solve_normal(flat, 1000.0, solution)
    least = np.linalg.lstsq(basis, whole[:, -1])
    np.testing.assert_allclose(solution, least[0], rtol=1e-9)
    expected = np.sqrt(2.0 * least[1][0] / 871.0 / 1000.0)
    np.testing.assert_allclose(deviation, expected, rtol=1e-6)
