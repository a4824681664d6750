"""Run entries on tasks and keep what came out in one file of results."""

from __future__ import annotations

import importlib
import json
import os
import platform
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from piezo_benchmark import VERSION
from piezo_benchmark.entries import NAMES
from piezo_benchmark.scores import Row, scored
from piezo_benchmark.tasks import Answer, Task, Truth

Entry = Callable[..., Answer]


def entry_named(name: str) -> tuple[Entry, bool, str]:
    """Return the function of an entry, whether it needs the truth, and what it is in a line.

    A name with a dot is a module of somebody else, ``package.module``.
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


def keep(file: Path, name: str, rows: Sequence[Row], seed: int, examiner: str = '') -> None:
    """Add rows of an entry to a file of results; rows of the same tasks are replaced."""
    results = read(file)
    if results.get('seed', seed) != seed:
        raise ValueError(f'{file} holds results of seed {results["seed"]}, not of {seed}')
    results |= {
        'seed': seed,
        'date': time.strftime('%Y-%m-%d'),
        'versions': versions(),
        'hardware': hardware(),
        'examiner': examiner or results.get('examiner', ''),
    }
    before = {row['identifier']: row for row in results['entries'].get(name, [])}
    before |= {row.identifier: asdict(row) for row in rows}
    results['entries'][name] = [before[key] for key in sorted(before)]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(results, indent=0) + '\n', encoding='utf-8')


def annotate(file: Path, note: str) -> None:
    """Keep a sentence with results, for the page."""
    text = json.dumps({**read(file), 'note': note}, indent=0) + '\n'
    file.write_text(text, encoding='utf-8')


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
    """Run entries one after another, each on `workers` tasks at a time; keep every row at once.

    Tasks that the file of results holds already are left out unless `again`.
    """
    for name in names:
        rows: list[Row] = []
        known = {row['identifier'] for row in read(file)['entries'].get(name, []) if not again}
        both = zip(tasks, truths, strict=True)
        left = [pair for pair in both if pair[0].identifier not in known]
        asked = ([pair[place] for pair in left] for place in (0, 1))
        try:
            with ExitStack() as stack:
                each = map
                if workers > 1:
                    each = stack.enter_context(ProcessPoolExecutor(workers)).map
                for row in each(partial(examined, name), *asked):
                    rows.append(row)
                    keep(file, name, [row], seed, examiner)
        except ImportError as error:
            say(f'{name}: left out, {error}')
            continue
        right = sum(row.right for row in rows)
        say(f'{name}: {right:.0f} of {len(rows)} right, {sum(r.seconds for r in rows):.0f} s')
        for failed in sorted({row.failed for row in rows if row.failed}):
            say(f'  failed: {failed}')


def chosen(word: str) -> list[str]:
    """Return the entries that a word stands for."""
    return list(NAMES) if word == 'all' else word.split(',')
