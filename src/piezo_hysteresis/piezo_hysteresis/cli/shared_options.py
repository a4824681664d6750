"""Options of several verbs, and what they need of ROS."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.common.stated import CLOCKS, STARTS, ZEROS
from piezo_hysteresis.errors import PiezoError

if TYPE_CHECKING:
    from piezo_hysteresis.records.columns import ReadOptions


# Metavars that are units of numbers or names of quantities; `N` is a whole number.
_NUMBER = re.compile(
    'S|HZ|V|V/S|UM|M|V2HZ|P|FACTOR|LOW|HIGH|SLEW|WATT|FARAD|SECONDS|KP|KI|KD|E|RATE|DKP|DKI'
)


def add_options(parser: argparse._ActionsContainer, table: str) -> None:
    """Add the options of a table: ``--name METAVAR = DEFAULT``, two spaces, and the help.

    Further lines of a help are indented. The metavar gives the type: a unit is a number, ``N`` a
    whole number, ``a|b`` one of these words, none is a flag. ``METAVAR...`` takes one or more,
    several metavars take one each; ``!`` is required.
    """
    for row in re.split(r'\n(?!\s)', cleandoc(table)):
        usage, text = re.split(r'\s{2,}', row, maxsplit=1)
        stated, _, default = usage.partition(' = ')
        name, *metavars = stated.split()
        settings = _settings_of(metavars, default) if metavars else {'action': 'store_true'}
        parser.add_argument(name, help=' '.join(text.split()), **settings)


def _settings_of(metavars: list[str], default: str) -> dict[str, Any]:
    """Return the arguments of `add_argument` for an option with values."""
    names = [each.removesuffix('!').removesuffix('...') for each in metavars]
    found: dict[str, Any] = {'metavar': names[0] if len(names) == 1 else tuple(names)}
    if metavars[0].endswith('!'):
        found['required'] = True
    if names[0] == 'N':
        found['type'] = int
    elif _NUMBER.fullmatch(names[0]):
        found['type'] = float
    elif names[0].islower():
        found = {'choices': tuple(names[0].split('|'))}
    if len(names) > 1:
        found['nargs'] = len(names)
    elif metavars[0].endswith('...'):
        found |= {'nargs': '+', 'default': []}
    if default:
        values = [found.get('type', str)(each.strip("'")) for each in default.split(',')]
        found['default'] = values if 'nargs' in found else values[0]
    return found


def add_conditions(parser: argparse.ArgumentParser) -> None:
    """Add ``--start`` and ``--zero``: the initial condition and the zero of the records."""
    add_options(parser, f"""
        --start {'|'.join(STARTS)} = auto  initial condition of the records: at rest at 0 V with a
            step (step), at rest at their first voltage (rest), in their own steady cycle
            (settled), in a state to be estimated (estimate), or estimated from the data (auto)
        --zero {'|'.join(ZEROS)} = auto  zero of the displacement: one for all records (common),
            one for each (record), or estimated from the data (auto)
    """)  # fmt: skip


def add_out(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add ``--out DIR`` and ``--overwrite``; without a default the folder is required."""
    add_options(parser, f"""
        --out DIR{'!' if default is None else f' = {default}'}  folder of the results; earlier
            results of the same verb are replaced
        --overwrite  write also if the folder is not empty
    """)  # fmt: skip


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add what a user may state about files that do not state it: columns, interval, sign."""
    group = add_statements(parser)
    add_options(group, '--time COLUMN[:UNIT]  column of the time (default time_s)')
    for quantity in ('voltage', 'force', 'displacement', 'reference'):
        add_options(group, f"""
            --{quantity} /TOPIC.FIELD[:UNIT]|COLUMN[:UNIT]  field of a bag or column of a file
                with the {quantity}
        """)  # fmt: skip
    add_options(group.add_mutually_exclusive_group(), """
        --header-row N  line of a text file with the column names, from 1
        --skip-rows N  number of lines before the column names
    """)  # fmt: skip


def add_statements(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add what a user may state about files whose columns have names: interval, sign, unit."""
    add_options(parser, '--salvage  use the readable part of damaged data')
    group = parser.add_argument_group('files that do not state everything')
    add_options(group, f"""
        --interval S  sampling interval of files without a time
        --unit UNIT = ''  unit of a displacement that states none
        --time-from {'|'.join(CLOCKS)} = ''  time of the messages of a bag
    """)  # fmt: skip
    add: Any = group.add_argument
    sign = '-1: the sensor measures the distance'
    add('--sign', type=int, choices=(1, -1), default=1, help=sign)
    add('--decimal', choices=('.', ','), default='', help='decimal mark of a text file')
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
