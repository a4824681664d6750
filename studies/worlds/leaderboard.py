"""Measured records and one benchmark: this suite in three ways, and its peers at their best.

    python studies/study.py leaderboard --data ../shared/data --peers PYTHON [PYTHON ...]

PYTHON are interpreters with `studies/peers/requirements.txt` and `requirements_jax.txt`, which do
not fit together; a peer runs in the first that has it, and is left out where none has. Each model
is run freely over what it was not fitted to, and no peer is given those samples. Rows are kept in
`--results`, so that a run continues where an earlier one ended. The unknown zero of a test record
(P-885) is subtracted from the error of every model.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from piezo_hysteresis import identify
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, load
from studies.worlds import mirror
from studies.worlds.stand_ins import records_in

#: A model, its values, and the delay of its samples [s].
Fit: TypeAlias = tuple[Model, Mapping[str, float], float]
MIRROR = 'Mirror of three piezos: suite, `identify` with three axes'
PEERS = Path(__file__).resolve().parents[1] / 'peers' / 'run.py'


@dataclass(frozen=True)
class Test:
    """What is run freely."""

    file: str  # file in the folder of the training record
    known: float = 0.0  # fraction of it whose displacement is known and not scored
    start: str = 'auto'
    zero: str = 'auto'
    periodic: bool = False  # whether it is one period of a steady state


@dataclass(frozen=True)
class Case:
    """A training record, of which the first part `known` is fitted, and its tests.

    `frequency` [Hz] is that of a sine; `periods` are those of a multisine in its steady state.
    """

    title: str
    file: str
    tests: tuple[Test, ...]
    by_name: str
    baseline: str
    frequency: float = 0.0
    known: float = 1.0
    own_zero: bool = False
    periods: int = 0


CASES = (
    Case(
        'Stack, 150 V, 1 Hz', 'piezo_150v_1hz/piezo_150V_1Hz.csv',
        (Test('piezo_150V_1Hz.csv', known=0.75),),
        'prandtl_ishlinskii_fine', 'classical', frequency=1.0, known=0.75,
    ),
    Case(
        'Stack P-885, growing amplitude', 'p885_stack/train_1Hz_sine.csv',
        (Test('test_growing_amplitude.csv', known=200 / 14155),),
        'prandtl_ishlinskii_fine', 'classical', frequency=1.0, own_zero=True,
    ),
    Case(
        'Bouc-Wen benchmark (simulated)', 'boucwen_benchmark/train_multisine.csv',
        (
            Test('test_multisine.csv', start='settled', zero='common', periodic=True),
            Test('test_sinesweep.csv', start='rest', zero='common'),
        ),
        'bouc_wen_oscillator', 'linear_mode', periods=5,
    ),
)  # fmt: skip

#: Row and tool of `studies/peers/run.py`; the published equation is that of one record.
RIVALS = {
    'PySINDy, published equation': 'pysindy_published',
    'PySINDy, published library': 'pysindy_library',
    'PySINDy, polynomials': 'pysindy_polynomials',
    'SysIdentPy': 'sysidentpy_sign',
    'nfoursid, linear': 'subspace_linear',
    'freq-statespace, NL-LFR': 'frequency_lfr',
    'jax-sysid, linear': 'jax_linear',
    'jax-sysid, network': 'jax_network',
}


@dataclass(frozen=True)
class Row:
    """What came out: rms errors [m] by test record, infinite where a run diverged."""

    parameters: int
    seconds: float
    words: str
    errors: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Records:
    """Records of a case: what is fitted, and the tests."""

    case: Case
    whole: Record
    tests: tuple[Record, ...]

    @property
    def train(self) -> Record:
        """Return the part to fit."""
        return self.whole.section(0, round(self.case.known * len(self.whole)))

    def errors(self, runs: Sequence[FloatArray]) -> dict[str, float]:
        """Return the rms of what was kept back [m]."""
        found = {}
        for test, record, run in zip(self.case.tests, self.tests, runs, strict=True):
            error = (record.displacement - run)[round(test.known * len(record)) :]
            if self.case.own_zero:
                error = error - np.mean(error)
            size = float(np.sqrt(np.mean(error**2)))
            found[Path(test.file).stem] = size if size < 1.0 else float('inf')
        return found


def read(case: Case, data: Path) -> Records:
    """Load the records of a case."""
    path = data / case.file
    tests = tuple(load([path.parent / test.file])[0] for test in case.tests)
    return Records(case, load([path])[0], tests)


# This suite


def free_run(test: Test, record: Record, fit: Fit) -> FloatArray:
    """Return a free run; its initial condition and zero come from the known samples alone."""
    model, values, late = fit
    known = round(test.known * len(record)) or len(record)
    choices = Choices(start=test.start, zero=test.zero)
    (view,) = views_of(model, values, [record.section(0, known)], late, choices)
    valid = np.ones(known) if view.valid is None else view.valid
    whole = replace(
        view,
        voltage=np.concatenate([view.voltage, record.voltage[known:]]),
        measured=np.concatenate([view.measured, record.displacement[known:]]),
        valid=np.concatenate([valid, np.zeros(len(record) - known)]),
        influence=None,
    )
    return whole.measured - Prediction(model, model.pack(values), whole, late).error


def ours(records: Records, limit: float, seed: int) -> Iterator[tuple[str, Callable[[], Row]]]:
    """Identify in four ways."""
    case, train = records.case, records.train

    def scored(fit: Fit, parameters: int, started: float) -> Row:
        seconds = time.perf_counter() - started
        tests = zip(case.tests, records.tests, strict=True)
        runs = [free_run(test, record, fit) for test, record in tests]
        return Row(parameters, seconds, fit[0].name, records.errors(runs))

    def identified(name: str | None) -> Row:
        started = time.perf_counter()
        found = identify([train], name)
        fit = found.chain, found.values, found.sampling_offset
        return scored(fit, len(found.values), started)

    def discovered() -> Row:
        started = time.perf_counter()
        baseline = named(case.baseline)
        search = discover(
            [train], baseline, name=case.baseline, seed=seed, time_limit=limit
        ).final  # fmt: skip
        fit = search.model, search.values, search.sampling_offset
        return scored(fit, search.parameters, started)

    yield 'suite, automatic model', partial(identified, None)
    yield f'suite, `{case.by_name}`', partial(identified, case.by_name)
    yield f'suite, `{case.baseline}` alone', partial(identified, case.baseline)
    yield f'suite, discovery from `{case.baseline}`', discovered


# Peers


def rival(records: Records, tool: str, asked: argparse.Namespace) -> Row:
    """Run a peer in its own environment; what is kept from it is NaN there."""
    case = records.case
    signals: dict[str, Any] = {
        'count': len(records.tests) + 1, 'quick': asked.quick, 'periods': case.periods,
    }  # fmt: skip
    for i, (record, test) in enumerate(
        zip((records.whole, *records.tests), (None, *case.tests), strict=True)
    ):
        voltage, known = record.voltage, record.displacement.copy()
        known[round((test.known if test else case.known) * len(record)) :] = np.nan
        if test and test.periodic:
            voltage, known = np.tile(voltage, 2), np.tile(known, 2)
        signals |= {f'voltage_{i}': voltage, f'displacement_{i}': known}
    dt = records.whole.dt
    period = round(1.0 / (case.frequency * dt)) if case.frequency else 0
    with tempfile.TemporaryDirectory() as folder:
        task, answer = Path(folder) / 'task.npz', Path(folder) / 'answer.npz'
        np.savez(task, dt=dt, period=period, **signals)
        # a peer has no deadline of its own: the start of Python and its last round come on top
        allowed = None if asked.time_limit == math.inf else 2.0 * asked.time_limit + 60.0
        for interpreter in asked.peers:
            words = [interpreter, '-W', 'ignore', str(PEERS), tool, str(task), str(answer)]
            try:
                done = subprocess.run(
                    words, capture_output=True, text=True, check=False, timeout=allowed
                )
            except subprocess.TimeoutExpired as error:
                raise RivalError(f'not done within {error.timeout:g} s') from error
            if 'ModuleNotFoundError' not in done.stderr:
                break
        if done.returncode:
            reason = done.stderr.strip() or f'exit code {done.returncode}'
            raise RivalError(reason.splitlines()[-1])
        with np.load(answer) as found:
            runs = [found[f'run_{i}'][-len(record) :] for i, record in enumerate(records.tests)]
            return Row(
                int(found['parameters']), float(found['seconds']), str(found['words']),
                records.errors(runs),
            )  # fmt: skip


class RivalError(Exception):
    """A peer is not installed, or it failed."""


def rivals(case: Case) -> list[str]:
    """Return the tools for a case.

    The published equation and library are of a slow sine; freq-statespace needs steady periods.
    """
    if not case.frequency:
        return [tool for tool in RIVALS if not tool.startswith('PySINDy, pub')]
    without = ['PySINDy, polynomials', 'freq-statespace, NL-LFR']
    if case is not CASES[0]:
        without.append('PySINDy, published equation')
    return [tool for tool in RIVALS if tool not in without]


# Tables


def table(case: Case, rows: Mapping[str, Row]) -> list[str]:
    """Return rows as a table of a page, errors in micrometres."""
    columns = [Path(test.file).stem for test in case.tests]
    heads = [f'`{column}` [um rms]' for column in columns]
    lines = [
        f'### {case.title}',
        '',
        f'| tool | {" | ".join(heads)} | parameters | seconds | what |',
    ]
    lines.append('|---|' + '---:|' * (len(columns) + 2) + '---|')
    for tool, row in rows.items():
        cells = [f'{1e6 * row.errors[c]:.3g}'.replace('inf', 'diverges') for c in columns]
        cells += [str(row.parameters), f'{row.seconds:.0f}', row.words]
        lines.append(f'| {tool} | {" | ".join(cells)} |')
    return [*lines, '']


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    add = parser.add_argument
    add('--data', type=Path, default=Path('../shared/data'))
    add('--peers', nargs='+', default=[sys.executable], metavar='PYTHON', help='with the peers')
    add('--rows', default='', metavar='TEXT', help='only rows whose record or tool contains this')
    add('--results', type=Path, help='file of the rows; rows that it has are not run again')


QUICK = {'data': None, 'time_limit': 1.0}


def run(asked: argparse.Namespace) -> str:
    """Return the tables."""
    kept: dict[str, dict[str, dict[str, object]]] = {}
    if asked.results and asked.results.exists():
        kept = json.loads(asked.results.read_text(encoding='utf-8'))
    cases = CASES[:1] if asked.quick else CASES
    lines: list[str] = []
    with records_in(asked.data, [case.file for case in cases]) as data:
        for case in cases:
            if not (data / case.file).exists():
                print(f'{case.file} is not in {data}: left out')
                continue
            rows = compared(read(case, data), asked, kept)
            lines += table(case, rows) if rows else []
    if asked.data and (asked.data / 'fsm').exists() and asked.rows in MIRROR:
        lines += [f'### {MIRROR}', '', mirror.run(mirror_of(asked))]
    return '\n'.join(lines) + '\n'


def mirror_of(asked: argparse.Namespace) -> argparse.Namespace:
    """Return the options of the study `mirror`, which has a model of its own for three axes."""
    parser = argparse.ArgumentParser()
    mirror.configure(parser)
    words = ['--train', str(asked.data / 'fsm')]
    return parser.parse_args(words, argparse.Namespace(workers=asked.workers))


def compared(
    records: Records, asked: argparse.Namespace, kept: dict[str, dict[str, dict[str, object]]]
) -> dict[str, Row]:
    """Give the records of a case to every tool that is there."""
    case = records.case
    rows = kept.setdefault(case.title, {})
    tools: dict[str, Callable[[], Row]] = {
        tool: partial(rival, records, RIVALS[tool], asked) for tool in rivals(case)
    }
    own = list(ours(records, asked.time_limit, asked.seed))
    # of this suite a quick run has the model by name: a fit of seconds
    tools |= dict(own[1:2] if asked.quick else own)
    tools = {tool: work for tool, work in tools.items() if asked.rows in f'{case.title}: {tool}'}
    for tool, work in tools.items():
        if tool not in rows:
            try:
                rows[tool] = asdict(work())
            except (RivalError, PiezoError) as error:
                print(f'{case.title}: {tool} is left out: {error}', flush=True)
                continue
            if asked.results:
                asked.results.write_text(json.dumps(kept, indent=1), encoding='utf-8')
        print(f'{case.title}: {tool}: {rows[tool]["errors"]}', flush=True)
    found = {tool: Row(**rows[tool]) for tool in tools if tool in rows}  # type: ignore[arg-type]
    first = Path(case.tests[0].file).stem
    return dict(sorted(found.items(), key=lambda each: each[1].errors[first]))
