"""Reproduce figures and tables of the five papers with the methods of the papers."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from piezo_hysteresis.errors import PiezoError

HELP = 'reproduce figures and tables of the five papers'
EXAMPLE = 'paper fujii2018 --figure 16'

PAPERS = ('fujii2018', 'tatebatake2017', 'zhou2021', 'xiao2014', 'fang2019')
_NO_PLANTS = (
    'this verb needs the simulated actuators: run "make setup", or pip install src/piezo_sim'
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this verb."""
    add = parser.add_argument
    add('paper', choices=(*PAPERS, 'all'), help='paper, or all five')
    add('--figure', type=int, nargs='+', default=[], help='numbers of figures (default: all)')
    add('--table', type=int, nargs='+', default=[], help='numbers of tables (default: all)')
    add(
        '--out', type=Path, metavar='DIR', default=Path('out/papers'), help='folder of the results'
    )
    add('--page', type=Path, metavar='FILE', help='also write the pages into this file')
    add('--short', action='store_true', help='short runs with one seed and few frequencies')


def run(arguments: argparse.Namespace) -> int:
    """Write the requested figures and pages, and print the numbers.

    Raises
    ------
    PiezoError
        If the package `piezo_sim` is not installed.
    """
    try:
        from piezo_hysteresis.papers import figures
        from piezo_hysteresis.papers.paper_page import page, save, write_pages
    except ModuleNotFoundError as error:
        if error.name != 'piezo_sim':
            raise
        raise PiezoError(_NO_PLANTS) from None

    started = time.perf_counter()
    chosen = PAPERS if arguments.paper == 'all' else (arguments.paper,)
    names = [f'Figure {k}' for k in arguments.figure] + [f'Table {k}' for k in arguments.table]
    if names and arguments.paper == 'all':
        raise PiezoError('--figure and --table need one paper, not all')
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    found = []
    for paper in chosen:
        for entry in figures.entries(paper, names, arguments.short):
            print(f'{entry.paper} {entry.name}: {entry.ours}', flush=True)
            save(entry, out)
            found.append(entry)
    (out / 'papers.md').write_text(page(found, '.'))
    numbers = {f'{entry.paper} {entry.name}': entry.numbers for entry in found}
    (out / 'summary.json').write_text(json.dumps(numbers, indent=2) + '\n')
    if arguments.page is not None:
        write_pages(found, arguments.page)
    seconds = time.perf_counter() - started
    print(f'{len(found)} figures and tables in {seconds:.0f} s, in {out}')
    return 0
