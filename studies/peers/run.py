"""One peer on one task of the leaderboard, in the environment of the peer.

    PYTHON studies/peers/run.py TOOL TASK.npz ANSWER.npz

The task holds ``voltage_0, displacement_0`` of the training record and those of the test records.
Samples that are kept from a peer are NaN. The answer holds the free run over every test record.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Task:
    """What a peer knows."""

    dt: float  # sampling interval [s]
    period: int  # samples in one cycle of the training voltage; 0 if it is no sine
    voltage: Sequence[Array]
    displacement: Sequence[Array]
    half_ranges: tuple[float, float]
    middles: tuple[float, float]
    quick: bool  # whether iterations are few
    periods: int  # steady periods that the training record consists of; 0 if unknown

    @property
    def known(self) -> tuple[Array, Array]:
        """Voltage and displacement to fit."""
        known = np.isfinite(self.displacement[0])
        return self.voltage[0][known], self.displacement[0][known]

    @property
    def period_mean(self) -> tuple[Array, Array]:
        """Voltage and displacement to fit; of steady periods their mean."""
        u, y = self.known
        if not self.periods:
            return u, y
        return u.reshape(self.periods, -1)[0], y.reshape(self.periods, -1).mean(0)


@dataclass(frozen=True)
class Answer:
    """Free runs in the units of the task, number of fitted parameters, and the settings."""

    runs: Sequence[Array]
    parameters: int
    words: str


def read(path: Path) -> Task:
    """Return the task of a file."""
    with np.load(path) as file:
        count = int(file['count'])
        volts = [file[f'voltage_{i}'] for i in range(count)]
        metres = [file[f'displacement_{i}'] for i in range(count)]
        dt, period, quick = float(file['dt']), int(file['period']), bool(file['quick'])
        periods = int(file['periods'])
    ranges, middles = [], []
    for signal in (volts[0][np.isfinite(metres[0])], metres[0][np.isfinite(metres[0])]):
        ranges.append(float(np.ptp(signal)) / 2)
        middles.append(float(np.max(signal) + np.min(signal)) / 2)
    return Task(
        dt,
        period,
        [(u - middles[0]) / ranges[0] for u in volts],
        [(y - middles[1]) / ranges[1] for y in metres],
        (ranges[0], ranges[1]),
        (middles[0], middles[1]),
        quick,
        periods,
    )


def begins_at(y: Array) -> int:
    """Return the last known sample, from which a free run of a test starts; 0 if none is."""
    known = np.flatnonzero(np.isfinite(y))
    return int(known[-1]) if known.size else 0


def rms(x: Array) -> float:
    """Return the rms, infinite where a run diverged."""
    return float(np.sqrt(np.mean(x**2))) if np.all(np.isfinite(x)) else float('inf')


# PySINDy: dy/dt of the library y, u, du/dt, |du/dt|, |y| (Chandra and others, 2023)

#: Of the published equation, in um, V and s: 1, y, u, du/dt, y |y|.
PUBLISHED = (-0.176, -2.388, 0.581, 0.119, -0.076)
#: Half ranges of that record [V], [um], to which others are scaled: the threshold depends on them.
RANGES = (150.0, 19.7)
Rate = Callable[[float, float, float], float]


def integrated(task: Task, rate: Rate, u: Array, y: Array, first: int) -> Array:
    """Return the solution of dy/dt = rate(y, u, du/dt) from a measured sample on."""
    from scipy.integrate import solve_ivp

    t = task.dt * np.arange(u.size)
    slope = np.gradient(u, task.dt)

    def derivative(now: float, state: Array) -> list[float]:
        k = now / task.dt
        i = min(int(k), u.size - 2)
        part = k - i
        volts = u[i] + part * (u[i + 1] - u[i])
        return [rate(float(state[0]), volts, slope[i] + part * (slope[i + 1] - slope[i]))]

    run = np.full(u.size, np.nan)
    start = y[first] if np.isfinite(y[first]) else 0.0
    found = solve_ivp(
        derivative, (t[first], t[-1]), [start], t_eval=t[first:], rtol=1e-6, atol=1e-8,
        max_step=max(task.dt, 0.01),
    )  # fmt: skip
    run[first : first + found.y.shape[1]] = found.y[0]
    return run


def sindy_rate(names: Sequence[str], weights: Array) -> Rate:
    """Return the fitted right-hand side."""
    factors = []
    for name in names:
        powers = [0] * 5
        for part in name.split():
            if part != '1':
                base, _, power = part.partition('^')
                powers[int(base[1:])] += int(power or 1)
        factors.append(powers)

    def rate(y: float, u: float, slope: float) -> float:
        x = (y, u, slope, abs(slope), abs(y))
        total = 0.0
        for weight, powers in zip(weights, factors, strict=True):
            product = weight
            for value, power in zip(x, powers, strict=True):
                product *= value**power
            total += product
        return total

    return rate


def pysindy_published(task: Task) -> Answer:
    """Run the equation published for the record at 150 V."""
    (volt, metre), (volt0, metre0) = task.half_ranges, task.middles
    one, y1, u1, slope1, yy = PUBLISHED

    def rate(y: float, u: float, slope: float) -> float:
        um, volts = 1e6 * (metre * y + metre0), volt * u + volt0
        change = one + y1 * um + u1 * volts + slope1 * volt * slope + yy * um * abs(um)
        return 1e-6 * change / metre

    seven = round(7.0 / task.dt)
    tests = zip(task.voltage[1:], task.displacement[1:], strict=True)
    runs = [integrated(task, rate, u, y, min(seven, begins_at(y))) for u, y in tests]
    return Answer(runs, 5, 'as published: fitted to 7 to 9 s, run from the measured value at 7 s')


def pysindy_library(task: Task) -> Answer:
    """Its authors' library and threshold, fitted to the last cycles that are known here."""
    import pysindy

    u, y = task.known
    volt, um = RANGES
    slope = np.gradient(u, task.dt)
    library = np.column_stack([um * y, volt * u, volt * slope, volt * abs(slope), um * abs(y)])
    found = []
    for cycles, threshold in product((2, 4, 8), (0.01, 0.03, 0.1)):
        model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=threshold))
        model.fit(library[-cycles * task.period :], task.dt)
        weights = np.asarray(model.coefficients())[0]
        names = model.get_feature_names()
        kept = [i for i in range(weights.size) if weights[i]]
        inner = sindy_rate([names[i] for i in kept], weights[kept])

        def rate(y: float, u: float, slope: float, inner: Rate = inner) -> float:
            return inner(um * y, volt * u, volt * slope) / um

        first = max(u.size - 2 * task.period, 0)
        error = rms((integrated(task, rate, u, y, first) - y)[first:])
        words = ' '.join(f'{weights[i]:+.3g} {names[i]}' for i in kept)
        for name, sign in (('x0', 'y'), ('x1', 'u'), ('x2', 'du/dt'), ('x3', 'abs(du/dt)'),
                           ('x4', 'abs(y)'), ('1', '')):  # fmt: skip
            words = re.sub(rf'(?<= ){name}\b', sign, words)
        found.append(
            (error, len(kept), f'threshold {threshold}, last {cycles} known cycles: {words}', rate)
        )
    _, size, words, best = min(found, key=lambda each: each[0])
    tests = list(zip(task.voltage[1:], task.displacement[1:], strict=True))
    return Answer([integrated(task, best, u, y, begins_at(y)) for u, y in tests], size, words)


def pysindy_polynomials(task: Task) -> Answer:
    """Discrete time, polynomials of two past inputs and outputs: settings of this study."""
    import pysindy

    u, y = task.known
    states, inputs = np.column_stack([y[1:], y[:-1]]), np.column_stack([u[1:], u[:-1]])
    tests = zip(task.voltage[1:], task.displacement[1:], strict=True)
    data = [(u, np.where(np.arange(y.size) < 2, y, np.nan)), *tests]
    found = []
    for degree, threshold in ((1, 0.0), (3, 1e-3), (3, 1e-2), (3, 5e-2)):
        library = pysindy.PolynomialLibrary(degree=degree)
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-6)
        model = pysindy.DiscreteSINDy(optimizer=optimizer, feature_library=library)
        model.fit(states, t=1, u=inputs)
        weights = np.asarray(model.coefficients())[0]
        powers = np.asarray(model.feature_library.powers_)
        runs = [recursion(powers, weights, *each) for each in data]
        words = f'settings of this study: degree {degree}, threshold {threshold:g}'
        found.append((rms(runs[0] - y), int(np.count_nonzero(weights)), words, runs[1:]))
    _, size, words, best = min(found, key=lambda each: each[0])
    return Answer(best, size, words)


def recursion(powers: Array, weights: Array, u: Array, y: Array) -> Array:
    """Return the free run of a polynomial of y[k-1], y[k-2], u[k-1], u[k-2]."""
    kept = np.flatnonzero(weights)
    powers, weights = powers[kept], weights[kept]
    first = max(begins_at(y), 1)
    run = np.full(u.size, np.nan)
    run[first - 1 : first + 1] = np.nan_to_num(y[first - 1 : first + 1])
    for k in range(first + 1, u.size):
        past = np.array([run[k - 1], run[k - 2], u[k - 1], u[k - 2]])
        run[k] = weights @ np.prod(past**powers, axis=1)
        if not abs(run[k]) < 1e3:
            break
    return run


# NARX: the newest sample first


def slower(task: Task, u: Array, y: Array, by: int) -> tuple[Array, Array]:
    """Return each `by`-th sample, the last known one of `y` among them."""
    first = begins_at(y) % by
    return u[first::by], y[first::by]


def narx_runs(task: Task, by: int, predict: Callable[[Array, Array], Array]) -> list[Array]:
    """Return free runs at the full rate of a model at a lower one."""
    from scipy.interpolate import CubicSpline

    runs = []
    for u, y in zip(task.voltage[1:], task.displacement[1:], strict=True):
        few_u, few_y = slower(task, u, y, by)
        start = begins_at(few_y)
        run = predict(few_u, few_y)
        whole = np.full(u.size, np.nan)
        at = begins_at(y) % by + by * np.arange(few_u.size)
        if np.all(np.isfinite(run[start:])):
            inside = np.arange(begins_at(y), u.size)
            whole[inside] = CubicSpline(at[start:], run[start:])(np.minimum(inside, at[-1]))
        runs.append(whole)
    return runs


def sysidentpy_sign(task: Task) -> Answer:
    """FROLS (AIC) on u, its difference and the sign of it: the tutorial of a hysteretic damper.

    A broadband force has a sign of no meaning, so that a multisine is also tried without it and
    with more lags, as polynomial NARX models of that benchmark have them.
    """
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    found = []
    rates = (10, 50) if task.period >= 1000 else (1, 2)[: 2 if task.period else 1]
    sizes = [(1, 3, True), (2, 3, True), (4, 2, True)]
    if task.periods:
        sizes = [(2, 3, True), (4, 3, False), *([] if task.quick else [(10, 2, False)])]
    for by, (lags, degree, signed) in product(rates, sizes):
        few_u, few_y = slower(task, *task.period_mean, by)
        past = list(range(1, lags + 1))
        size = float(np.max(np.abs(np.diff(few_u))))
        model = FROLS(
            order_selection=True,
            n_info_values=12 if task.quick else 30 if signed else 50,
            xlag=[past] * 3 if signed else past,
            ylag=past,
            basis_function=Polynomial(degree=degree),
            estimator=LeastSquares(),
            info_criteria='aic',
        )

        def inputs(u: Array, size: float = size, signed: bool = signed) -> Array:
            change = np.diff(u, prepend=u[0])
            columns = [u, change / size, np.sign(change)] if signed else [u]
            # the newest input of the model is one sample old: shift it to the present
            return np.roll(np.column_stack(columns), -1, axis=0)

        model.fit(X=inputs(few_u), y=few_y[:, None])

        def predict(
            u: Array, y: Array, model: Any = model, lags: int = lags, inputs: Any = inputs
        ) -> Array:
            start = max(begins_at(y) + 1 - lags, 0)
            known = np.nan_to_num(y[start : start + lags])
            run = np.full(u.size, np.nan)
            run[start:] = model.predict(X=inputs(u)[start:], y=known[:, None]).ravel()
            return run

        known = few_y.copy()
        # a free run over two cycles, or over the period but its first samples
        known[lags if task.periods else -2 * max(task.period // by, 100) :] = np.nan
        error = rms((predict(few_u, known) - few_y)[np.isnan(known)])
        words = f'{lags} lags, degree {degree}, one in {by} samples'
        words += '' if signed else ', voltage alone'
        found.append((error, len(model.final_model), words, by, predict))
    _, size_, words, by, best = min(found, key=lambda each: each[0])
    return Answer(narx_runs(task, by, best), size_, words)


# State space

STARTS = 2  # of a network; its example takes as many as there are processors


def jax_states(task: Task, network: bool) -> Answer:
    """jax-sysid, third order: linear, or with the network of its Bouc-Wen example."""
    import jax

    jax.config.update('jax_platform_name', 'cpu')
    jax.config.update('jax_enable_x64', True)
    from flax import linen
    from jax_sysid.models import LinearModel, Model

    by = 50 if task.period >= 1000 else 1
    u, y = slower(task, *task.period_mean, by)
    iterations = 50 if task.quick else 1000
    linear = LinearModel(3, 1, 1, feedthrough=False)
    linear.loss(rho_x0=1e-3, rho_th=1e-2)
    linear.optimization(adam_epochs=0, lbfgs_epochs=iterations)
    linear.fit(y[:, None], u[:, None])
    model = linear
    if network:
        a, b, c = linear.params
        shapes = ((16, 3), (16, 1), (3, 16), 16, 3, (16, 3), (1, 16), 16, 1)

        @jax.jit
        def state(x: Any, u: Any, params: Any) -> Any:
            a, b, _, w1, w2, w3, b1, b2, *_ = params
            return a @ x + b @ u + w3 @ linen.gelu(w1 @ x + w2 @ u + b1) + b2

        @jax.jit
        def output(x: Any, u: Any, params: Any) -> Any:
            _, _, c, *_, w4, w5, b3, b4 = params
            return c @ x + w5 @ linen.gelu(w4 @ x + b3) + b4

        found = []
        # a multisine has ten times the samples of a sine here
        starts = 1 if task.quick or task.periods else STARTS
        for seed in range(starts):
            draw = np.random.default_rng(seed).standard_normal
            weights = [0.1 * draw(s) if isinstance(s, tuple) else np.zeros(s) for s in shapes]
            model = Model(3, 1, 1, state_fcn=state, output_fcn=output)
            model.init(params=[a, b, c, *weights])
            model.loss(rho_x0=1e-8, rho_th=1e-12)
            model.optimization(
                adam_epochs=5 if task.quick else 200, lbfgs_epochs=20 if task.quick else 5000
            )
            model.fit(y[:, None], u[:, None])
            run = np.asarray(model.predict(model.x0, u[:, None])[0], dtype=float).ravel()
            found.append((rms(run - y), seed, model))
        model = min(found, key=lambda each: each[:2])[2]

    def predict(u: Array, y: Array) -> Array:
        known = np.isfinite(y)
        start = np.zeros(3)
        if np.any(known):
            start = model.learn_x0(u[known][:, None], y[known][:, None], RTS_epochs=10)
        return np.asarray(model.predict(start, u[:, None])[0], dtype=float).ravel()

    count = sum(np.size(part) for part in model.params)
    words = f'one in {by} samples' if by > 1 else 'every sample'
    if network:
        words += f', best of {starts} starts on the fitted part' if starts > 1 else ', one start'
    return Answer(narx_runs(task, by, predict), count, words)


def start_of(system: Sequence[Array], u: Array, y: Array) -> Array:
    """Return the initial state with which a linear system follows the known samples best."""
    a, _, c, _ = system
    known = np.flatnonzero(np.isfinite(y))
    state, rows = np.eye(a.shape[0]), []
    for _ in range(known.size):
        rows.append((c @ state).ravel())
        state = a @ state
    left = (y - linear_run(system, np.zeros(a.shape[0]), u))[known]
    columns = np.reshape(rows, (-1, a.shape[0]))
    return np.asarray(np.linalg.lstsq(columns, left, rcond=None)[0], dtype=np.float64)


def linear_run(system: Sequence[Array], state: Array, u: Array) -> Array:
    """Return the output of a linear system."""
    a, b, c, d = system
    run = np.empty(u.size)
    for k, value in enumerate(u):
        run[k] = (c @ state + d[:, 0] * value)[0]
        state = a @ state + b[:, 0] * value
    return run


def subspace_linear(task: Task) -> Answer:
    """Apply N4SID (nfoursid); the order and the rows by the free run over what is known."""
    import pandas
    from nfoursid.nfoursid import NFourSID

    by = 50 if task.period >= 1000 else 1
    # its singular value decomposition keeps a square of the number of samples in memory
    u, y = (each[-4000:] for each in slower(task, *task.known, by))
    frame = pandas.DataFrame({'u': u, 'y': y})
    found = []
    for rows in (10,) if task.quick else (10, 20, 40):
        method = NFourSID(frame, ['y'], ['u'], num_block_rows=rows)
        method.subspace_identification()
        for order in (1, 2, 3, 4, 6):
            model, _ = method.system_identification(rank=order)
            matrices = (model.a, model.b, model.c, model.d)
            system = [np.asarray(part, dtype=float) for part in matrices]
            if np.max(abs(np.linalg.eigvals(system[0]))) > 1.0:
                continue
            error = rms(linear_run(system, start_of(system, u, y), u) - y)
            found.append((error, f'order {order}, {rows} block rows', system))
    _, words, best = min(found, key=lambda each: each[0])

    def predict(u: Array, y: Array) -> Array:
        return linear_run(best, start_of(best, u, y), u)

    count = sum(part.size for part in best)
    return Answer(narx_runs(task, by, predict), count, f'{words}, one in {by} samples')


def frequency_lfr(task: Task) -> Answer:
    """freq-statespace: the steps and sizes of its quick example, the solver of its mirror."""
    import freq_statespace as fss
    import jax
    import optimistix

    jax.config.update('jax_enable_x64', True)
    few = 5 if task.quick else 300
    u, y = (each.reshape(task.periods, -1).T[:, None, None] for each in task.known)
    spectrum = abs(np.fft.rfft(u[:, 0, 0, 0]))
    lines = np.flatnonzero(spectrum > 1e-3 * np.max(spectrum))
    data = fss.create_data_object(u, y, lines[lines > 0], 1.0 / task.dt)
    linear = fss.lin.subspace_id(data, 3)
    linear = fss.lin.optimize(linear, data, print_every=0)
    # Levenberg-Marquardt, its default, does not end its first ten iterations in minutes
    solver = optimistix.BFGS(rtol=1e-3, atol=1e-6)
    model = fss.nonlin.inference_and_learning(
        linear, data, fss.static.basis.Polynomial(1, degree=3), 1,
        solver=solver, max_iter=few, print_every=0,
    )  # fmt: skip
    model = fss.nonlin.optimize(model, data, solver=solver, max_iter=2 * few, print_every=0)
    runs = [np.asarray(model.simulate(u[:, None])[0]).ravel() for u in task.voltage[1:]]
    return Answer(runs, model.num_parameters(), 'three states, polynomial of degree 3')


def jax_linear(task: Task) -> Answer:
    """jax-sysid, linear, third order."""
    return jax_states(task, network=False)


def jax_network(task: Task) -> Answer:
    """jax-sysid, third order, with the network of its Bouc-Wen example."""
    return jax_states(task, network=True)


#: Function and distribution by name.
TOOLS: dict[str, tuple[Callable[[Task], Answer], str]] = {
    'pysindy_published': (pysindy_published, 'pysindy'),
    'pysindy_library': (pysindy_library, 'pysindy'),
    'pysindy_polynomials': (pysindy_polynomials, 'pysindy'),
    'sysidentpy_sign': (sysidentpy_sign, 'sysidentpy'),
    'subspace_linear': (subspace_linear, 'nfoursid'),
    'frequency_lfr': (frequency_lfr, 'freq-statespace'),
    'jax_linear': (jax_linear, 'jax-sysid'),
    'jax_network': (jax_network, 'jax-sysid'),
}


def main(tool: str, source: str, target: str) -> None:
    """Answer a task."""
    run, distribution = TOOLS[tool]
    task = read(Path(source))
    started = time.perf_counter()
    answer = run(task)
    size, middle = task.half_ranges[1], task.middles[1]
    found: dict[str, Any] = {f'run_{i}': size * y + middle for i, y in enumerate(answer.runs)}
    found |= {'seconds': time.perf_counter() - started, 'parameters': answer.parameters}
    np.savez(target, words=f'{version(distribution)}: {answer.words}', **found)


if __name__ == '__main__':
    main(*sys.argv[1:])
