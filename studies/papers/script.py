"""The command line of the scripts that reproduce the figures and tables of one paper."""

from __future__ import annotations

import argparse
import json
import re
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.quick import parsed
from studies.papers.exhibits import Builders, Exhibit, save
from studies.papers.pages import MISSING, one_paper, paper_page


def names(builders: Builders) -> list[str]:
    """Return the names of the figures and tables of a paper, in order."""
    return sorted((each for group, _ in builders for each in group), key=_order)


def entries(builders: Builders, wanted: Sequence[str] = (), quick: bool = False) -> list[Exhibit]:
    """Return figures and tables in order, all if none is `wanted`; groups are made once."""
    found: list[Exhibit] = []
    for group, build in builders:
        if not wanted or set(group) & set(wanted):
            found += [each for each in build(quick) if not wanted or each.name in wanted]
    return sorted(found, key=lambda each: _order(each.name))


def main(paper: str, builders: Builders, words: Sequence[str] | None = None) -> int:
    """Write the requested figures of a paper, their page and their numbers into a folder."""
    key = paper_page(paper).removesuffix('.md')
    parser = argparse.ArgumentParser(
        description=f'Reproduce figures and tables of {paper} with its methods.',
        epilog='figures and tables: ' + ', '.join(each.lower() for each in names(builders)),
    )
    add = parser.add_argument
    add('--figure', type=int, nargs='+', default=[], help='numbers of figures (default: all)')
    add('--table', type=int, nargs='+', default=[], help='numbers of tables (default: all)')
    add('--out', type=Path, metavar='DIR', default=Path('out/papers') / key)
    asked = parsed(parser, words)
    wanted = [f'Figure {k}' for k in asked.figure] + [f'Table {k}' for k in asked.table]
    for name in wanted:
        if name not in names(builders):
            known = ', '.join(each.lower() for each in names(builders))
            reasons = ' '.join(MISSING.get(paper, ()))
            parser.error(f'{name.lower()} is not made here; there are {known}. {reasons}')

    started = time.perf_counter()
    found = entries(builders, wanted, asked.quick)
    asked.out.mkdir(parents=True, exist_ok=True)
    for entry in printed(found):
        save(entry, asked.out)
    (asked.out / f'{key}.md').write_text(one_paper(paper, found, '.'), encoding='utf-8')
    write_numbers(found, asked.out)
    seconds = time.perf_counter() - started
    print(f'{len(found)} figures and tables in {seconds:.0f} s, in {asked.out}')
    return 0


def printed(found: Sequence[Exhibit]) -> Iterator[Exhibit]:
    """Print what came out, one by one."""
    for entry in found:
        print(f'{entry.paper} {entry.name}: {entry.ours}', flush=True)
        yield entry


def write_numbers(found: Sequence[Exhibit], folder: Path) -> None:
    """Write the numbers of figures and tables as ``summary.json``."""
    numbers = {f'{entry.paper} {entry.name}': entry.numbers for entry in found}
    (folder / 'summary.json').write_text(json.dumps(numbers, indent=2) + '\n', encoding='utf-8')


def _order(name: str) -> tuple[bool, int]:
    return name.startswith('Table'), int(re.sub(r'\D', '', name))
