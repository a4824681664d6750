"""Identification against what is on offer elsewhere: every ratio is measured in one run.

Run from the root; padasip and pyswarms take part where they can be imported::

    python bench/identification.py [--seconds 100] [--seeds 10] [--measured CSV]
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.identification import (
    OnlineRls,
    OnlineUd,
    RlsSettings,
    UdSettings,
    fit,
    output_error,
    targets_of,
)
from piezo_hysteresis.identification.global_search import METHODS, search
from piezo_hysteresis.identification.initial_conditions.record_start import preceded
from piezo_hysteresis.identification.objective import Objective
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.identification.simulate import Unsaved, free_runs
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, RecordInfo, read_csv
from piezo_sim.sweep import simulate

DT = 1e-3
BIMORPH = 'fdk_pzba_00030'


def best_of(run: Callable[[], object], repeats: int = 5) -> float:
    """Return the shortest of several times [s]; the first call, which compiles, is left out."""
    run()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        run()
        times.append(time.perf_counter() - started)
    return min(times)


def rival(name: str) -> Any:
    """Return a module, or None where it cannot be imported."""
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f'  ({name} cannot be imported: left out)')
        return None


def numpy_rls(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Run the textbook recursion in plain NumPy, on columns that are already there."""
    p = np.eye(columns.shape[1])
    theta = np.zeros(columns.shape[1])
    for x, y in zip(columns, target, strict=True):
        px = p @ x
        gain = px / (1.0 + x @ px)
        theta += gain * (y - theta @ x)
        p -= np.outer(gain, px)
    return theta


def rls_speed(samples: int) -> None:
    """Compare one update with 11 parameters; ours builds its regressor as well."""
    print('RLS, 11 parameters, per update')
    k = np.arange(samples)
    u = np.sin(2 * np.pi * 23 * DT * k)
    y = 1e-4 * np.sin(2 * np.pi * 23 * DT * k - 0.3)
    rls = OnlineRls(RlsSettings(harmonic=3, frequency=23.0))
    ours = best_of(lambda: rls.update_many(u, y), 15) / samples

    def single() -> None:
        for a, b in zip(u[:5000].tolist(), y[:5000].tolist(), strict=True):
            rls.update(a, b)

    called = best_of(single, 15) / 5000
    columns = np.random.default_rng(0).normal(size=(min(samples, 5000), 11))
    plain = best_of(lambda: numpy_rls(columns, columns[:, 0]), 10) / len(columns)
    print(f'  compiled loop {1e6 * ours:.2f} us, called from Python {1e6 * called:.2f} us')
    print(f'  plain numpy {1e6 * plain:.2f} us: {plain / ours:.0f} times the compiled loop')
    padasip = rival('padasip')
    if padasip is not None:
        filt = padasip.filters.FilterRLS(n=11, mu=0.999)
        theirs = best_of(lambda: filt.run(columns[:, 0], columns), 10) / len(columns)
        print(f'  padasip {1e6 * theirs:.2f} us: {theirs / ours:.0f} times the compiled loop')


def parked() -> None:
    """Park the actuator with forgetting .98 and let it move again."""
    print('actuator parked, forgetting 0.98')
    moving = np.sin(2 * np.pi * 10 * DT * np.arange(20_000))
    u = np.concatenate([moving, np.zeros(600_000), moving])
    model = named('bouc_wen_mode')
    values = {**model.defaults(), 'natural_frequency': 68.0, 'damping_ratio': 0.015}
    noise = 20e-9 * np.random.default_rng(0).normal(size=u.size)
    y = model.respond(u, model.pack(values), DT) + noise
    for forgetting in (0.98, 0.9995):
        online = OnlineUd(
            UdSettings(natural_frequency=68.0, damping_ratio=0.015, forgetting=forgetting)
        )
        e = online.update_many(u, y)
        before, after = np.std(e[18_000:20_000]), np.std(e[620_000:622_000])
        print(
            f'  rls_ud (forgetting {forgetting}): all {u.size} errors finite: '
            f'{np.all(np.isfinite(e))}; {1e9 * before:.0f} nm before, {1e9 * after:.0f} nm in the '
            'first two seconds after 10 min of rest (noise 20 nm)'
        )
    padasip = rival('padasip')
    if padasip is None:
        return
    columns = papers_columns(u[:60_000], y[:60_000])
    with np.errstate(all='ignore'):
        filt = padasip.filters.FilterRLS(n=columns.shape[1], mu=0.98)
        _, error, _ = filt.run(1e3 * y[:60_000], columns)
    lost = np.flatnonzero(~np.isfinite(error))
    when = f'NaN from {lost[0] * DT:.1f} s on' if lost.size else 'stays finite'
    print(
        f'  padasip FilterRLS on the seven columns of Fujii 2018 (10), moving then parked: {when}'
    )


def papers_columns(u: FloatArray, y: FloatArray) -> FloatArray:
    """Return the regressor of Fujii 2018 (10) with the true h, y in mm."""
    model = named('classical')
    values = model.defaults() | {'A1': 0.0}
    h = -1e3 * model.respond(u, model.pack(values), DT)
    du, before = np.diff(u, prepend=0.0), np.concatenate([[0.0], h[:-1]])
    past = np.concatenate([[0.0, 0.0], 1e3 * y])
    return np.column_stack(
        [
            past[1:-1],
            past[:-2],
            u,
            -np.cumsum(du),
            -np.cumsum(np.abs(du)),
            np.cumsum(np.abs(du) * before),
            np.cumsum(np.abs(before) * du),
        ]
    )


def bimorph(seconds: float, frequencies: range | tuple[int, ...]) -> list[Record]:
    """Simulate the bimorph of Fujii 2018 with sines of 1 V."""
    specs = [
        {'kind': 'sine', 'frequency': float(f), 'amplitude': 1.0, 'duration': seconds,
         'name': f'{f} Hz', 'warm_up': 1.0}
        for f in frequencies
    ]  # fmt: skip
    return simulate(BIMORPH, specs, seed=1)


def big(seconds: float) -> None:
    """Put 50 records through the papers' RLS and through the folded joint fit."""
    started = time.perf_counter()
    records = bimorph(seconds, range(1, 51))
    samples = sum(len(r) for r in records)
    print(f'{samples:.3g} samples (simulated in {time.perf_counter() - started:.1f} s)')
    rls = OnlineRls()
    started = time.perf_counter()
    for record in records:
        rls.reset()
        rls.update_many(record.voltage, record.displacement)
    print(f'  RLS of Fujii 2018: {time.perf_counter() - started:.2f} s')
    output_error(named('bouc_wen_mode'), records[:2], count=1)
    started = time.perf_counter()
    result = output_error(named('bouc_wen_mode'), records, workers=2)
    took = time.perf_counter() - started
    print(f'  joint output error, folding and starts included: {took:.2f} s; {result.message}')
    rows = free_runs(
        Unsaved(result.model, result.values, result.sampling_offset, inf), records
    ).errors
    errors = {row.record: 1e6 * row.free_run_rms for row in rows}
    shown = ', '.join(f'{f}: {errors[f"{f} Hz"]:.2f}' for f in (1, 10, 14, 23, 35, 50))
    print(f'  one parameter set, free run rms [µm] at f [Hz]: {shown}')
    print(f'  worst of all {len(records)}: {max(errors.values()):.2f} um')
    print(
        f'  fn {result.values["natural_frequency"]:.2f} +- {result.std["natural_frequency"]:.2f} '
        f'Hz, zeta {result.values["damping_ratio"]:.4f}, condition {result.condition:.0f}'
    )
    for warning in result.warnings:
        print(f'    warning: {warning}')


def recovery() -> None:
    """Recover parameters of the model's own family."""
    model = named('bouc_wen_mode')
    truth = {**model.defaults(), 'beta': 2.5, 'gamma': 1.0, 'natural_frequency': 68.0,
             'damping_ratio': 0.015, 'offset': 6e-6}  # fmt: skip
    records = []
    for f in (1, 7, 14, 23, 35, 50):
        u = np.sin(2 * np.pi * f * DT * np.arange(20_000))
        y = model.respond(u, model.pack(truth), DT)
        y += 20e-9 * np.random.default_rng(f).normal(size=u.size)
        records.append(Record(f'{f} Hz', DT, u, y, info=RecordInfo(frequency=float(f))))
    started = time.perf_counter()
    result = output_error(model, records)
    worst = max(
        (abs(result.values[n] / truth[n] - 1), n) for n in model.free_names if truth[n] != 0
    )
    print(f'in-family recovery, 6 records, 20 nm noise: worst {worst[0]:.1e} ({worst[1]}), '
          f'{time.perf_counter() - started:.2f} s')  # fmt: skip


def three_parameters(seeds: int) -> None:
    """Fit beta, gamma and A to 10 000 samples with every search."""
    print(f'three parameters, 10 000 samples, {seeds} seeds')
    model = named('classical')
    truth = {**model.defaults(), 'A1': 1.8e-4, 'A': 6e-5, 'beta': 2.5, 'gamma': 1.0}
    u = np.sin(2 * np.pi * 1 * DT * np.arange(10_000)) * np.linspace(1, 0.3, 10_000)
    y = model.respond(u, model.pack(truth), DT)
    y += 20e-9 * np.random.default_rng(0).normal(size=u.size)
    free = ('A', 'beta', 'gamma')
    low, high = np.array([1e-6, 0.05, -3.0]), np.array([3e-4, 20.0, 3.0])
    targets = targets_of([Record('r', DT, u, y)], folded=False)
    objective = Objective(model, targets, free, truth)
    floor = objective.cost(np.array([truth[n] for n in free]))
    start = {**truth, 'A': 1e-4, 'beta': 1.0, 'gamma': 0.0}

    def least_squares() -> float:
        return fit(model, (), start, free=free, targets=targets).cost

    report('least squares (ours)', best_of(least_squares), [least_squares()], floor)
    scipy_rival(objective, np.array([start[n] for n in free]), low, high, floor)
    for method in METHODS:
        started = time.perf_counter()
        costs = [
            search(objective.cost, low, high, method=method, seed=s, max_evaluations=3000).cost
            for s in range(seeds)
        ]
        report(f'{method} (ours)', (time.perf_counter() - started) / seeds, costs, floor)
    swarm_rivals(objective, low, high, floor, seeds)


def report(name: str, seconds: float, costs: list[float], floor: float) -> None:
    """Print time and how often a search came within 1 % of the noise."""
    hit = sum(cost < 1.02 * floor for cost in costs)
    print(f'  {name:22} {seconds:7.3f} s, {hit} of {len(costs)} within 1 % of the noise')


def scipy_rival(
    objective: Objective, start: FloatArray, low: FloatArray, high: FloatArray, floor: float
) -> None:
    """Let SciPy's least squares difference the whole residual."""
    from scipy.optimize import least_squares

    def run() -> float:
        found = least_squares(
            lambda x: 1e6 * objective.residuals(x)[0], start, bounds=(low, high), x_scale='jac'
        )
        return 1e-12 * float(found.cost)

    report('scipy least_squares', best_of(run, 3), [run()], floor)


def swarm_rivals(
    objective: Objective, low: FloatArray, high: FloatArray, floor: float, seeds: int
) -> None:
    """Let pyswarms with its documented options search the same box."""
    pyswarms = rival('pyswarms')
    if pyswarms is not None:
        import logging

        logging.disable(logging.CRITICAL)
        costs = []
        started = time.perf_counter()
        for seed in range(seeds):
            np.random.seed(seed)  # noqa: NPY002 - pyswarms knows no other seed
            swarm = pyswarms.single.GlobalBestPSO(
                n_particles=30,
                dimensions=3,
                options={'c1': 0.5, 'c2': 0.3, 'w': 0.9},
                bounds=(low, high),
            )

            def batch(x: FloatArray) -> FloatArray:
                return np.array([objective.cost(each) for each in x])

            costs.append(float(swarm.optimize(batch, iters=100, verbose=False)[0]))
        report('pyswarms', (time.perf_counter() - started) / seeds, costs, floor)


def measured(path: Path) -> None:
    """Fit the measured actuator whole, and its first 7 s to predict the last 3 s."""
    if not path.exists():
        print(f'measured record: {path} is not there, left out')
        return
    whole = read_csv(path)
    record = preceded(whole, [150.0, -150.0, 20.0])
    model = named('prandtl_ishlinskii')
    for block in ('mode', 'creep'):
        model = model.with_block(named_block(block))
    model = suited(model, [record])
    start = model.defaults() | {'natural_frequency': 956.0, 'damping_ratio': 0.05,
                                'creep_share': 0.02, 'creep_time': 0.1}  # fmt: skip
    span, spread = np.ptp(whole.displacement), np.std(whole.displacement)
    for words, cut in (('whole record', len(record)), ('first 7 s', len(record) - 15_000)):
        known = record.section(0, cut)
        result = fit(model, [known], start, folded=False, sampling_offset=True)
        views = targets_of([record], folded=False)
        (run,) = predictions(model, result.values, views, result.sampling_offset)
        error = record.displacement - run.displacement
        for part, e in (('fitted', error[record.warm_up_samples : cut]), ('unseen', error[cut:])):
            if e.size:
                rms = float(np.sqrt(np.mean(e**2)))
                print(
                    f'measured, fitted on {words}, {part}: {1e6 * rms:.4f} um, '
                    f'{100 * rms / span:.3f} % of the range, {100 * rms / spread:.3f} % of the '
                    f'standard deviation; fn {result.values["natural_frequency"]:.0f} Hz'
                )
    print(f'  noise from period to period {1e6 * targets_of([whole])[0].noise:.4f} um')


def main() -> None:
    """Run every comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--samples', type=int, default=200_000, help='of the recursion')
    parser.add_argument('--seconds', type=float, default=100.0, help='of each of 50 records')
    parser.add_argument('--seeds', type=int, default=10, help='of each search')
    parser.add_argument(
        '--measured', type=Path, default=Path('../shared/data/piezo_150v_1hz/piezo_150V_1Hz.csv')
    )
    arguments = parsed(parser, samples=10_000, seconds=2.0, seeds=1)
    rls_speed(arguments.samples)
    parked()
    recovery()
    big(arguments.seconds)
    three_parameters(arguments.seeds)
    measured(arguments.measured)


if __name__ == '__main__':
    main()
