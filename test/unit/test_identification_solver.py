"""The solver on problems whose end is known."""

import numpy as np
import pytest

from piezo_hysteresis.identification.solver import Problem, bounded_step, solve


class Rosenbrock(Problem):
    """The classic curved valley, as least squares."""

    minimum_steps = np.zeros(2)

    def cost(self, x: np.ndarray) -> float:
        r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        return 0.5 * float(r @ r)

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        q, factor = np.linalg.qr(np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]))
        return factor, q.T @ r, self.cost(x)


class Stairs(Problem):
    """A slope in x[1] at the place that x[0] says in whole steps; its derivative spans a step."""

    minimum_steps = np.array([1.0, 0.0])

    def _residual(self, x: np.ndarray) -> np.ndarray:
        place = np.floor(x[0])
        return np.array([3.0 * (place - 4.0), x[1] - place])

    def cost(self, x: np.ndarray) -> float:
        r = self._residual(x)
        return 0.5 * float(r @ r)

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        rows = np.array([[3.0, 0.0], [-1.0, 1.0]])
        q, factor = np.linalg.qr(rows)
        return factor, q.T @ self._residual(x), self.cost(x)


class Remainder(Problem):
    """A line that comes to 2 at best and begins at 2.5."""

    minimum_steps = np.zeros(1)

    def cost(self, x: np.ndarray) -> float:
        return 0.5 * float((x[0] - 1.0) ** 2) + 2.0

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        return np.eye(1), x - 1.0, self.cost(x)


def test_the_solver_takes_what_moves_by_whole_steps_over_their_edges() -> None:
    low, high = np.full(2, -9.0), np.full(2, 9.0)
    for begin in (3.1, 0.7, 4.9, 8.2):
        found = solve(Stairs(), np.array([begin, 0.0]), low, high)
        assert np.floor(found.x[0]) == 4.0
        assert found.x[1] == pytest.approx(4.0)


def test_the_solver_finds_the_valley_and_the_bound() -> None:
    far = np.full(2, 10.0)
    free = solve(Rosenbrock(), np.array([-1.2, 1.0]), -far, far)
    np.testing.assert_allclose(free.x, [1.0, 1.0], atol=1e-7)
    assert free.converged
    bounded = solve(Rosenbrock(), np.array([-1.2, 1.0]), -far, np.array([0.5, 10.0]))
    np.testing.assert_allclose(bounded.x, [0.5, 0.25], atol=1e-7)
    assert bounded.at_bound == (True, False)
    assert list(bounded.history) == sorted(bounded.history, reverse=True)


def test_the_solver_gives_up_what_cannot_be_of_use() -> None:
    far, begin = np.full(2, 10.0), np.array([-1.2, 1.0])
    whole = solve(Rosenbrock(), begin, -far, far)
    assert solve(Rosenbrock(), begin, -far, far, enough=1e-3).history == whole.history
    low, high, start = np.array([-9.0]), np.array([9.0]), np.array([0.0])
    followed = solve(Remainder(), start, low, high, enough=2.1)
    assert followed.converged
    assert followed.cost == pytest.approx(2.0)
    left = solve(Remainder(), start, low, high, enough=1.4)
    assert not left.converged
    assert 'gave up' in left.message
    assert left.evaluations == 1


def test_the_solver_ends_between_steps_where_the_time_is_over() -> None:
    far, answers = np.full(2, 10.0), iter([False, False, True])
    found = solve(Rosenbrock(), np.array([-1.2, 1.0]), -far, far, stopped=lambda: next(answers))
    assert not found.converged
    assert 'time is over' in found.message
    assert len(found.history) <= 3


def test_the_unit_of_an_unknown_does_not_matter() -> None:
    """Beside volts a curve in 1/m^2 acts by columns a million million times as small."""
    random = np.random.default_rng(3)
    matrix, wanted = random.standard_normal((40, 3)), np.array([1.0, -2.0, 0.5])
    for unit in (1e-18, 1.0, 1e18):
        sizes = np.array([1.0, 1.0, unit])
        _, factor = np.linalg.qr(matrix * sizes)
        rhs = -factor @ (wanted / sizes)
        step = bounded_step(factor, rhs, np.zeros(3), np.full(3, -np.inf), np.full(3, np.inf))
        assert step * sizes == pytest.approx(wanted, rel=1e-9)
