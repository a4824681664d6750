"""A curve of the sensor that bends here and there, and when it is taken for the cubic one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, ModelSpec
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.rounds import refined_candidates, select
from piezo_hysteresis.identification.sensitivities import sensitivities
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, RecordInfo

DT, COUNT, STROKE = 1e-3, 1500, 1.2e-4
BENT = {
    'spline_range': STROKE, 'spline_quadratic': 80.0, 'spline_cubic': 2e6, 'bend_high': 4e6,
    'bend_low': -3e6, 'far_bend_high': 2e7, 'far_bend_low': 1e7,
}  # fmt: skip


def reading(v: FloatArray, values: dict[str, float]) -> FloatArray:
    block = named_block('sensor_spline')
    return block.respond(v, block.pack(values), DT, state=block.initial_state(DT))


def test_without_bends_it_is_the_cubic_law() -> None:
    v = np.linspace(-STROKE, STROKE, 9)
    straight = {'spline_range': STROKE, 'spline_quadratic': 100.0, 'spline_cubic': 1e6}
    np.testing.assert_allclose(reading(v, straight), v + 100 * v**2 + 1e6 * v**3, rtol=1e-12)


@pytest.mark.parametrize('knot', [-0.6, -0.2, 0.0, 0.2, 0.6])
def test_value_slope_and_curvature_are_continuous_at_the_knots(knot: float) -> None:
    h = 1e-3 * STROKE
    left, middle, right = (
        reading(knot * STROKE + h * np.array([k - 1.0, k, k + 1.0]), BENT) for k in (-1, 0, 1)
    )
    curvatures = [float(np.diff(each, 2)[0]) / h**2 for each in (left, middle, right)]
    assert np.ptp(curvatures) < 40.0  # 1/m: as far as its slope takes it between them
    assert np.ptp([float(each[2] - each[0]) / (2 * h) for each in (left, middle, right)]) < 1e-3


def test_its_derivatives_are_exact() -> None:
    model = Model('bent', (named_block('gain'), named_block('sensor_spline')))
    values = model.defaults() | BENT | {'A1': STROKE}
    model = model.hold(spline_range=STROKE)
    p = model.pack(values)
    u = np.sin(np.linspace(0.0, 9.0, 400))
    y, rows = sensitivities(model, p, model.free_names, u, DT)
    np.testing.assert_allclose(y, model.respond(u, p, DT), atol=1e-15)
    for name, row in zip(model.free_names, rows, strict=True):
        j = model.parameter_names.index(name)
        above, below = p.copy(), p.copy()
        step = 1e-5 * max(abs(p[j]), 1e-9)
        above[j], below[j] = p[j] + step, p[j] - step
        slope = (model.respond(u, above, DT) - model.respond(u, below, DT)) / (2 * step)
        np.testing.assert_allclose(row, slope, atol=1e-6 * float(np.ptp(slope)), err_msg=name)


def scene(curve: Callable[[FloatArray], FloatArray]) -> tuple[FreeEvaluator, CandidateFit]:
    """Return the search on records of a sensor with a curve [strokes], and a baseline."""
    base = named('classical')
    values, random, records = base.defaults(), np.random.default_rng(5), []
    for amplitude, frequency in ((1.0, 2.0), (0.7, 7.0), (1.0, 19.0)):
        u = amplitude * np.sin(2 * np.pi * frequency * DT * np.arange(COUNT))
        v = base.respond(u, base.pack(values), DT)
        y = STROKE * curve(v / STROKE) + 2e-7 * random.standard_normal(COUNT)
        info = RecordInfo(excitation='sine', frequency=frequency)
        records.append(Record(f'{frequency:g} Hz', DT, u, y, info=info))
    evaluator = FreeEvaluator(split(records), 0, 1)
    return evaluator, evaluator.refit(evaluator.evaluated(ModelSpec(base, values)))


def fitted(variant: str, evaluator: FreeEvaluator, start: CandidateFit) -> CandidateFit:
    (found,) = [c for c in refined_candidates(evaluator, start) if c.effect.variant == variant]
    fit = evaluator.fit(start.with_candidate(found, found.values(start.values, found.starts[0])))
    assert fit is not None
    return fit


@pytest.mark.component
@pytest.mark.parametrize(
    'curve',
    [lambda y: y + 0.15 * y * np.abs(y), lambda y: y + 0.1 * np.tanh(3.0 * y)],
    ids=['square', 'tanh'],
)
def test_what_a_cubic_curve_leaves_a_spline_takes(
    curve: Callable[[FloatArray], FloatArray],
) -> None:
    evaluator, start = scene(curve)
    assert fitted('sensor_nonlinearity', evaluator, start).floors > 1.5
    contest = select(evaluator, start, start, lambda fraction, message: None)
    assert contest is not None
    assert contest.accepted
    assert contest.best.variant == 'sensor_spline'
    assert contest.best.floors < 1.1
    # and then no plainer way of it competes
    names = [c.effect.variant for c in refined_candidates(evaluator, contest.best)]
    assert 'sensor_nonlinearity' not in names
    assert 'sensor_spline' not in names


def test_where_a_cubic_curve_is_enough_it_wins_by_what_a_spline_costs() -> None:
    evaluator, start = scene(lambda y: y + 0.05 * y**2 + 0.05 * y**3)
    assert fitted('sensor_spline', evaluator, start).floors < 1.05
    contest = select(evaluator, start, start, lambda fraction, message: None)
    assert contest is not None
    assert contest.accepted
    assert contest.best.variant == 'sensor_nonlinearity'
    assert contest.best.floors < 1.05
