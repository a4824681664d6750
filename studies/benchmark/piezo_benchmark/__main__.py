"""Command line: draw tasks, run and calibrate entries, write the page."""

from __future__ import annotations

import argparse
import os
import sys
from functools import partial
from pathlib import Path

from piezo_benchmark import VERSION, measured
from piezo_benchmark.draw import COUNTS, PRACTICE_SEED, drawn
from piezo_benchmark.entries import CALIBRATED
from piezo_benchmark.entries.calibrated import write
from piezo_benchmark.report import detail, page, pictures
from piezo_benchmark.run import annotate, calibration_row, chosen, pool, read, run
from piezo_benchmark.tasks import Task, Truth, load, load_truths, save, save_truths

LEVELS = sorted({level for level, _ in COUNTS})
ABSENT = (
    f'level measured is omitted: the measured records are not here '
    f'(--data FOLDER or {measured.VARIABLE})'
)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='piezo_benchmark', description=__doc__)
    parser.add_argument('--version', action='version', version=VERSION)
    verbs = parser.add_subparsers(dest='verb', required=True)
    draw = verbs.add_parser('draw', help='write tasks, and their truth apart from them')
    draw.add_argument('--seed', type=int, default=PRACTICE_SEED)
    draw.add_argument('--out', type=Path, help='folder of the tasks, for practice with the truth')
    draw.add_argument('--sealed', type=Path, help='folder; tasks in tasks/, the truth in truth/')
    draw.add_argument('--csv', action='store_true', help='records as CSV files as well')
    go = verbs.add_parser('run', help='run entries on tasks and write results and page')
    go.add_argument('--entry', default='all', help='NAME, NAME,NAME, package.module or all')
    go.add_argument('--seed', type=int, default=PRACTICE_SEED)
    go.add_argument('--sealed', type=Path, help='run on the tasks of this folder instead')
    go.add_argument('--results', type=Path, help='file of the results (JSON)')
    go.add_argument('--examiner', default='', help='who ran a sealed set, for the page')
    go.add_argument('--again', action='store_true', help='also what the results hold already')
    go.add_argument('--page', type=Path, help='page to write (Markdown)')
    tune = verbs.add_parser('calibrate', help='calibrate the probabilities of entries')
    tune.add_argument('--entry', default='all', help='NAME, NAME,NAME or all')
    tune.add_argument('--seed', type=int, action='append', required=True)
    for verb in (draw, go, tune):
        verb.add_argument('--workers', type=int, default=1, help='processes, of one task each')
        verb.add_argument('--data', type=Path, help='folder of the measured records')
        verb.add_argument('--level', action='append', choices=LEVELS, default=[])
        verb.add_argument('--every', type=int, default=1, help='one of so many tasks')
        verb.add_argument('--quick', action='store_true', help='the same as --every 16')
    write = verbs.add_parser('page', help='write the page from results')
    write.add_argument('--results', type=Path, required=True)
    write.add_argument('--page', type=Path, required=True)
    write.add_argument('--note', help='a sentence on these results, kept with them')
    write.add_argument('--causes', type=Path, help='file on causes of errors, kept with them')
    for verb in (go, write):
        verb.add_argument('--pictures', type=Path, help='folder of its pictures (matplotlib)')
    return parser


def _draw(arguments: argparse.Namespace, data: Path | None) -> None:
    tasks, truths = _drawn(arguments, arguments.seed, data)
    folder = arguments.sealed or arguments.out
    if folder is None:
        sys.exit('draw: where to? --out FOLDER or --sealed FOLDER')
    places = (folder / 'tasks', folder / 'truth') if arguments.sealed else (folder, folder)
    for task in tasks:
        save(task, places[0], arguments.csv)
    save_truths(truths, places[1], arguments.seed)
    print(f'{len(tasks)} tasks in {places[0]}, truth in {places[1]}')


def _drawn(
    arguments: argparse.Namespace, seed: int, data: Path | None
) -> tuple[list[Task], list[Truth]]:
    share = 16 if arguments.quick else arguments.every
    with pool(arguments.workers) as workers:
        return drawn(seed, share, data, arguments.level, workers.map)


def _calibrate(arguments: argparse.Namespace, data: Path | None) -> None:
    """Write the calibration of entries from tasks that are not scored."""
    if PRACTICE_SEED in arguments.seed:
        sys.exit(f'calibrate: {PRACTICE_SEED} is the seed of the practice tasks')
    sets = [_drawn(arguments, seed, data) for seed in arguments.seed]
    tasks, truths = ([x for each in sets for x in each[k]] for k in (0, 1))
    for name in CALIBRATED if arguments.entry == 'all' else chosen(arguments.entry):
        with pool(arguments.workers) as workers:
            found = workers.map(partial(calibration_row, name), tasks, truths)
            rows = [each for each in found if each]
        write(name, arguments.seed, rows)
        print(f'{name}: calibrated with {len(rows)} of {len(tasks)} tasks')


def _run(arguments: argparse.Namespace, data: Path | None) -> None:
    seed = arguments.seed
    if arguments.sealed:
        truths = load_truths(arguments.sealed / 'truth')
        tasks = [load(arguments.sealed / 'tasks', truth.identifier) for truth in truths]
    else:
        tasks, truths = _drawn(arguments, seed, data)
    results = arguments.results or Path('out') / f'benchmark_{seed}.json'
    run(
        chosen(arguments.entry),
        tasks,
        truths,
        results,
        seed,
        arguments.again,
        arguments.examiner,
        workers=arguments.workers,
    )
    if arguments.page:
        _page(results, arguments.page, arguments.pictures)


def _page(results: Path, file: Path, folder: Path | None) -> None:
    found = read(results)
    shown = folder is not None and pictures(found, folder)
    at = os.path.relpath(folder, file.parent) if folder is not None and shown else ''
    sealed = [read(other) for other in sorted(results.parent.glob('sealed_*.json'))]
    more = results.with_suffix('.md')
    links = [
        Path(os.path.relpath(a, b.parent)).as_posix() for a, b in ((more, file), (file, more))
    ]
    text = page(found, sealed, Path(at).as_posix() if at else '', links[0])
    file.write_text(text, encoding='utf-8')
    more.write_text(detail(found, links[1]), encoding='utf-8')
    print(f'written to {file} and {more}')


def main() -> None:
    """Do what the command line says."""
    arguments = _parser().parse_args()
    if arguments.verb == 'page':
        if arguments.note is not None:
            annotate(arguments.results, note=arguments.note)
        if arguments.causes is not None:
            text = arguments.causes.read_text(encoding='utf-8')
            annotate(arguments.results, causes=text.splitlines())
        _page(arguments.results, arguments.page, arguments.pictures)
        return
    data = measured.folder(arguments.data)
    if not measured.available(data):
        print(ABSENT)
    {'draw': _draw, 'run': _run, 'calibrate': _calibrate}[arguments.verb](arguments, data)


if __name__ == '__main__':
    main()
