"""Every table and figure of the five papers that can be reproduced, ours beside the paper's.

    python studies/papers.py [--out out/papers] [--page docs/papers.md]

Leaves the pictures, ``papers.md`` that shows them, and ``numbers.json`` in the folder. `--quick`
leaves most frequencies out and draws one picture of each paper.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench.quick import parsed
from studies import papers_fujii, papers_loops, papers_stacks, papers_tatebatake, papers_xiao
from studies.papers_bimorph import FULL, QUICK
from studies.papers_page import Entry, page, save


def reproduce(quick: bool = False) -> list[Entry]:
    """Return every entry; `quick` leaves most frequencies out."""
    length = QUICK if quick else FULL
    return [
        *papers_loops.bimorph_loops(),
        *papers_fujii.entries(length),
        *papers_tatebatake.entries(length),
        *papers_loops.flap_loops(),
        *papers_stacks.flap_entries(quick),
        *papers_xiao.entries(quick),
        *papers_loops.stage_loops(quick),
        *papers_stacks.stage_entries(quick),
    ]


def first_of_each(entries: Sequence[Entry]) -> list[Entry]:
    """Return the first entry of each paper."""
    return list({entry.paper: entry for entry in reversed(entries)}.values())


def main() -> int:
    """Reproduce everything and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('out/papers'))
    parser.add_argument(
        '--page', type=Path, help='write the page there, too, and its pictures beside'
    )
    arguments = parsed(parser)
    begun = time.perf_counter()
    entries = reproduce(arguments.quick)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for entry in entries:
        print(f'{entry.paper} {entry.name}: {entry.ours}', flush=True)
    shown = first_of_each(entries) if arguments.quick else entries
    for entry in shown:
        save(entry, arguments.out)
    (arguments.out / 'papers.md').write_text(page(shown, '.'))
    numbers = {f'{entry.paper} {entry.name}': entry.numbers for entry in entries}
    (arguments.out / 'numbers.json').write_text(json.dumps(numbers, indent=2) + '\n')
    if arguments.page is not None:
        pictures = arguments.page.parent / 'pictures' / 'papers'
        pictures.mkdir(parents=True, exist_ok=True)
        for entry in entries:
            save(entry, pictures, dpi=75)
        arguments.page.write_text(page(entries, 'pictures/papers'))
    print(f'{len(entries)} figures and tables in {time.perf_counter() - begun:.0f} s, '
          f'in {arguments.out}')  # fmt: skip
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
