"""Verbosity of the command line: results always, other output according to -q and -v."""

from __future__ import annotations

import argparse
import sys
from enum import IntEnum

from piezo_hysteresis.common.wording import OneLineParser


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
