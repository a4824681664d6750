"""Nodes: health and the sheet that describes them."""

from __future__ import annotations

import argparse
import re
import shutil
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable

# How long something that happened still counts as present [s].
HOLD = 5.0


class Level(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Health:
    """Health report of a node."""

    level: Level  # OK, warning or error
    message: str  # one sentence
    values: Mapping[str, object] = field(default_factory=dict)


Finding = tuple[Level, str]


def judge(findings: Iterable[Finding], fine: str, values: Mapping[str, object]) -> Health:
    """Return the health from `findings`: the worst level with its sentences."""
    found = list(findings)
    level = max((each for each, _ in found), default=Level.OK)
    worst = [sentence for each, sentence in found if each == level > Level.OK]
    return Health(level, '; '.join(worst) or fine, values)


class CounterWatch:
    """Converts recently increased counters to findings."""

    def __init__(
        self, sentences: Mapping[str, Finding], now: Callable[[], float] = time.monotonic
    ) -> None:  # now [s]
        #: Meaning of an increase of each counter; may be replaced at any time.
        self.sentences = sentences
        self._now = now
        self._before: dict[str, int] = {}
        self._grown: dict[str, float] = {}

    def findings(self, counts: Mapping[str, int]) -> list[Finding]:
        """Return what the growth of `counts` within the last `HOLD` seconds means."""
        now = self._now()
        for name, count in counts.items():
            if count > self._before.get(name, 0):
                self._grown[name] = now
            self._before[name] = count
        return [
            (level, f'{sentence} ({name} {self._before[name]})')
            for name, (level, sentence) in self.sentences.items()
            if now - self._grown.get(name, -HOLD) < HOLD
        ]


_LINK = re.compile(r'\[([^]]+)\]\([^)]+\)')
_ARGUMENTS = '[--help] [--ros-args -p NAME:=VALUE ... --params-file FILE -r __ns:=/NAME]'
_NARROWEST = 60  # columns


def _none() -> dict[str, ParameterTable]:
    return {}


@dataclass(frozen=True)
class NodeSheet:
    """Metadata of a node, for pages and ``--help``."""

    executable: str  # name of the node in `common.registry`
    does: str  # one or two sentences; links as in Markdown
    table: ParameterTable
    subscribes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    services: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    managed: bool = False  # whether it is a lifecycle node
    model: bool = False  # whether it also has the parameters of the loaded model
    more: Callable[[], Mapping[str, ParameterTable]] = _none  # returns further tables by title
    add_options: Callable[[argparse.ArgumentParser], None] | None = None

    def help_text(self, program: str = '') -> str:
        """Return what ``--help`` prints, without an end of line."""
        width = max(_NARROWEST, shutil.get_terminal_size().columns)
        program = program or self.executable
        parser = argparse.ArgumentParser(prog=program, add_help=False)
        if self.add_options is not None:
            self.add_options(parser)
        usage = f'{" ".join(parser.format_usage().split())} {_ARGUMENTS}'
        does = _LINK.sub(r'docs/\1', self.does).replace('`', '')
        parts = [
            textwrap.fill(usage, width, subsequent_indent='    ', break_on_hyphens=False),
            textwrap.fill(does, width),
            '\n'.join(self._interfaces(width)),
        ]
        if self.add_options is not None:
            parts.append(parser.format_help().partition('\n\n')[2].rstrip())
        for title, table in {'parameters': self.table, **self.more()}.items():
            if table.specs:
                rows = [line for spec in table.specs for line in _row(spec, width)]
                parts.append('\n'.join([f'{title}:', *rows]))
        if self.model:
            parts.append('Those of the loaded model appear as model.NAME.')
        parts.append('A parameter with * is fixed once the node runs.')
        return '\n\n'.join(part for part in parts if part)

    def _interfaces(self, width: int) -> Iterator[str]:
        for title, names in (
            ('subscribes to', self.subscribes),
            ('publishes', self.publishes),
            ('services', self.services),
            ('actions', self.actions),
        ):
            if names:
                line = f'{title}: {", ".join(names)}'
                yield textwrap.fill(line, width, subsequent_indent='  ')


def _row(spec: ParameterSpec, width: int) -> list[str]:
    """Return name, sentence and range of a parameter, as wide as the screen."""
    star = ' *' if spec.read_only else ''
    indent = ' ' * 6
    text = f'{spec.description} ({_values(spec)})'
    return [
        f'  {spec.name}{star}',
        *textwrap.wrap(text, width, initial_indent=indent, subsequent_indent=indent),
    ]


def _values(spec: ParameterSpec) -> str:
    """Return the default and the range."""
    if isinstance(spec.default, bool):
        return f'{str(spec.default).lower()}; true or false'
    if spec.choices:
        return f'{spec.default}; one of {", ".join(spec.choices)}'
    if isinstance(spec.default, str):
        return spec.default or 'a text'
    if isinstance(spec.default, list):
        return 'a list of texts' if spec.default == [''] else f'{spec.default}'
    return f'{spec.default:g}; {spec.range_text()}'
