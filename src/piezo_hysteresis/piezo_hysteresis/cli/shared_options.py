"""Options of several verbs: initial condition and zero offset of records, output folder."""

from __future__ import annotations

import argparse

from piezo_hysteresis.identification.initial_conditions.record_start import STARTS
from piezo_hysteresis.identification.initial_conditions.revision import ZEROS

__all__ = ['STARTS', 'START_HELP', 'ZEROS', 'ZERO_HELP', 'add_out']

START_HELP = (
    'initial condition of the records: at rest at 0 V with a step (step), at rest at their first '
    'voltage (rest), in their own steady cycle (settled), in a state to be estimated (estimate), '
    'or estimated from the data (auto)'
)
ZERO_HELP = (
    'zero of the displacement: one for all records (common), one for each (record), or '
    'estimated from the data (auto)'
)


def add_out(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add ``--out DIR`` and ``--overwrite``; without a default the folder is required."""
    parser.add_argument(
        '--out', required=default is None, default=default, metavar='DIR',
        help='folder of the results; earlier results of the same verb are replaced',
    )  # fmt: skip
    parser.add_argument(
        '--overwrite', action='store_true', help='write also if the folder is not empty'
    )
