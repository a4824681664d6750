"""Run entries on tasks and keep what came out in one file of results."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import platform
import resource
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from piezo_benchmark import VERSION
from piezo_benchmark.entries import NAMES
from piezo_benchmark.entries.calibrated import chances_row
from piezo_benchmark.scores import Row, scored
from piezo_benchmark.tasks import Answer, Task, Truth

Entry = Callable[..., Answer]


def entry_named(name: str) -> tuple[Entry, bool, str]:
    """Return the function of an entry, whether it needs the truth, and what it is in a line.

    A name with a dot is a module of another package, ``package.module``.
    """
    module = importlib.import_module(name if '.' in name else f'piezo_benchmark.entries.{name}')
    said = (module.__doc__ or name).strip().split('\n')[0]
    return module.answer, bool(getattr(module, 'NEEDS_TRUTH', False)), said


def examined(name: str, task: Task, truth: Truth) -> Row:
    """Ask one entry and score its answer; an entry that fails has given no answer."""
    function, needs_truth, _ = entry_named(name)
    started, failed = time.perf_counter(), ''
    try:
        answer = function(task, truth) if needs_truth else function(task)
    except ImportError:
        raise
    except Exception as error:  # whatever an entry raises is its failure and no one else's
        answer, failed = Answer({}), f'{type(error).__name__}: {error}'
    return scored(task, truth, answer, time.perf_counter() - started, failed)


def calibration_row(name: str, task: Task, truth: Truth) -> dict[str, Any]:
    """Return what a task adds to the calibration of an entry; nothing if the entry fails."""
    module = importlib.import_module(f'piezo_benchmark.entries.{name}')
    try:
        return chances_row(task, module.statement(task), truth.outcome)
    except RuntimeError:
        return {}


def versions() -> dict[str, str]:
    """Return versions of what decides numbers."""
    found = {'piezo_benchmark': VERSION, 'python': platform.python_version()}
    for package in ('numpy', 'scipy', 'pysindy', 'sysidentpy'):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = 'not installed'
    return found


def hardware() -> dict[str, str]:
    """Return what seconds depend on, without names."""
    return {
        'cores': str(os.cpu_count()),
        'architecture': platform.machine(),
        'system': platform.system(),
    }


def read(file: Path) -> dict[str, Any]:
    """Return results that were kept, or none yet."""
    if file.exists():
        found: dict[str, Any] = json.loads(file.read_text(encoding='utf-8'))
        if found.get('version') == VERSION:
            return found
    return {'version': VERSION, 'entries': {}}


def keep(file: Path, results: Mapping[str, Any]) -> None:
    """Write results with one row to a line."""
    head = {key: value for key, value in results.items() if key != 'entries'}
    entries = ',\n'.join(
        f'{json.dumps(name)}: [\n' + ',\n'.join(json.dumps(row) for row in rows) + '\n]'
        for name, rows in results['entries'].items()
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({**head, 'entries': {}}, indent=1)
    file.write_text(text.removesuffix('{}\n}') + f'{{\n{entries}}}\n}}\n', encoding='utf-8')


def annotate(file: Path, **notes: str | list[str]) -> None:
    """Keep sentences with results, for the page."""
    keep(file, {**read(file), **notes})


def pool(workers: int) -> ProcessPoolExecutor:
    """Return worker processes of one thread each."""
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
        os.environ.setdefault(name, '1')
    return ProcessPoolExecutor(workers, multiprocessing.get_context('spawn'))


def processor_seconds() -> float:
    """Return the processor time of this process and of all that have ended [s]."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def run(
    names: Sequence[str],
    tasks: Sequence[Task],
    truths: Sequence[Truth],
    file: Path,
    seed: int,
    again: bool = False,
    examiner: str = '',
    say: Callable[[str], None] = print,
    workers: int = 1,
) -> None:
    """Run entries one after another, each on `workers` tasks at a time; keep rows as they come.

    Tasks that the file of results holds already are omitted unless `again`.

    Raises
    ------
    ValueError
        If the file holds results of another seed.
    """
    results = read(file)
    if results.get('seed', seed) != seed:
        raise ValueError(f'{file} holds results of seed {results["seed"]}, not of {seed}')
    results |= {
        'seed': seed,
        'date': time.strftime('%Y-%m-%d'),
        'versions': versions(),
        'hardware': {**hardware(), 'workers': str(workers)},
        'examiner': examiner or results.get('examiner', ''),
    }
    for name in names:
        known = {} if again else {r['identifier']: r for r in results['entries'].get(name, [])}
        both = zip(tasks, truths, strict=True)
        left = [pair for pair in both if pair[0].identifier not in known]
        asked = ([pair[place] for pair in left] for place in (0, 1))
        began, used, kept, rows = time.monotonic(), processor_seconds(), 0.0, []
        try:
            with ExitStack() as stack:
                each = stack.enter_context(pool(workers)).map if workers > 1 else map
                for row in each(partial(examined, name), *asked):
                    rows.append(row)
                    known[row.identifier] = asdict(row)
                    results['entries'][name] = [known[key] for key in sorted(known)]
                    if time.monotonic() - kept > 10.0:
                        keep(file, results)
                        kept = time.monotonic()
        except ImportError as error:
            say(f'{name}: omitted, {error}')
            continue
        wall, used = time.monotonic() - began, processor_seconds() - used
        if rows:
            cost = {'tasks': len(rows), 'wall_s': round(wall, 1), 'processor_s': round(used, 1)}
            results.setdefault('cost', {})[name] = cost
        keep(file, results)
        right = sum(row.right for row in rows)
        say(f'{name}: {right:.0f} of {len(rows)} right, {wall:.0f} s, processor {used:.0f} s')
        for failed in sorted({row.failed for row in rows if row.failed}):
            say(f'  failed: {failed}')


def chosen(word: str) -> list[str]:
    """Return the entries that a word stands for."""
    return list(NAMES) if word == 'all' else word.split(',')
