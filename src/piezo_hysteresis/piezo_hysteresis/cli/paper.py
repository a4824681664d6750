"""Make figures and tables of one of the five papers again, by the paper's own method."""

from __future__ import annotations

import argparse
import importlib
from types import ModuleType

from piezo_hysteresis.errors import PiezoError

HELP = 'figures and tables of the five papers, made again'

# A package on top of this one and of the simulated actuators, found where it is installed.
PACKAGE = 'piezo_papers'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of this verb, where its package is installed."""
    try:
        _command_line().configure(parser)
    except PiezoError:
        parser.add_argument('words', nargs='*', help=f'needs {PACKAGE}, which is not installed')


def run(arguments: argparse.Namespace) -> int:
    """Make what was asked for.

    Raises
    ------
    PiezoError
        If the package of the papers is not installed.
    """
    return int(_command_line().run(arguments))


def _command_line() -> ModuleType:
    try:
        return importlib.import_module(f'{PACKAGE}.cli')
    except ModuleNotFoundError as error:
        if error.name not in (PACKAGE, f'{PACKAGE}.cli'):
            raise
        raise PiezoError(
            f'this verb needs {PACKAGE}: run "make setup", or pip install src/{PACKAGE}'
        ) from None
