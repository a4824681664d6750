"""Options of several verbs, and what they need of ROS."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.common.stated import CLOCKS, STARTS, ZEROS
from piezo_hysteresis.errors import PiezoError

if TYPE_CHECKING:
    from piezo_hysteresis.records.columns import ReadOptions


SALVAGE_HELP = 'use the readable part of damaged data'

_START_HELP = (
    'initial condition of the records: at rest at 0 V with a step (step), at rest at their first '
    'voltage (rest), in their own steady cycle (settled), in a state to be estimated (estimate), '
    'or estimated from the data (auto)'
)
_ZERO_HELP = (
    'zero of the displacement: one for all records (common), one for each (record), or '
    'estimated from the data (auto)'
)


def add_conditions(parser: argparse.ArgumentParser) -> None:
    """Add ``--start`` and ``--zero``: the initial condition and the zero of the records."""
    add = parser.add_argument
    add('--start', choices=STARTS, default='auto', help=_START_HELP)
    add('--zero', choices=ZEROS, default='auto', help=_ZERO_HELP)


def add_out(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add ``--out DIR`` and ``--overwrite``; without a default the folder is required."""
    parser.add_argument(
        '--out', required=default is None, default=default, metavar='DIR',
        help='folder of the results; earlier results of the same verb are replaced',
    )  # fmt: skip
    parser.add_argument(
        '--overwrite', action='store_true', help='write also if the folder is not empty'
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add what a user may state about files that do not state it: columns, interval, sign."""
    group = add_statements(parser)
    add: Any = group.add_argument
    add('--time', metavar='COLUMN[:UNIT]', help='column of the time (default time_s)')
    for quantity in ('voltage', 'force', 'displacement', 'reference'):
        add(
            f'--{quantity}',
            metavar='/TOPIC.FIELD[:UNIT]|COLUMN[:UNIT]',
            help=f'field of a bag or column of a file with the {quantity}',
        )
    rows = group.add_mutually_exclusive_group()
    rows.add_argument('--header-row', type=int, metavar='N',
                      help='line of a text file with the column names, from 1')  # fmt: skip
    rows.add_argument('--skip-rows', type=int, metavar='N',
                      help='number of lines before the column names')  # fmt: skip


def add_statements(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add what a user may state about files whose columns have names: interval, sign, unit."""
    parser.add_argument('--salvage', action='store_true', help=SALVAGE_HELP)
    group = parser.add_argument_group('files that do not state everything')
    add: Any = group.add_argument
    add('--interval', type=float, metavar='S', help='sampling interval of files without a time')
    add(
        '--sign', type=int, choices=(1, -1), default=1, help='-1: the sensor measures the distance'
    )
    add('--unit', default='', metavar='UNIT', help='unit of a displacement that states none')
    add('--decimal', choices=('.', ','), default='', help='decimal mark of a text file')
    add('--time-from', choices=CLOCKS, default='', help='time of the messages of a bag')
    return group


def statements_of(arguments: argparse.Namespace) -> ReadOptions:
    """Return what `add_statements` asked."""
    from piezo_hysteresis.records.columns import ReadOptions

    return ReadOptions(
        interval=arguments.interval,
        sign=float(arguments.sign),
        unit=arguments.unit,
        decimal=arguments.decimal,
        time_from=arguments.time_from,
    )


def options_of(arguments: argparse.Namespace) -> ReadOptions:
    """Return what `add_reading` asked."""
    from dataclasses import replace

    quantities = ('time', 'voltage', 'force', 'displacement', 'reference')
    return replace(
        statements_of(arguments),
        columns={
            what: text for what in quantities if (text := getattr(arguments, what)) is not None
        },
        header_row=(
            arguments.header_row if arguments.skip_rows is None else arguments.skip_rows + 1
        ),
    )


_NOT_SOURCED = (
    'this verb needs ROS 2 and {} is not there; '
    'run `source setup.bash` at the root of the workspace first'
)

ROS_PACKAGES = (
    'ament_index_python',
    'builtin_interfaces',
    'diagnostic_msgs',
    'lifecycle_msgs',
    'piezo_interfaces',
    'rcl_interfaces',
    'rclpy',
    'rosgraph_msgs',
    'std_msgs',
    'std_srvs',
)


@contextmanager
def ros_needed() -> Iterator[None]:
    """Convert import errors of `nodes` and other ROS 2 modules to one error message."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or '').split('.')[0]
        if missing not in ROS_PACKAGES:
            raise
        raise PiezoError(_NOT_SOURCED.format(missing)) from None


def installed(package: str) -> Path:
    """Return the installation folder of a package of the workspace."""
    try:
        from ament_index_python.packages import PackageNotFoundError, get_package_prefix
    except ModuleNotFoundError:
        raise PiezoError(_NOT_SOURCED.format('ament_index_python')) from None
    try:
        return Path(get_package_prefix(package))
    except PackageNotFoundError:
        raise PiezoError(_NOT_SOURCED.format(package)) from None
