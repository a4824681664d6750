"""Measured records and one benchmark: this suite in three ways, and its peers at their best.

    python studies/study.py leaderboard --data ../shared/data --peers PYTHON [PYTHON ...]
        --results studies/peers/leaderboard.json --page docs/leaderboard.md

PYTHON are interpreters with `studies/peers/requirements.txt` and `requirements_jax.txt`, which do
not fit together; a peer runs in the first that has it, and is left out where none has. Each model
is run freely over what it was not fitted to, and no peer is given those samples. The unknown zero
of a test record (P-885) is subtracted from the error of every model. `--results` is written anew;
`--page` fills the tables of a page with its rows and with published figures.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from piezo_hysteresis import identify
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, load
from studies.worlds import mirror
from studies.worlds.stand_ins import records_in

#: A model, its values, and the delay of its samples [s].
Fit: TypeAlias = tuple[Model, Mapping[str, float], float]
ROOT = Path(__file__).resolve().parents[2]
PEERS = ROOT / 'studies' / 'peers' / 'run.py'
RESULTS = PEERS.with_name('leaderboard.json')
MIRROR, AXES = 'Mirror of three piezos', 'suite, `identify` with three axes'
HARMONICS, CYCLES = 20, 3  # of the repetition of cycles
SLOWEST = ('Bouc-Wen benchmark (simulated)', 'jax-sysid, network')


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


def _published(errors: Mapping[str, float], words: str = '', parameters: int = 0) -> Row:
    return Row(parameters, math.nan, words, dict(errors))


#: Rows of tools that have the equation by which the records were simulated.
TRUE_STRUCTURE = ('suite, `bouc_wen_oscillator`', 'suite, discovery from `linear_mode`')
#: Figures that others published, by title.
PUBLISHED: dict[str, dict[str, Row]] = {
    'Bouc-Wen benchmark (simulated)': {
        'state-space network (published)': _published({'test_multisine': 7.5e-6}),
        'PNLSS (published)': _published(
            {'test_multisine': 1.2e-5}, '[arXiv 1610.09138](https://arxiv.org/abs/1610.09138)', 217
        ),
        'dynoNet (published)': _published({'test_multisine': 4.5e-5}),
    },
    MIRROR: {
        f'{name} (published)': _published(
            dict(zip(mirror.LEVELS, (1e-6 * each for each in errors), strict=True)),
            'scored on the test sets',
        )
        for name, errors in mirror.PUBLISHED.items()
        if name != 'noise floor'
    },
}


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


def files_of(case: Case) -> list[str]:
    """Return the files of a case in the folder of the records."""
    return [case.file, *(str(Path(case.file).with_name(test.file)) for test in case.tests)]


def read(case: Case, data: Path) -> Records:
    """Load the records of a case."""
    whole, *tests = (load([data / file])[0] for file in files_of(case))
    return Records(case, whole, tuple(tests))


# This suite


def repeated(records: Records) -> Row:
    """Repeat the last known cycles as a Fourier series: no model, and what a test must exceed."""
    case, train = records.case, records.train
    per = round(1.0 / (case.frequency * train.dt))
    cycles = min(CYCLES, len(train) // per)
    first = len(train) - cycles * per
    lines = np.fft.rfft(np.mean(train.displacement[first:].reshape(cycles, per), 0))
    lines[HARMONICS + 1 :] = 0.0
    run = np.fft.irfft(lines, per)[(np.arange(len(records.whole)) - first) % per]
    words = f'{HARMONICS} harmonics of the last {cycles} known cycles'
    return Row(2 * HARMONICS + 1, 0.0, words, records.errors([run]))


def free_run(test: Test, record: Record, fit: Fit) -> FloatArray:
    """Return a free run; its initial condition and zero come from the known samples alone."""
    model, values, late = fit
    known = round(test.known * len(record)) or len(record)
    choices = RecordAssumptions(start=test.start, zero=test.zero)
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

    if case.frequency and case.known < 1.0:
        yield 'no model: the cycle repeated', partial(repeated, records)
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
        # a peer has no deadline of its own, and its documentation asks for long fits
        allowed = None if asked.time_limit == math.inf else 10.0 * asked.time_limit + 60.0
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


def table(rows: Mapping[str, Row]) -> list[str]:
    """Return rows as a table of a page, the best first, errors in micrometres."""
    columns = list(dict.fromkeys(column for row in rows.values() for column in row.errors))
    lines = ['| tool | ' + ' | '.join(f'{each.replace("_", " ")} [µm rms]' for each in columns)]
    lines[0] += ' | parameters | seconds | model and settings |'
    lines.append('|---|' + '---:|' * (len(columns) + 2) + '---|')
    for tool, row in sorted(rows.items(), key=lambda each: each[1].errors[columns[0]]):
        errors = [1e6 * row.errors[each] if each in row.errors else math.nan for each in columns]
        cells = [figure(each) for each in errors]
        cells += [str(row.parameters or ''), f'{row.seconds:.0f}'.replace('nan', ''), row.words]
        known = ' (**true structure**)' if tool in TRUE_STRUCTURE else ''
        lines.append(f'| {tool}{known} | {" | ".join(cells)} |')
    return lines


def figure(error: float) -> str:
    """Return an error with three digits; nothing if it was not published."""
    if not math.isfinite(error):
        return 'diverges' if math.isinf(error) else ''
    return f'{error:.{max(0, 2 - math.floor(math.log10(error)))}f}'


def rows_of(results: Mapping[str, Any]) -> dict[str, dict[str, Row]]:
    """Return the rows of a file of results by title."""
    return {
        title: {tool: Row(**row) for tool, row in rows.items()}
        for title, rows in results['rows'].items()
    }


def written(page: str, results: Mapping[str, Any]) -> str:
    """Return a page with the tables of results between `<!-- rows: TITLE -->` and the end."""
    rows = rows_of(results)
    parts = {
        f'rows: {title}': '\n'.join(table(rows.get(title, {}) | PUBLISHED.get(title, {})))
        for title in (*rows, *PUBLISHED)
    }
    made = results['made']
    parts['made'] = (
        f'Measured on {made["date"]} by one call in {made["minutes"]:.0f} minutes, at commit '
        f'{made["commit"]} with seed {made["seed"]}, on {made["machine"]}.'
    )

    def filled(match: re.Match[str]) -> str:
        text = parts.get(match[1])
        return match[0] if text is None else f'<!-- {match[1]} -->\n\n{text}\n\n<!-- end -->'

    return re.sub(r'<!-- (rows: [^\n]*|made) -->\n.*?<!-- end -->', filled, page, flags=re.DOTALL)


def made_with(asked: argparse.Namespace) -> dict[str, Any]:
    """Return what figures depend on, without the records."""
    git = ['git', '-C', str(ROOT), 'describe', '--always', '--dirty=+']
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    return {
        'date': datetime.now(UTC).date().isoformat(),
        'commit': commit or 'unknown',
        'seed': asked.seed,
        'time_limit': asked.time_limit,
        'machine': f'{os.cpu_count()} {platform.machine()} cores, which were shared; Python '
        f'{platform.python_version()}, NumPy {np.__version__}',
    }


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    add = parser.add_argument
    add('--data', type=Path, default=Path('../shared/data'))
    add('--peers', nargs='+', default=[sys.executable], metavar='PYTHON', help='with the peers')
    add('--rows', default='', metavar='TEXT', help='only rows whose record or tool contains this')
    add('--results', type=Path, help='file of the rows')


QUICK = {'data': None, 'time_limit': 1.0}


def run(asked: argparse.Namespace) -> str:
    """Return the tables, or the page with them."""
    began = time.monotonic()
    made = made_with(asked)
    rows: dict[str, dict[str, Row]] = {}
    cases = CASES[::2] if asked.quick else CASES  # a sine and a multisine
    results: dict[str, Any] = {}
    with records_in(asked.data, list(dict.fromkeys(chain(*map(files_of, cases))))) as data:
        work = {
            case.title: tools_of(read(case, data), asked)
            for case in cases
            if (data / case.file).exists()
        }
        if asked.data and (asked.data / 'fsm').exists():
            work[MIRROR] = {AXES: partial(mirrored, asked)}
        asks = [
            (title, tool, ask)
            for title, tools in work.items()
            for tool, ask in tools.items()
            if asked.rows in f'{title}: {tool}'
        ]
        # the slowest last: what is there can be read while it runs
        for title, tool, ask in sorted(asks, key=lambda each: each[:2] == SLOWEST):
            try:
                row = ask()
            except (RivalError, PiezoError) as error:
                print(f'{title}: {tool} is left out: {error}', flush=True)
                continue
            rows.setdefault(title, {})[tool] = row
            print(f'{title}: {tool}: {row}', flush=True)
            made['minutes'] = (time.monotonic() - began) / 60.0
            plain = {t: {n: asdict(r) for n, r in those.items()} for t, those in rows.items()}
            results = {'made': made, 'rows': plain}
            if asked.results:
                asked.results.write_text(json.dumps(results, indent=1) + '\n', 'utf-8')
    if asked.page and results:
        return written(asked.page.read_text('utf-8'), results).removesuffix('\n') + '\n'
    lines = [line for title in rows for line in (f'### {title}', '', *table(rows[title]), '')]
    return '\n'.join(lines) + '\n'


def tools_of(records: Records, asked: argparse.Namespace) -> dict[str, Callable[[], Row]]:
    """Return what is to be run on the records of a case."""
    case = records.case
    tools: dict[str, Callable[[], Row]] = {
        tool: partial(rival, records, RIVALS[tool], asked) for tool in rivals(case)
    }
    own = dict(ours(records, asked.time_limit, asked.seed))
    if asked.quick:  # of this suite the model by name alone: a fit of seconds
        by_name = f'suite, `{CASES[0].by_name}`'
        own = {name: work for name, work in own.items() if name.startswith(('no ', by_name))}
    return own | tools


def mirrored(asked: argparse.Namespace) -> Row:
    """Identify the mirror, which has a model of its own for three axes."""
    parser = argparse.ArgumentParser()
    mirror.configure(parser)
    words = ['--train', str(asked.data / 'fsm')]
    began = time.perf_counter()
    found, records = mirror.identified(
        parser.parse_args(words, argparse.Namespace(workers=asked.workers))
    )
    held = [each for each in records if each.name in found.held_out]
    errors = dict(zip(mirror.LEVELS, mirror.metric(found.model, held), strict=True))
    count = sum(part.size for part in found.model.parameters.values())
    steps = ', '.join(f'`{step.effect}`' for step in found.steps)
    return Row(
        count, time.perf_counter() - began,
        f'scored on the held-out realisations on which its effects were chosen: {steps}', errors,
    )  # fmt: skip
