"""Solver, objective, sums over threads and searches on problems whose end is known."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import fit
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.global_search import METHODS, search
from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.identification.solver import Problem, bounded_step, solve
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.models.simulation.plan import LinearStage
from piezo_hysteresis.numerics.qr import triangle
from piezo_hysteresis.records import Record, RecordInfo


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


class Limited(Problem):
    """The valley, in micrometres, next to a limit far away that acts below 10 only."""

    minimum_steps = np.zeros(3)

    def _residual(self, x: np.ndarray) -> np.ndarray:
        return 1e-6 * np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], min(x[2] - 10.0, 0.0)])

    def cost(self, x: np.ndarray) -> float:
        r = self._residual(x)
        return 0.5 * float(r @ r)

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        acts = float(x[2] < 10.0)
        rows = 1e-6 * np.array([[-20 * x[0], 10.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, acts]])
        q, factor = np.linalg.qr(rows)
        return factor, q.T @ self._residual(x), self.cost(x)


@pytest.mark.parametrize('limit', [1e5, 9.0])
def test_a_limit_that_is_never_reached_does_not_end_the_fit_of_the_others(limit: float) -> None:
    """Its value of 1e5 once counted as the size of the unknowns: every step was negligible."""
    far = np.array([10.0, 10.0, 1e5])
    found = solve(Limited(), np.array([-1.2, 1.0, limit]), -far, far)
    np.testing.assert_allclose(found.x, [1.0, 1.0, max(limit, 10.0)], atol=1e-6)


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


DT = 1e-3
BEGINS = RecordStart('estimate', (0.7,))


@pytest.mark.parametrize('own_zero', [False, True])
@pytest.mark.parametrize('name', ['bouc_wen_mode', 'prandtl_ishlinskii'])
def test_cost_and_linearisation_agree_where_the_start_is_estimated(
    name: str, own_zero: bool
) -> None:
    rng = np.random.default_rng(3)
    t = np.arange(800) * DT
    u = np.sin(2 * np.pi * 5 * t + 1.0)
    y = 4e-5 * np.sin(2 * np.pi * 5 * t + 0.9) + 1e-6 * rng.standard_normal(t.size)
    record = Record('r', DT, u, y)
    model = suited(named(name), [record])
    target = replace(whole(record, begins=BEGINS), own_zero=own_zero)
    target = replace(target, influence=rng.uniform(0.3, 1.0, target.measured.size))
    free = (*model.free_names, SAMPLING_OFFSET)
    values = {**model.defaults(), SAMPLING_OFFSET: 2e-4}
    objective = Objective(model, [target], free, values)
    x = np.array([values[each] for each in free])
    squares = objective.linearise(x)[2]
    assert objective.cost(x) == pytest.approx(squares, rel=1e-9)
    assert squares > 0.0


def test_a_fit_does_not_reach_modes_far_above_the_sampling_rate() -> None:
    model = named('bouc_wen_oscillator')
    record = Record('r', DT, np.sin(0.1 * np.arange(400)), 1e-5 * np.sin(0.1 * np.arange(400)))
    values = {**model.defaults(), SAMPLING_OFFSET: 0.0}
    objective = Objective(model, [whole(record)], ('mass',), values)
    assert np.isfinite(objective.cost(np.array([values['mass']])))
    for mass, allowed in ((7e-5, True), (5e-5, False)):  # 29 and 38 thousand per second
        assert np.isfinite(objective.cost(np.array([mass]))) == allowed
        assert np.isfinite(objective.linearise(np.array([mass]))[2]) == allowed
    # a mode that is known to be fast stays one
    known = Objective(model, [whole(record)], ('stiffness',), {**values, 'mass': 1e-6})
    assert np.isfinite(known.cost(np.array([values['stiffness']])))


@pytest.mark.parametrize(
    ('columns', 'samples'), [(1, 1), (5, 3), (6, 6), (9, 700), (23, 512), (50, 1300)]
)
def test_a_triangle_is_that_of_all_its_pieces(columns: int, samples: int) -> None:
    rows = np.random.default_rng(columns).standard_normal((columns, samples))
    if columns > 2:
        rows[1] = 0.0
    products = rows @ rows.T
    found = triangle(rows.copy())
    assert np.all(np.tril(found, -1) == 0.0)
    np.testing.assert_allclose(found.T @ found, products, atol=1e-12 * samples)


@pytest.mark.parametrize('names', [('mode', 'creep_pair'), ('transport_delay', 'mode', 'creep')])
@pytest.mark.parametrize('many', [1, 3, 4, 6])
def test_inputs_that_are_carried_together_have_the_bits_of_each(
    names: tuple[str, ...], many: int
) -> None:
    dt, model = 1e-3, Model('row', tuple(BLOCKS[name] for name in names))
    given = {'delay': 2.3e-3, 'natural_frequency': 90.0, 'creep_share': 0.2, 'creep_time': 0.05}
    packed = model.pack({k: v for k, v in given.items() if k in model.parameter_names})
    (stage,) = model.stages
    assert isinstance(stage, LinearStage)
    p = packed[stage.columns]
    signals = np.random.default_rng(many).standard_normal((many, 90))
    alone = [
        stage.respond(row, p, dt, state=stage.initial_state(dt, 0.0), frequency=0.0)
        for row in signals
    ]
    assert np.array_equal(stage.carried(signals, p, dt), np.array(alone))


def test_a_thread_pool_keeps_the_order_and_the_requested_size() -> None:
    seen = set()

    def square(value: Any) -> Any:
        seen.add(threading.current_thread().name)
        return value * value

    assert of_each(square, range(40), 3) == [value * value for value in range(40)]
    assert len(seen) <= 3
    assert of_each(square, [2], 3) == [4]


def test_a_fit_is_the_same_with_any_number_of_threads() -> None:
    model, dt = named('classical'), 1e-3
    true = model.pack({'beta': 0.03})
    records = []
    for frequency in (3.0, 5.0, 8.0):
        voltage = 60.0 * np.sin(2 * np.pi * frequency * dt * np.arange(900))
        noise = 1e-9 * np.random.default_rng(int(frequency)).standard_normal(900)
        measured = model.respond(voltage, true, dt) + noise
        info = RecordInfo(frequency=frequency)
        records.append(Record(f'{frequency:g} Hz', dt, voltage, measured, info=info))
    one, three = (fit(model, records, workers=workers) for workers in (1, 3))
    assert one.values == three.values
    assert one.cost == three.cost


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
