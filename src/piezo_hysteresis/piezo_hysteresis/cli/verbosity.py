"""Verbosity of the command line: results always, other output according to -q and -v."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum

from piezo_hysteresis.common.wording import OneLineParser
from piezo_hysteresis.reporting.display_units import clock, time_left


class Verbosity(IntEnum):
    """Verbosity levels of stderr."""

    QUIET = 0
    USUAL = 1
    VERBOSE = 2


_level = Verbosity.USUAL


def add_verbosity_options(parser: argparse.ArgumentParser) -> None:
    """Add -q and -v to a verb."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        '-q', '--quiet', action='store_true', help='print no progress, notes and warnings'
    )
    group.add_argument(
        '-v', '--verbose', action='store_true',
        help='print progress as lines, and the traceback of an error',
    )  # fmt: skip


def early_flags(given: list[str]) -> tuple[list[str], list[str]]:
    """Separate -q and -v before the verb from the other arguments."""
    known = ('-q', '--quiet', '-v', '--verbose')
    count = next((k for k, each in enumerate(given) if each not in known), len(given))
    return given[:count], given[count:]


def parsed(given: list[str]) -> argparse.Namespace:
    """Return the verbosity from -q and -v alone."""
    parser = OneLineParser(prog='piezo_hysteresis')
    add_verbosity_options(parser)
    found: argparse.Namespace = parser.parse_args(given)
    return found


def choose(arguments: argparse.Namespace) -> None:
    """Set the verbosity from the parsed arguments."""
    global _level
    quiet, verbose = getattr(arguments, 'quiet', False), getattr(arguments, 'verbose', False)
    _level = Verbosity.QUIET if quiet else Verbosity.VERBOSE if verbose else Verbosity.USUAL


def level() -> Verbosity:
    """Return the verbosity."""
    return _level


def warn(text: str, kind: str = 'warning') -> None:
    """Print a warning (or note) in one line, unless quiet."""
    if _level > Verbosity.QUIET:
        print(f'{kind}: {text}', file=sys.stderr)


Report = Callable[[float, str], None]

# Time between two lines in a pipe [s]; a shorter task prints none.
SELDOM, OFTEN = 30.0, 2.0
# Fraction of the task from which the remaining time is estimated.
ENOUGH = 0.03


@contextmanager
def progress_bar(title: str, limit: float = 0.0) -> Iterator[Report]:
    """Provide a callback ``(fraction, message)`` that prints progress to stderr.

    A task with a time `limit` [s] is never forecast to take longer; 0 is none.
    """
    if level() == Verbosity.QUIET:
        yield lambda fraction, words: None
    elif level() == Verbosity.VERBOSE or not sys.stderr.isatty():
        yield ProgressLines(title, OFTEN if level() == Verbosity.VERBOSE else SELDOM, limit)
    else:
        with _bar(title, limit) as report:
            yield report


class ProgressLines:
    """Prints the progress at most once per interval."""

    def __init__(
        self,
        title: str,
        every: float,  # [s]
        limit: float = 0.0,  # [s]
        now: Callable[[], float] = time.monotonic,  # [s]
    ) -> None:
        self._title, self._every, self._limit, self._now = title, every, limit, now
        self._started = self._printed = now()

    def __call__(self, fraction: float, words: str) -> None:
        """Store the progress, and print it if due."""
        now = self._now()
        if now - self._printed < self._every:
            return
        self._printed = now
        spent = now - self._started
        line = f'{self._title}: {100 * fraction:.0f} %, {words}, {clock(spent)}'
        left = remaining_time_text(fraction, spent, self._limit)
        print(f'{line}{left}', file=sys.stderr, flush=True)


def remaining_time_text(fraction: float, spent: float, limit: float = 0.0) -> str:
    """Return the estimated remaining time within the `limit`, empty if unknown."""
    if not ENOUGH <= fraction < 1.0:
        return ''
    if limit and spent / fraction > limit:
        return f', at most {clock(limit - spent)} left' if spent < limit else ''
    return time_left(fraction, spent)


@contextmanager
def _bar(title: str, limit: float) -> Iterator[Report]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn('{task.description}'), BarColumn(), TimeElapsedColumn(),
               TextColumn('{task.fields[words]}'))  # fmt: skip
    started = time.monotonic()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0, words='')

        def report(fraction: float, words: str) -> None:
            left = remaining_time_text(fraction, time.monotonic() - started, limit)
            bar.update(task, completed=fraction, words=f'{words}{left}')

        yield report
