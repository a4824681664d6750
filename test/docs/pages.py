"""Reads the command blocks of a page and the outcome that its source states for each.

A block is fenced or indented. One that is fenced as ``bash`` or ``python``, or that names no
language, is typed by the reader and needs an expectation: an HTML comment behind it, one
expectation per line, see `expectations.py`. One whose first line is a comment with a file's name
is saved under it. Two more comments are read::

    <!-- given: COMMAND -->     makes what a reader has at hand; runs before the next block
    <!-- Ctrl-C -->             ends what runs in terminals so far; the end of a page does so, too
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from expectations import Expectation, Live, NotRun, parse

ROOT = Path(__file__).parents[2]
FILE = re.compile(r'# ([\w./-]+\.(?:py|yaml))(?::[^\n]*)?\n')
COMMENT = re.compile(r'<!--(.*?)-->', re.DOTALL)

# Pages written from docstrings, tables and --help; their generators are tested by themselves.
GENERATED = ('docs/reference',)


@dataclass
class Block:
    """A block of a page."""

    language: str  # behind the fence; empty where nothing is, and for an indented block
    text: str  # its lines, without the indentation
    line: int  # its first line in the page
    given: list[str] = field(default_factory=list)  # commands that make what a reader has at hand
    expected: list[Expectation] = field(default_factory=list)  # what its outcome is compared with
    ctrl_c: bool = False  # whether the terminals before it have been ended

    @property
    def file(self) -> str | None:
        """Name under which the reader is to save it: its first line is a comment with a path."""
        found = FILE.match(self.text)
        return found.group(1) if found else None

    @property
    def is_command(self) -> bool:
        """Whether a reader types it."""
        return self.language in ('', 'bash', 'python') and self.file is None

    @property
    def is_live(self) -> bool:
        """Whether it runs until Ctrl-C, each line in a terminal of its own."""
        return any(isinstance(each, Live) for each in self.expected)

    @property
    def not_run(self) -> str | None:
        """Why no test runs it; None where one does."""
        return next((each.reason for each in self.expected if isinstance(each, NotRun)), None)


def pages() -> list[Path]:
    """Return every page that is written by hand."""
    found = [*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')]
    return sorted(p for p in found if not p.relative_to(ROOT).as_posix().startswith(GENERATED))


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in order."""
    blocks: list[Block] = []
    given: list[str] = []
    ctrl_c = False
    for line, language, text in _pieces(page.read_text(encoding='utf-8')):
        where = f'{page.relative_to(ROOT)}:{line}'
        word, _, rest = text.partition(':') if language is None else ('', '', '')
        if language is not None:
            blocks.append(Block(language, text, line, given, [], ctrl_c))
            given, ctrl_c = [], False
        elif word.strip() == 'expect':
            if not blocks or given or ctrl_c:
                raise ValueError(f'{where}: no block stands before this expectation')
            for each in filter(None, map(str.strip, rest.splitlines())):
                blocks[-1].expected.append(parse(each, where))
        elif word.strip() == 'given':
            given.extend(filter(None, map(str.strip, rest.splitlines())))
        elif text.strip() == 'Ctrl-C':
            ctrl_c = True
    if given:
        raise ValueError(f'{page.relative_to(ROOT)}: no block stands behind {given[-1]}')
    return blocks


def _pieces(text: str) -> Iterator[tuple[int, str | None, str]]:
    """Yield line, language and text of blocks and comments; the language of a comment is None."""
    lines = text.split('\n')
    at = 0
    while at < len(lines):
        line, begin = lines[at], at
        if fence := re.fullmatch(r'( *)```(\w*)', line):  # indented in an entry of a list
            while lines[at := at + 1] != f'{fence.group(1)}```':
                pass
            inside = textwrap.dedent('\n'.join(lines[begin + 1 : at]))
            yield begin + 1, fence.group(2), inside + '\n'
        elif line.startswith('    ') and not lines[at - 1].strip():
            while at < len(lines) and (lines[at].startswith('    ') or not lines[at].strip()):
                at += 1
            block = textwrap.dedent('\n'.join(lines[begin:at])).strip('\n')
            at -= 1
            yield begin + 1, '', block + '\n'
        elif line.startswith('<!--'):
            while '-->' not in lines[at]:
                at += 1
            for found in COMMENT.finditer('\n'.join(lines[begin : at + 1])):
                yield begin + 1, None, found.group(1).strip()
        at += 1
