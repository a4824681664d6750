"""Linear algebra that says why it fails, exponentials, modulated harmonics."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.lines import factor, solve_normal
from piezo_hysteresis.discovery.data.tones import sine_frequency
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.identification.recursion import scaled_condition
from piezo_hysteresis.identification.solver import bounded_step, solve
from piezo_hysteresis.identification.uncertainty import covariance
from piezo_hysteresis.numerics import linalg
from piezo_hysteresis.numerics.harmonics import ModulatedLines, harmonics
from piezo_hysteresis.numerics.linalg import exponential, pace
from piezo_hysteresis.numerics.qr import orthonormal, projected_out

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


@pytest.mark.parametrize('size', [1, 2, 5, 20])
@pytest.mark.parametrize('scale', [1e-6, 0.3, 20.0])
def test_random_matrices_agree_with_scipy(size: int, scale: float) -> None:
    matrix = scale * np.random.default_rng(size).standard_normal((size, size))
    expected = expm(matrix)
    np.testing.assert_allclose(exponential(matrix), expected, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize('turned', [1e-3, 0.4, 30.0, 6e3])
def test_a_mode_turns_and_decays(turned: float) -> None:
    """States whose units differ by the square of the frequency."""
    dt, zeta = 1e-3, 1e-3
    omega = turned / dt
    rate, swing = zeta * omega, omega * np.sqrt(1 - zeta**2)
    result = exponential(dt * np.array([[0.0, 1.0], [-(omega**2), -2 * rate]]))
    decay, angle = np.exp(-rate * dt), swing * dt
    first = decay * (np.cos(angle) + rate / swing * np.sin(angle))
    assert result[0, 0] == pytest.approx(first, abs=1e-15 + 1e-13 * turned * decay)
    second = decay * np.sin(angle) / swing
    assert result[0, 1] * omega == pytest.approx(
        second * omega, abs=1e-15 + 1e-13 * turned * decay
    )


def test_a_lag_that_is_over_at_once_leaves_nothing() -> None:
    result = exponential(np.array([[-1e7, 1e7], [0.0, 0.0]]))
    np.testing.assert_allclose(result, [[0.0, 1.0], [0.0, 1.0]], atol=1e-9)


@pytest.mark.parametrize('size', [1, 2, 5])
def test_the_pace_bounds_the_eigenvalues(size: int) -> None:
    matrix = np.random.default_rng(size).standard_normal((size, size))
    largest = np.abs(np.linalg.eigvals(matrix)).max()
    assert largest <= pace(matrix) * (1 + 1e-12)
    assert pace(np.array([[0.0, 1.0], [-1e6, -1.0]])) == pytest.approx(1e3, rel=0.5)


def test_nothing_is_nothing() -> None:
    assert exponential(np.zeros((0, 0))).shape == (0, 0)
    assert pace(np.zeros((0, 0))) == 0.0


HIGHEST, DEPENDENT = 12, 1e-6
#: Of a fundamental whose period wanders.
PHASE: FloatArray = 2 * np.pi / 97.3 * np.arange(60_000.0)
PHASE += 0.2 * np.sin(PHASE / 9.7)


def laws(count: int) -> np.ndarray:
    size = np.linspace(0.3, 1.0, count) ** 2
    return np.array([np.ones(count), size, size**2])


def rows(of: np.ndarray) -> np.ndarray:
    angle = PHASE[: of.shape[1]]
    found = list(of)
    for n in range(1, HIGHEST + 1):
        for law in of:
            found += [law * np.cos(n * angle), law * np.sin(n * angle)]
    return np.array(found)


@pytest.mark.parametrize(
    'of', [laws(1500), laws(1500)[:1], np.vstack([laws(1500)[:2], 2.0 - laws(1500)[1]])],
    ids=['growing', 'steady', 'a law that depends on others'],
)  # fmt: skip
def test_sums_give_what_stored_rows_give(of: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    error = rng.standard_normal(1500) + of[-1] * np.cos(3 * PHASE[:1500])
    error -= error.mean()
    shares, left = ModulatedLines(of.copy(), PHASE[: of.shape[1]], HIGHEST, DEPENDENT).split(error)
    expected, rest = projected_out(error, orthonormal(rows(of), DEPENDENT)[1:])
    assert np.max(np.abs(left - rest)) < 1e-9
    # one order, of which all rows are orthogonal to those of the others
    orders = ModulatedLines(of.copy(), PHASE[: of.shape[1]], HIGHEST, DEPENDENT).orders
    powers = [np.bincount(orders, each**2) for each in (shares, expected)]
    assert powers[0] == pytest.approx(powers[1], rel=1e-9)


def test_memory_is_that_of_the_laws_and_not_of_the_lines() -> None:
    def peak(count: int) -> int:
        of, error, phase = laws(count), np.ones(count), PHASE[:count]
        tracemalloc.start()
        ModulatedLines(of, phase, HIGHEST, DEPENDENT).split(error)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(1000)
    assert (peak(60_000) - peak(20_000)) / 40_000 < 8 * 3  # 75 lines would be 600 bytes
