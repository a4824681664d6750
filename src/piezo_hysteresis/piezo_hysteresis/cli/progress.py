"""Progress and remaining time of long tasks: a bar on a terminal, occasional lines in a pipe."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from piezo_hysteresis.cli.verbosity import Verbosity, level
from piezo_hysteresis.reporting.display_units import clock, time_left

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
