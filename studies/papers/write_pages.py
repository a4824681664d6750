"""Figures and tables of five papers: every one of them, and the pages that show them.

python studies/papers/write_pages.py --page docs/papers.md
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from bench.quick import parsed
from studies.papers import fang2019, fujii2018, tatebatake2017, xiao2014, zhou2021
from studies.papers.other_plants import SECTIONS
from studies.papers.pages import write_pages
from studies.papers.script import entries, printed, write_numbers

PAPERS = (fujii2018, tatebatake2017, zhou2021, xiao2014, fang2019)


def main(words: Sequence[str] | None = None) -> int:
    """Write pages, pictures and numbers."""
    parser = argparse.ArgumentParser(description='Write the pages of the five papers.')
    parser.add_argument('--page', type=Path, metavar='FILE', help='instead of papers.md in --out')
    parser.add_argument('--out', type=Path, metavar='DIR', default=Path('out/papers'))
    asked = parsed(parser, words)
    asked.out.mkdir(parents=True, exist_ok=True)
    papers = (zhou2021,) if asked.quick else PAPERS
    found = [
        each for paper in papers for each in printed(entries(paper.BUILDERS, (), asked.quick))
    ]
    others = {} if asked.quick else {paper: write() for paper, write in SECTIONS.items()}
    write_pages(found, asked.page or asked.out / 'papers.md', others)
    write_numbers(found, asked.out)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
