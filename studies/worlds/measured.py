"""Discovery on measured records, compared with PySINDy and SysIdentPy.

    python studies/study.py measured --data ../shared/data --workers 2

Two records: the training multisine of the Bouc-Wen benchmark with the baseline ``linear_mode``,
and a measured piezo stack (150 V, 1 Hz) with the baseline ``classical``. Every tool sees the first
three quarters; the table shows the free run over the last one, and over the two test records of
the benchmark, which nothing was chosen on. The others get polynomials up to degree three of the
last two inputs and outputs, and of several settings the one whose free run is best where it was
fitted. Packages and records that are not there are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import Discovery, discover
from piezo_hysteresis.discovery.data.dataset import HELD_OUT
from piezo_hysteresis.discovery.selection.candidate_fit import evaluated_on
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.jit import jit
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, load
from studies.worlds.stand_ins import records_in

LAGS = 2
DEGREE = 3
#: File, baseline, and the test records with whether they are one period of a steady state.
CASES = (
    (
        'boucwen_benchmark/train_multisine.csv',
        'linear_mode',
        (('test_multisine.csv', True), ('test_sinesweep.csv', False)),
    ),
    ('piezo_150v_1hz/piezo_150V_1Hz.csv', 'classical', ()),
)


@dataclass(frozen=True)
class Row:
    """What one tool made of one record.

    Attributes
    ----------
    tool, named : str
        Who, and the effect that it names.
    terms : int
        Fitted numbers.
    errors : dict of str to float
        Rms of the free run [m] by record; infinite where it diverges.
    """

    tool: str
    named: str
    terms: int
    errors: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Recursion:
    """A polynomial of the last outputs and inputs, the newest first, in units of their scatter.

    Attributes
    ----------
    powers : ndarray, shape (terms, 2 LAGS)
        Of ``y[k-1], y[k-2], u[k-1], u[k-2]`` in each term.
    weights : ndarray, shape (terms,)
        Of the terms.
    """

    powers: FloatArray
    weights: FloatArray


@jit
def free_run(powers: FloatArray, weights: FloatArray, u: FloatArray, y: FloatArray) -> None:
    """Fill `y` from its first two samples on; what leaves 1e6 standard deviations stays there."""
    for k in range(2, y.size):
        regressors = (y[k - 1], y[k - 2], u[k - 1], u[k - 2])
        total = 0.0
        for i in range(weights.size):
            term = weights[i]
            for j in range(4):
                term *= regressors[j] ** powers[i, j]
            total += term
        y[k] = min(max(total, -1e6), 1e6)


def pysindy_models(u: FloatArray, y: FloatArray) -> list[Recursion]:
    """Sparse regression (STLSQ) in discrete time, by several thresholds."""
    import pysindy

    states = np.column_stack([y[1:], y[:-1]])
    inputs = np.column_stack([u[1:], u[:-1]])
    found = []
    for degree, threshold in ((1, 0.0), (DEGREE, 1e-3), (DEGREE, 1e-2), (DEGREE, 5e-2)):
        library = pysindy.PolynomialLibrary(degree=degree)
        kind = getattr(pysindy, 'DiscreteSINDy', None) or pysindy.SINDy
        model = kind(
            optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-6), feature_library=library
        )
        model.fit(states, t=1, u=inputs)
        weights = np.asarray(model.coefficients())[0]
        kept = np.flatnonzero(weights)
        powers = np.asarray(model.feature_library.powers_, dtype=float)[kept]
        found.append(Recursion(powers, weights[kept]))
    return found


def sysidentpy_models(u: FloatArray, y: FloatArray) -> list[Recursion]:
    """Forward regression (FROLS) with several numbers of terms."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS

    found = []
    for degree, terms in ((1, 4), (DEGREE, 8), (DEGREE, 16)):
        model = FROLS(
            order_selection=False,
            n_terms=terms,
            ylag=LAGS,
            xlag=LAGS,
            basis_function=Polynomial(degree=degree),
        )
        model.fit(X=u[:, None], y=y[:, None])
        # codes of a term: 1001 is y[k-1], 2002 is u[k-2], 0 is no factor
        codes = np.asarray(model.final_model)
        wanted = (1001, 1002, 2001, 2002)
        powers = np.array([[float(np.sum(row == code)) for code in wanted] for row in codes])
        found.append(Recursion(powers, np.asarray(model.theta, dtype=float).ravel()))
    return found


RIVALS: dict[str, Callable[[FloatArray, FloatArray], list[Recursion]]] = {
    'PySINDy': pysindy_models,
    'SysIdentPy': sysidentpy_models,
}


def rival(
    tool: str, record: Record, tests: Sequence[tuple[Record, bool]]
) -> tuple[Row, Recursion]:
    """Fit with another tool and run its model freely from the first two measured samples."""
    scale_u, scale_y = float(np.std(record.voltage)), float(np.std(record.displacement))
    count = round((1.0 - HELD_OUT) * len(record))

    def errors(model: Recursion, each: Record) -> FloatArray:
        u, y = each.voltage / scale_u, each.displacement / scale_y
        run = np.zeros_like(y)
        run[:LAGS] = y[:LAGS]
        free_run(model.powers, model.weights, u, run)
        return np.asarray((y - run) * scale_y)

    models = RIVALS[tool](record.voltage[:count] / scale_u, record.displacement[:count] / scale_y)
    best = min(models, key=lambda each: rms(errors(each, record)[:count]))
    found = {'last quarter': rms(errors(best, record)[count:])}
    for test, _ in tests:
        found[test.name] = rms(errors(best, test))
    return Row(tool, 'none', best.weights.size, found), best


def rms(error: FloatArray) -> float:
    """Return the rms [m]; infinite from a metre on."""
    size = float(np.sqrt(np.mean(np.square(error))))
    return size if size < 1.0 else float('inf')


def ours(found: Discovery, tests: Sequence[tuple[Record, bool]]) -> list[Row]:
    """Return the baseline and what the discovery made of it."""
    verdict = found.verdict
    names = ', '.join(effect.name for effect in verdict.effects)
    if not names:
        closest = ', '.join(excess_deviation.name for excess_deviation in verdict.suspects)
        names = f'{verdict.verdict} (closest: {closest})' if closest else verdict.verdict
    rows = []
    for tool, text, trial, held in (
        (f'{verdict.baseline} alone', '', found.baselines.joint, found.proof.before),
        ('discovery', names, found.final, found.proof.after),
    ):
        errors = {'last quarter': held}
        for record, _ in tests:
            views = views_of(trial.model, trial.values, [record], trial.sampling_offset)
            errors[record.name] = evaluated_on(trial, views).rms
        rows.append(Row(tool, text, trial.parameters, errors))
    return rows


def table(rows: Sequence[Row]) -> list[str]:
    """Return rows as a table of a page, errors in micrometres."""
    columns = list(rows[0].errors)
    lines = [f'| tool | names | terms | {" | ".join(f"{c} [um rms]" for c in columns)} |']
    lines.append('|---|---|---:|' + '---:|' * len(columns))
    for row in rows:
        cells = [f'{1e6 * row.errors[c]:.3g}' for c in columns]
        lines.append(f'| {row.tool} | {row.named} | {row.terms} | {" | ".join(cells)} |')
    return lines


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(workers=2)
    parser.add_argument('--data', type=Path, default=Path('../shared/data'))


QUICK = {'data': None, 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> str:
    """Return the tables."""
    first, _, more = CASES[0]
    files = [first, *(str(Path(first).with_name(name)) for name, _ in more)]
    with records_in(asked.data, files) as data:
        return '\n'.join(compared(data, asked)) + '\n'


def compared(data: Path, asked: argparse.Namespace) -> list[str]:
    """Give every record that is there to every tool that is there; return the tables."""
    page: list[str] = []
    for file, baseline, others in CASES:
        path = data / file
        if not path.exists():
            print(f'{file} is not in {data}: left out')
            continue
        (record,) = load([path])
        tests = [(load([path.parent / name])[0], steady) for name, steady in others]
        rows = []
        for tool in RIVALS:
            try:
                row, _ = rival(tool, record, tests)
            except ImportError:
                print(f'{tool} is not installed: left out')
                continue
            rows.append(row)
            print('\n'.join(table([row])), flush=True)
        found = discover(
            [record],
            named(baseline),
            name=baseline,
            seed=asked.seed,
            workers=asked.workers,
            time_limit=asked.time_limit,
        )
        lines = [f'### {path.stem}', '', found.verdict.summary, '']
        if found.verdict.unexplained.significant:
            lines += [found.verdict.unexplained.description, '']
        page += [*lines, *table([*ours(found, tests), *rows]), '']
    return page
