"""Results of the tests of the discovery: how sets are counted, and docs/exams.json.

`python studies/study.py WORLD --exams docs/exams.json` stores what a world has found in place of
what the same world, variant and seed had; `python tools/write_docs.py` then writes docs/exams.md.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / 'docs' / 'exams.json'
#: What is counted, by its key in the file: so many sets of so many.
COUNTS = {
    'first': 'right effect first',
    'class': 'first or in a stated class',
    'pairs': 'both of a pair first',
    'wrong': 'a wrong name',
    'class_without': 'a class without the hidden effect',
    'none': 'unchanged: `none`',
    'outside': 'outside the library: `unknown` or a stated residual',
    'held_out': 'held-out error within 1.2 of the unchanged actuator',
    'worse': 'held-out error increased by more than 2 %',
    'alarms': 'false alarms',
}
#: Names up to which a class counts.
LARGEST_CLASS = 3
Count = tuple[int, int]


class Set(Protocol):
    """A set of records and its verdict."""

    @property
    def kind(self) -> str:
        """One of single, pair, null and outside."""

    @property
    def truth(self) -> set[str]:
        """Names of what is hidden."""

    @property
    def names(self) -> list[str]:
        """What was named, in order."""

    @property
    def classes(self) -> list[tuple[str, ...]]:
        """The class of each named effect, in order."""

    @property
    def right(self) -> bool:
        """Whether the verdict is right, with the hidden effects ranked first."""


def hits(tests: Sequence[bool]) -> Count:
    """Return how many of so many hold."""
    return sum(map(bool, tests)), len(tests)


def counted(sets: Sequence[Set]) -> dict[str, Count]:
    """Return what is counted of every test of the discovery."""

    def of(*kinds: str) -> list[Set]:
        return [each for each in sets if each.kind in kinds]

    hidden = of('single', 'pair')
    found = {
        'first': hits([each.right for each in of('single')]),
        'class': hits([each.truth <= _in_small_classes(each) for each in of('single')]),
        'pairs': hits([each.right for each in of('pair')]),
        'wrong': hits([bool(set(each.names) - each.truth) for each in hidden]),
        'class_without': hits(
            [any(each.truth.isdisjoint(c) for c in each.classes) for each in hidden]
        ),
        'none': hits([each.right for each in of('null')]),
        'outside': hits([each.right for each in of('outside')]),
    }
    return {key: count for key, count in found.items() if count[1]}


def _in_small_classes(found: Set) -> set[str]:
    """Return the names of the classes that are small enough to say something."""
    return {name for names in found.classes if len(names) <= LARGEST_CLASS for name in names}


@dataclass(frozen=True)
class Exam:
    """What a world has found with one seed."""

    world: str
    seed: int | None
    counts: Mapping[str, Count]
    rows: Sequence[Mapping[str, Any]] = ()  # one per set, or per kind of sets with their number
    variant: str = ''
    seconds: float = 0.0  # the longest run
    figures: Mapping[str, Sequence[float]] = field(default_factory=dict)
    commit: str = ''  # of the working tree if empty

    def text(self) -> str:
        """Return the counts as lines."""
        lines = [f'{COUNTS[key]}: {a} of {b}' for key, (a, b) in self.counts.items()]
        lines += [
            f'{name}: {", ".join(f"{v:g}" for v in row)}' for name, row in self.figures.items()
        ]
        return '\n'.join([*lines, f'longest run: {self.seconds:.0f} s on a busy machine'])

    def store(self, path: Path) -> None:
        """Put the exam into a file in place of that of the same world, variant and seed."""
        own = {**asdict(self), 'commit': self.commit or commit(), 'search': 'present'}
        own = {key: value for key, value in own.items() if value or key in ('seed', 'variant')}
        key = self.world, self.variant, self.seed
        exams = read(path)
        same = [k for k, each in enumerate(exams) if key_of(each) == key]
        place = same[0] if same else len(exams)
        path.write_text(written([*exams[:place], own, *exams[place + len(same) :]]), 'utf-8')


def key_of(exam: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return what makes an entry of the file one."""
    return exam['world'], exam['variant'], exam['seed']


def read(path: Path = FILE) -> list[dict[str, Any]]:
    """Return the entries of the file."""
    return list(json.loads(path.read_text('utf-8')))


def written(exams: Sequence[Mapping[str, Any]]) -> str:
    """Return the text of the file: one line per entry, one per row."""
    parts = []
    for exam in exams:
        text = json.dumps({**exam, 'rows': []} if 'rows' in exam else exam, ensure_ascii=False)
        rows = [f'  {json.dumps(row, ensure_ascii=False)}' for row in exam.get('rows', ())]
        parts.append(text.replace('"rows": []', '"rows": [\n' + ',\n'.join(rows) + ']'))
    return '[\n' + ',\n'.join(parts) + '\n]\n'


def commit() -> str:
    """Return the commit of the working tree, empty where there is none to ask."""
    command = ['git', '-C', str(ROOT), 'rev-parse', '--short', 'HEAD']
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ''
