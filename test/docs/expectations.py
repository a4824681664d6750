"""The outcomes that pages state after their commands, and how they are compared.

One expectation is one line::

    file PATH                   the file is there and not empty
    FILE FIELD < NUMBER         a figure of a JSON or YAML file; also > and =, with all of `[*]`
    FILE FIELD contains WORD    a word there is WORD; `lacks`: none is, `only`: all are
    output matches REGEX        what the block printed, to either stream
    refused REGEX               exit code 2 and an error of one line that matches
    live QUANTITY < NUMBER      one of `QUANTITIES`, heard while it runs; also > and =
    live answers /NODE          the parameter service of the node answers
    live serves URL             a page is there
    not run, REASON             no test runs this block

FIELD is a path such as ``runs[-1].rms_m`` or ``effects[*].name``.
"""

from __future__ import annotations

import json
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    '<': operator.lt,
    '>': operator.gt,
    '=': operator.eq,
}
# What a listener measures of running nodes, see live_listener.py.
QUANTITIES = {
    'tracking_rms': 'rms of displacement minus reference, the worst of three stretches [m]',
    'states': 'ticks of the actuator that were heard [1]',
    'not_numbers': 'voltages that are no number while commands are none [1]',
}
STEP = re.compile(r'\[(\*|-?\d+)\]|\.?(\w+)')


@dataclass(frozen=True)
class NotRun:
    """No test runs the block."""

    reason: str


@dataclass(frozen=True)
class Live:
    """What is heard while the block runs: a quantity with its bound, or who answers."""

    quantity: str
    comparison: str
    value: str


@dataclass(frozen=True)
class Outcome:
    """What a block that has ended has left or said."""

    kind: str  # file, figure, words, output, refused
    path: str = ''
    field: str = ''
    comparison: str = ''
    value: str = ''

    def check(self, folder: Path, code: int, output: str) -> None:
        """Compare."""
        if self.kind == 'output':
            assert re.search(self.value, output), f'{self.value!r} is not in {output[-2000:]!r}'
        elif self.kind == 'refused':
            errors = [line for line in output.splitlines() if line.startswith('error: ')]
            assert code == 2, f'exit code {code} in place of 2: {output[-2000:]}'
            assert len(errors) == 1, output[-2000:]
            assert 'Traceback' not in output, output[-2000:]
            assert re.search(self.value, errors[0]), errors[0]
        elif self.kind == 'file':
            path = folder / self.path
            assert path.is_file(), f'{self.path} is not there'
            assert path.stat().st_size > 0, f'{self.path} is empty'
        else:
            self._check_field(values_at(_content(folder / self.path), self.field))

    def _check_field(self, found: list[Any]) -> None:
        shown = f'{self.path} {self.field} is {found}'
        if self.kind == 'words':
            same = [str(each) == self.value for each in found]
            told = {'contains': any(same), 'lacks': not any(same), 'only': found and all(same)}
            assert told[self.comparison], shown
            return
        assert found, shown
        holds = COMPARISONS[self.comparison]
        assert all(holds(float(each), float(self.value)) for each in found), shown


Expectation = NotRun | Live | Outcome

NUMBER = r'[-+.\deE]+'
FORMS: tuple[tuple[str, Callable[..., Expectation]], ...] = (
    (r'not run, (\S.{7,})', NotRun),
    (r'live (answers|serves) (\S+)', lambda verb, whom: Live(verb, '', whom)),
    (rf'live (\w+) ([<>=]) ({NUMBER})', Live),
    (r'file (\S+)', lambda path: Outcome('file', path)),
    (r'output matches (.+)', lambda regex: Outcome('output', value=regex)),
    (r'refused (.+)', lambda regex: Outcome('refused', value=regex)),
    (rf'(\S+\.(?:json|ya?ml)) (\S+) ([<>=]) ({NUMBER})', lambda *words: Outcome('figure', *words)),
    (
        r'(\S+\.(?:json|ya?ml)) (\S+) (contains|lacks|only) (\S+)',
        lambda *words: Outcome('words', *words),
    ),
)


def parse(line: str, where: str = '') -> Expectation:
    """Return the expectation that a line states."""
    for form, make in FORMS:
        if found := re.fullmatch(form, line):
            expectation = make(*found.groups())
            value = getattr(expectation, 'value', '')
            if getattr(expectation, 'comparison', '') in COMPARISONS:
                float(value)
                if isinstance(expectation, Live) and expectation.quantity not in QUANTITIES:
                    break
            if getattr(expectation, 'kind', '') in ('output', 'refused'):
                re.compile(value)
            return expectation
    raise ValueError(
        f'{where}: no expectation has the form {line!r}; see test/docs/expectations.py'
    )


def values_at(content: Any, path: str) -> list[Any]:
    """Return what stands at a path; `[*]` stands for every entry."""
    found = [content]
    for index, name in STEP.findall(path):
        try:
            if index == '*':
                found = [entry for each in found for entry in each]
            else:
                found = [each[int(index) if index else name] for each in found]
        except (KeyError, IndexError, TypeError) as error:
            raise AssertionError(f'there is no {path}: {error!r}') from None
    return found


def _content(path: Path) -> Any:
    assert path.is_file(), f'{path.name} is not there'
    text = path.read_text(encoding='utf-8')
    return json.loads(text) if path.suffix == '.json' else yaml.safe_load(text)
