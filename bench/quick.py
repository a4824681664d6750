"""The option `--quick` of each script in `bench/` and `studies/`: the same code made small."""

from __future__ import annotations

import argparse
import atexit
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Options that write into docs/, where figures of small numbers do not belong.
PAGES = ('page', 'picture', 'write', 'exams')


def command_lines() -> list[tuple[str, ...]]:
    """Return every script of `bench/` and `studies/` that can be run, `study.py` by world."""
    from studies.study import WORLDS

    return [
        (str(path), *words)
        for folder in ('bench', 'studies', 'studies/papers')
        for path in sorted((ROOT / folder).glob('*.py'))
        if '\nif __name__ == ' in path.read_text('utf-8')
        for words in (([w] for w in WORLDS) if path.stem == 'study' else [[]])
    ]


def parsed(
    parser: argparse.ArgumentParser, words: Sequence[str] | None = None, **small: object
) -> argparse.Namespace:
    """Add `--quick` to a parser and return what is asked for.

    A quick run keeps its files in a temporary folder, unless `--out` names another.
    """
    numbers = ', '.join(f'{name.replace("_", "-")} {value}' for name, value in small.items())
    parser.add_argument(
        '--quick',
        action='store_true',
        help=f'a run of seconds that shows that this works ({numbers or "as it is"}): '
        'judges no goal, writes no page',
    )
    asked = parser.parse_args(words)
    if not asked.quick:
        return asked
    pages = [f'--{name}' for name in PAGES if getattr(asked, name, None)]
    if pages:
        parser.error(f'--quick writes no page: leave out {" ".join(pages)}')
    out = parser.get_default('out')
    if out is not None:
        small['out'] = _temporary() / Path(out).name
    parser.set_defaults(**small)
    return parser.parse_args(words)


def _temporary() -> Path:
    """Return a folder that goes when this process ends."""
    folder = tempfile.TemporaryDirectory(prefix='quick_')
    atexit.register(folder.cleanup)
    return Path(folder.name)
