"""Time and memory of discovery, compared with an earlier commit on the same records.

    python bench/discovery_speed.py [--against COMMIT] [--large]

Each case is made by `piezo_sim`, hides creep and is given to the `discover` of this checkout, and
of the commit where one is named, one after the other, each in a process of its own, after one on
a few short records that compiles. `--large` adds 12 million samples with a time limit, `--cases`
says how many of the others. `--quick` gives four short records 3 s, the search unfinished.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench.quick import parsed

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ('piezo_sim', 'piezo_hysteresis')


@dataclass(frozen=True)
class Case:
    """Records to be made, and how `discover` is asked."""

    name: str  # in the table
    sweep: tuple[str, ...]  # words for `piezo_sim sweep`
    words: tuple[str, ...] = ()  # more words for `discover`


def _sweep(
    frequencies: Sequence[float], amplitudes: str, seconds: float, rate: float
) -> list[str]:
    drives = ','.join(f'{f:g}' for f in frequencies)
    return [
        '--preset', 'fdk_pzba_00030', '--frequencies', drives, '--amplitudes', amplitudes,
        '--seconds', f'{seconds:g}', '--rate', f'{rate:g}', '--set', 'effects.creep=true',
    ]  # fmt: skip


CASES = (
    Case('180 400 samples, 22 records', tuple(_sweep(range(1, 34, 3), '.5,1', 8.2, 1000.0))),
    Case('87 000 samples at 10 kHz', tuple(_sweep((20, 40, 100), '1', 2.9, 10_000.0))),
)
SHORT = Case('few short records', tuple(_sweep((3, 7, 12, 19, 27, 40), '.5,1', 1.0, 1000.0)))
QUICK = Case(
    'four short records', tuple(_sweep((3, 14, 23, 40), '1', 1.0, 1000.0)), ('--time-limit', '3')
)
LARGE = Case(
    '12 million samples, 12 records',
    tuple(_sweep((0.5, 1, 2, 3, 5, 8, 11, 13, 17, 19, 23, 29), '1', 1000.0, 1000.0)),
    ('--time-limit', '300'),
)


def checkout(commit: str, folder: Path) -> Path:
    """Return a checkout of a commit, without a history of its own."""
    packed = subprocess.run(
        ['git', 'archive', commit], cwd=ROOT, check=True, capture_output=True
    ).stdout
    folder.mkdir()
    subprocess.run(['tar', '-x'], cwd=folder, input=packed, check=True)
    return folder


def run(root: Path, words: Sequence[str]) -> tuple[float, float, float, int]:
    """Return seconds, processor seconds, peak memory [GiB] and exit code of a verb."""
    sources = [str(root / 'src' / package) for package in PACKAGES]
    old = os.environ.get('PYTHONPATH', '')
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join([*sources, old])}
    started = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, '-m', *words], env=environment, cwd=root, stdout=subprocess.DEVNULL
    )
    _, status, used = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - started
    spent = used.ru_utime + used.ru_stime
    return seconds, spent, _gibibytes(used), os.waitstatus_to_exitcode(status)


def _gibibytes(used: resource.struct_rusage) -> float:
    return float(used.ru_maxrss) / 2**20


def main() -> None:
    """Make the records, run, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--against', help='a commit')
    parser.add_argument('--large', action='store_true')
    parser.add_argument('--cases', type=int, default=len(CASES))
    arguments = parsed(parser)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        roots = {'here': ROOT}
        if arguments.against:
            roots[arguments.against] = checkout(arguments.against, folder / 'before')
        print(
            '| records | checkout | s | processor s | GiB | named |\n|---|---|---:|---:|---:|---|'
        )
        cases = (SHORT, *CASES[: arguments.cases], *([LARGE] if arguments.large else []))
        for place, case in enumerate((QUICK,) if arguments.quick else cases):
            bag, out = folder / f'bag{place}', folder / f'out{place}'
            run(ROOT, ['piezo_sim', 'sweep', *case.sweep, '--seed', '1', '--out', str(bag)])
            for name, root in roots.items():
                found = out / name
                asked = ['discover', str(bag), '--baseline', 'bouc_wen_mode', *case.words]
                words = ['piezo_hysteresis', *asked, '--out', str(found), '--time-limit', '0']
                if case is SHORT:
                    run(root, words)
                else:
                    _measure(case.name, name, root, words, found)


def _measure(case: str, name: str, root: Path, words: Sequence[str], out: Path) -> None:
    seconds, spent, most, code = run(root, words)
    told = f'exit code {code}'
    if code == 0:
        verdict = json.loads((out / 'verdict.json').read_text(encoding='utf-8'))
        told = ', '.join(e['name'] for e in verdict['effects']) or verdict['verdict']
    print(f'| {case} | {name} | {seconds:.0f} | {spent:.0f} | {most:.2f} | {told} |', flush=True)


if __name__ == '__main__':
    main()
