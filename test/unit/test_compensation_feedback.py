"""Feedback links: they control, and they stop where they would do harm."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.feedback.feedback_link import OWN, HInfinityWeights
from piezo_hysteresis.compensation.feedback.hinf import (
    GeneralizedPlant,
    HInfinity,
    StateSpace,
    design,
    hinf_synthesis,
    mixed_sensitivity,
    transfer_function,
)
from piezo_hysteresis.compensation.feedback.pid import (
    INTEGRAL_RULES,
    LEVELS,
    PROPORTIONAL_RULES,
    FuzzyPid,
    FuzzyRules,
    Pid,
    PidGains,
    level,
    plain,
    read_tables,
)
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.offline_loop import ModelPlant, closed_loop, tracking_metrics
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.named import named
from piezo_hysteresis.waveforms import Sine
from piezo_hysteresis.waveforms.waveform import Samples

DT = 1e-3
LIMITS = Limits(-1.0, 1.0, 1e4)
VALUES = {'A1': 150e-6, 'A': 40e-6, 'A0': 0.0, 'beta': 1.0, 'gamma': 0.1, 'offset': 6e-6}
GAINS = PidGains(proportional=1e3, integral=2e6)
# Xiao 2014 (4); its DC gain reads as mm per volt at the actuator.
XIAO_NUMERATOR = (1135e-3, 35770e-3)
XIAO_DENOMINATOR = (1.0, 3960.0, 5.046e6, 1.452e8)


def constant(level: float, seconds: float = 2.0) -> list[Any]:
    return [ReferencePoint(k, level, 0.0, 0.0, 0.0, 0.0) for k in range(round(seconds / DT))]


def sine(frequency: float, amplitude: float, seconds: float, dt: Any = DT) -> Samples:
    time = np.arange(round(seconds / dt)) * dt
    return Sine(amplitude, frequency, seconds, ramp=0.5).sample(time)


class Wired:
    """A static plant whose wires may be crossed."""

    def __init__(self, gain: Any = 100e-6) -> None:
        self.gain, self.held = gain, 0.0

    def exchange(self, voltage: Any) -> Any:
        reading, self.held = self.gain * self.held, voltage
        return reading


def make_pid(**options: Any) -> Pid:
    return Pid(GAINS, DT, limits=LIMITS, **options)


def make_fuzzy(**options: Any) -> FuzzyPid:
    rules = FuzzyRules(5e-6, 1e-3, 5e2, 1e6)
    return FuzzyPid(GAINS, rules, DT, limits=LIMITS, **options)


def make_hinf(**options: Any) -> HInfinity:
    plant = transfer_function([100e-6 * 3000.0], [1.0, 3000.0])
    controller = design(plant, HInfinityWeights(20.0, control=1.0), DT).controller
    return HInfinity(controller, DT, limits=LIMITS, **options)


MAKERS = {'pid': make_pid, 'fuzzy': make_fuzzy, 'hinf': make_hinf}


@pytest.mark.parametrize('kind', MAKERS)
def test_a_constant_error_is_integrated_away(kind: Any) -> None:
    plant = ModelPlant(named('classical'), VALUES, DT)
    result = closed_loop(constant(50e-6), [MAKERS[kind]()], plant, LIMITS, DT)
    assert abs(result.error[-1]) < 0.2e-6
    assert result.counters['limiter']['out_of_range'] == 0


@pytest.mark.parametrize('kind', MAKERS)
def test_a_plant_of_the_wrong_sign_is_detected_and_not_driven(kind: Any) -> None:
    result = closed_loop(sine(2.0, 50e-6, 4.0), [MAKERS[kind]()], Wired(-100e-6), LIMITS, DT)
    (name,) = (key for key in result.counters if key != 'limiter')
    assert result.counters[name]['inverted_plant'] == 1
    assert not result.voltage[-1000:].any()
    right = closed_loop(sine(2.0, 50e-6, 4.0), [MAKERS[kind]()], Wired(), LIMITS, DT)
    assert right.counters[name]['inverted_plant'] == 0
    assert tracking_metrics(right, 2.0).rms < 5e-6


def test_a_loop_that_swings_between_the_limits_is_switched_off() -> None:
    values = {**VALUES, 'natural_frequency': 68.0, 'damping_ratio': 0.015}
    plant = ModelPlant(named('bouc_wen_mode'), values, DT)
    wild = Pid(PidGains(integral=2e6), DT, limits=LIMITS)
    result = closed_loop(constant(50e-6, 6.0), [wild], plant, LIMITS, DT)
    assert result.counters['0_pid']['diverged'] == 1
    assert not result.voltage[-1000:].any()
    assert np.ptp(result.displacement[-500:]) < 1e-6


@pytest.mark.parametrize('kind', MAKERS)
@pytest.mark.parametrize('reading', [None, math.nan])
def test_a_lost_sensor_leaves_the_voltage_where_it_was(kind: Any, reading: float | None) -> None:
    link, plant = MAKERS[kind](), Wired()
    measured, path = None, []
    for point in constant(40e-6, 3.0):
        voltage = link.step(point, 0.0, measured)
        y = plant.exchange(voltage)
        path.append(voltage)
        measured = Measured(point.sample, voltage, y)
        if point.sample > 1500:
            measured = None if reading is None else Measured(point.sample, voltage, reading)
    assert path[-1] == pytest.approx(path[1500], abs=0.01)
    assert link.counters()['missing' if reading is None else 'not_finite'] > 1000


def test_anti_windup_comes_back_at_once() -> None:
    wanted = [*constant(250e-6, 2.0)]
    wanted += [p._replace(sample=p.sample + 2000, displacement=50e-6) for p in constant(0, 1.0)]
    calm = Pid(PidGains(integral=2e5, tracking_time=0.01), DT, limits=LIMITS)
    lazy = Pid(PidGains(integral=2e5, tracking_time=1e6), DT, limits=LIMITS)
    errors = []
    for link in (calm, lazy):
        result = closed_loop(wanted, [link], Wired(), LIMITS, DT)
        errors.append(np.abs(result.error[2150:2300]).max())
    assert errors[0] < 0.1 * errors[1]


def test_derivative_is_low_passed() -> None:
    link = Pid(PidGains(integral=0.0, derivative=1.0, derivative_filter=10e-3), DT)

    def law(error: float) -> float:
        return plain(error, link.memory[OWN:], link.packed, DT)

    assert law(1.0) == 0.0
    link.reset()
    law(0.0)
    kick = law(1.0)
    decay = [law(1.0) for _ in range(60)]
    assert kick == pytest.approx(2.0 / (20e-3 + 1e-3))
    assert decay[9] == pytest.approx(kick * (19.0 / 21.0) ** 10)


def test_new_gains_do_not_make_the_output_jump() -> None:
    link, plant = make_pid(), Wired()
    measured, path = None, []
    for point in constant(40e-6, 1.0):
        if point.sample == 15:
            link.set_gains(PidGains(proportional=3e3, integral=2e6))
        path.append(link.step(point, 0.0, measured))
        measured = Measured(point.sample, path[-1], plant.exchange(path[-1]))
    assert abs(path[15] - path[14]) < 2.0 * abs(path[14] - path[13]) + 1e-3


@pytest.mark.parametrize(
    'wrong', [{'proportional': -1.0}, {'integral': math.nan}, {'derivative_filter': 0.0}]
)
def test_impossible_gains_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(CompensationError):
        PidGains(**wrong)


def triangle(level: Any, x: Any) -> Any:
    return max(0.0, 1.0 - abs(3.0 * x - level))


@pytest.mark.parametrize('rules', [PROPORTIONAL_RULES, INTEGRAL_RULES])
def test_fuzzy_inference_is_that_of_49_rules(rules: Any) -> None:
    for x, y in itertools.product(np.linspace(-1, 1, 17), repeat=2):
        weights = [[triangle(i - 3, x) * triangle(j - 3, y) for j in range(7)] for i in range(7)]
        expected = float(np.sum(np.array(weights) * rules)) / 3.0 / np.sum(weights)
        assert level(np.ravel(rules), x, y) == pytest.approx(expected, abs=1e-12)
    assert level(np.ravel(rules), 5.0, -7.0) == level(np.ravel(rules), 1.0, -1.0)


@pytest.mark.parametrize('rules', [PROPORTIONAL_RULES, INTEGRAL_RULES])
def test_rule_tables_do_not_prefer_a_sign(rules: Any) -> None:
    np.testing.assert_array_equal(rules, rules[::-1, ::-1])
    assert np.abs(rules).max() == 3


def test_fuzzy_pid_without_ranges_is_the_pid() -> None:
    flat = FuzzyPid(GAINS, FuzzyRules(1e-6, 1e-3, 0.0, 0.0), DT, limits=LIMITS)
    first, second = (
        closed_loop(sine(3.0, 50e-6, 1.0), [link], Wired(), LIMITS, DT).voltage
        for link in (flat, make_pid())
    )
    assert np.array_equal(first, second)


def xiao() -> StateSpace:
    return transfer_function(XIAO_NUMERATOR, XIAO_DENOMINATOR)


def test_transfer_function_keeps_the_numbers_of_003() -> None:
    plant = xiao()
    assert plant.gain(0.0)[0, 0].real == pytest.approx(2.4635e-7, rel=1e-4)
    s = 2j * np.pi * 60.0
    direct = np.polyval(XIAO_NUMERATOR, s) / np.polyval(XIAO_DENOMINATOR, s)
    assert plant.gain(60.0)[0, 0] == pytest.approx(direct, rel=1e-9)


def closed_norm(
    problem: GeneralizedPlant, controller: StateSpace, frequencies: FloatArray
) -> float:
    """Return the largest gain from w to z, by the frequency response."""
    p, worst = problem, 0.0
    whole = StateSpace(p.a, np.hstack([p.b1, p.b2]), np.vstack([p.c1, p.c2]), np.block([
        [np.zeros((len(p.c1), p.b1.shape[1])), p.d12],
        [p.d21, np.zeros((len(p.c2), p.b2.shape[1]))]]))  # fmt: skip
    z, w = len(p.c1), p.b1.shape[1]
    for frequency in frequencies:
        g, k = whole.gain(frequency), controller.gain(frequency)
        inner = np.linalg.solve(np.eye(len(k)) - k @ g[z:, w:], k @ g[z:, :w])
        worst = max(worst, float(np.linalg.norm(g[:z, :w] + g[:z, w:] @ inner, 2)))
    return worst


def closed_poles(problem: GeneralizedPlant, k: StateSpace) -> np.ndarray:
    p = problem
    return np.linalg.eigvals(np.block([[p.a, p.b2 @ k.c], [k.b @ p.c2, k.a]]))


def random_problem(seed: Any) -> GeneralizedPlant:
    random = np.random.default_rng(seed)
    n = 4
    return GeneralizedPlant(
        a=random.normal(size=(n, n)),
        b1=random.normal(size=(n, 3)),
        b2=random.normal(size=(n, 1)),
        c1=random.normal(size=(3, n)),
        c2=random.normal(size=(1, n)),
        d12=random.normal(size=(3, 1)),
        d21=random.normal(size=(1, 3)),
    )


@pytest.mark.parametrize('seed', range(6))
def test_synthesis_keeps_its_promise_on_random_plants_with_cross_terms(seed: Any) -> None:
    problem = random_problem(seed)
    controller, gamma = hinf_synthesis(problem)
    assert closed_poles(problem, controller).real.max() < 0
    reached = closed_norm(problem, controller, np.logspace(-4, 4, 1500))
    assert reached <= gamma * 1.001


def test_synthesis_reaches_the_known_optimum_of_a_scalar_problem() -> None:
    # x' = a x + w1 + u, z = (x, u), y = x + w2: gamma follows from the two scalar Riccati
    # equations and the coupling condition x y = gamma^2.
    a = -1.0
    one = np.ones((1, 1))
    problem = GeneralizedPlant(
        a=a * one, b1=np.array([[1.0, 0.0]]), b2=one, c1=np.array([[1.0], [0.0]]), c2=one,
        d12=np.array([[0.0], [1.0]]), d21=np.array([[0.0, 1.0]]),
    )  # fmt: skip
    _, gamma = hinf_synthesis(problem, tolerance=1e-6, margin=1.0 + 1e-6)

    def coupling(g: float) -> float:
        r = 1.0 - g**-2
        x = (a + math.sqrt(a * a + r)) / r if r else -1.0 / (2 * a)
        return x * x - g * g

    low, high = math.sqrt(0.5) + 1e-9, 5.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if coupling(middle) > 0 else (low, middle)
    assert gamma == pytest.approx(high, rel=1e-4)


@pytest.mark.slow
def test_synthesis_agrees_with_slycot(monkeypatch: pytest.MonkeyPatch) -> None:
    # Its own threads would wait for each other: 130 s on two cores, and 4 s with one.
    monkeypatch.setenv('OPENBLAS_NUM_THREADS', '1')
    import control

    for seed in range(3):
        p = random_problem(seed)
        plant = control.ss(
            p.a,
            np.hstack([p.b1, p.b2]),
            np.vstack([p.c1, p.c2]),
            np.block([[np.zeros((3, 3)), p.d12], [p.d21, np.zeros((1, 1))]]),
        )
        theirs = control.hinfsyn(plant, 1, 1)[2]
        _, ours = hinf_synthesis(p, margin=1.0 + 1e-6)
        assert ours == pytest.approx(theirs, rel=2e-3)


def test_impossible_problems_are_refused() -> None:
    p = random_problem(0)
    singular = GeneralizedPlant(p.a, p.b1, p.b2, p.c1, p.c2, 0 * p.d12, p.d21)
    with pytest.raises(CompensationError, match='singular'):
        hinf_synthesis(singular)
    unstable = StateSpace(np.array([[1.0]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    with pytest.raises(CompensationError, match='stable'):
        design(unstable, HInfinityWeights(10.0), DT)
    with pytest.raises(CompensationError):
        HInfinityWeights(bandwidth=0.0)


@pytest.mark.parametrize(
    ('weights', 'says'),
    [
        (HInfinityWeights(500.0), 'beyond half the sampling rate, 500 Hz'),
        (HInfinityWeights(200.0), 'gamma is 2.08 and should be 1 or less; lower the bandwidth'),
        (HInfinityWeights(20.0, control=0.1), 'would be unstable .a pole at 1.08'),
    ],
)
def test_a_controller_below_its_specification_is_refused(weights: Any, says: str) -> None:
    with pytest.raises(CompensationError, match=says):
        design(xiao(), weights, DT).require_usable()


def test_a_design_reports_gamma_and_poles() -> None:
    found = design(xiao(), HInfinityWeights(20.0), DT)
    assert found.met
    assert found.stable
    assert found.gamma == pytest.approx(0.765, abs=0.01)
    assert np.all(np.diff(np.abs(found.poles)) <= 0)
    assert found.words().startswith('H-infinity: gamma 0.76')


def test_h_infinity_on_003s_plant_keeps_gamma_and_beats_feedforward() -> None:
    dt = 1e-4
    found = design(xiao(), HInfinityWeights(120.0), dt).require_usable()
    controller = found.controller
    assert 'weights met' in found.words()
    problem = mixed_sensitivity(xiao(), HInfinityWeights(120.0), dt)
    assert problem.d21.shape == (1, 1)

    class Linear:
        def __init__(self) -> None:
            from scipy.signal import cont2discrete

            g = xiao()
            self.a, self.b, self.c, _, _ = cont2discrete((g.a, g.b, g.c, g.d), dt)
            self.x = np.zeros(3)

        def exchange(self, voltage: Any) -> float:
            y = float(self.c[0] @ self.x)
            self.x = self.a @ self.x + self.b[:, 0] * voltage
            return y

    limits = Limits(-20.0, 140.0, 1e9)
    wanted = sine(20.0, 5e-6, 1.5, dt)
    plain = inverse_for(named('linear_mode'), {
        'A1': 2.4635e-7, 'natural_frequency': 353.0, 'damping_ratio': 0.885, 'offset': 0.0,
    }, dt)  # fmt: skip
    alone = closed_loop(wanted, [plain], Linear(), limits, dt)
    plain.reset()
    link = HInfinity(controller, dt, limits=limits)
    both = closed_loop(wanted, [plain, link], Linear(), limits, dt)
    before, after = tracking_metrics(alone, 1.0).rms, tracking_metrics(both, 1.0).rms
    assert after < 0.5 * before
    assert link.counters()['diverged'] == 0


TABLES = Path(__file__).resolve().parents[2] / 'config' / 'fuzzy' / 'symmetric.yaml'


def test_the_tables_of_the_file_are_those_that_it_has_by_itself() -> None:
    read = read_tables(TABLES)
    np.testing.assert_array_equal(read['proportional_rules'], PROPORTIONAL_RULES)
    np.testing.assert_array_equal(read['integral_rules'], INTEGRAL_RULES)


def test_tables_of_a_user_are_obeyed(tmp_path: Path) -> None:
    rows = {level: [2] * 7 for level in LEVELS}
    (tmp_path / 'mine.yaml').write_text(
        yaml.safe_dump({'proportional': {**rows, 'PB': ['PB'] * 7}, 'integral': rows})
    )
    read = read_tables(tmp_path / 'mine.yaml')
    assert level(np.ravel(read['proportional_rules']), 1.0, 0.0) == 1.0
    assert level(np.ravel(read['integral_rules']), 0.3, -0.7) == pytest.approx(2 / 3)
    scales = (5e-6, 1e-3, 5e2, 1e6)
    links = [
        FuzzyPid(PidGains(1e3, 2e6), rules, 1e-3)
        for rules in (FuzzyRules(*scales, **read), FuzzyRules(*scales))
    ]
    wanted = 20e-6 * np.sin(2 * np.pi * 5 * np.arange(200) * 1e-3)
    one, other = [
        [
            link.step(
                ReferencePoint(k, float(d), 0.0, 0.0, 5.0, 0.0), 0.0, Measured(k - 1, 0.0, 0.0)
            )
            for k, d in enumerate(wanted)
        ]
        for link in links
    ]
    assert np.max(np.abs(np.subtract(one, other))) > 1e-6


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda c: c.pop('integral'), 'mapping of proportional and integral'),
        (lambda c: c['integral'].pop('ZO'), 'one row for each error NB'),
        (lambda c: c['integral'].update(ZO=[1, 2]), 'integral ZO lists 7 levels'),
        (lambda c: c['integral']['ZO'].__setitem__(0, 'XX'), "'XX' is no level"),
        (lambda c: c['integral']['ZO'].__setitem__(0, 4), '4 is no level'),
        (lambda c: c['integral']['ZO'].__setitem__(0, True), 'True is no level'),
    ],
)
def test_errors_in_tables_are_reported(
    change: Callable[..., Any], says: str, tmp_path: Path
) -> None:
    content = yaml.safe_load(TABLES.read_text())
    change(content)
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump(content))
    with pytest.raises(CompensationError, match=says):
        read_tables(tmp_path / 'mine.yaml')
    with pytest.raises(CompensationError, match='cannot be read: the path does not exist'):
        read_tables(tmp_path / 'none.yaml')
