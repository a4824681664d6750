"""List the records, topics and defects of bags and column files.

The exit code is 2 if data are damaged: other verbs then need --salvage.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from piezo_hysteresis.cli.axes import add_axes_options, read_axes, states_axes
from piezo_hysteresis.cli.data_report import axes_table, bag_lines, records_table, topics_table
from piezo_hysteresis.cli.shared_options import add_reading, options_of
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError, SeveralAxesError
from piezo_hysteresis.identification.measurement import measurement_findings
from piezo_hysteresis.records import Survey, survey
from piezo_hysteresis.records.bag_content import read_content
from piezo_hysteresis.records.damage import Damage, DamageLog
from piezo_hysteresis.records.load import interval

EXAMPLE = 'info out/sweep'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('data', nargs='+', metavar='DATA', help='bag folder, .mcap, .db3 or CSV')
    add_reading(parser)
    add_axes_options(parser, patterns=False)


def run(arguments: argparse.Namespace) -> int:
    """Print the content of each data set."""
    findings, options = 0, options_of(arguments)
    options = replace(options, interval=interval(options.interval, arguments.fs))
    for path in map(Path, arguments.data):
        print(f'{path}:')
        if states_axes(arguments):
            findings += _print_axes(path, arguments)
            continue
        try:
            found = survey([path], salvage=True, options=options)
        except SeveralAxesError:
            findings += _print_axes(path, arguments)
            continue
        except RecordError:
            _print_topics(path)
            raise
        findings += _print_survey(found)
    if findings:
        print(
            f'error: {counted(findings, "finding")}; other verbs need --salvage', file=sys.stderr
        )
    return 2 if findings else 0


def _print_survey(found: Survey) -> int:
    for bag in found.bags:
        print('\n'.join([*bag_lines(bag), topics_table(bag), '']))
    print(records_table(found.records))
    for record in found.records:
        for sentence in measurement_findings(record):
            print(f'note: {record.name}: {sentence}')
    return _print_findings(found.notes, found.damage)


def _print_axes(path: Path, arguments: argparse.Namespace) -> int:
    _print_topics(path)
    records, log = read_axes(arguments, [path], salvage=True)
    print(axes_table(records))
    return _print_findings(log.notes, log.findings)


def _print_findings(notes: list[Damage], damages: list[Damage]) -> int:
    for note in notes:
        print(f'note: {note}')
    for damage in damages:
        print(f'damage: {damage}' + (f' ({damage.lost} lost)' if damage.lost else ''))
    return len(damages)


def _print_topics(path: Path) -> None:
    """Print the topics of a bag without records, if there are any."""
    if not path.is_dir() and path.suffix not in ('.mcap', '.db3'):
        return
    try:
        bag = read_content(path, DamageLog(salvage=True))
    except (RecordError, OSError, ValueError):
        return
    if bag.topics:
        print('\n'.join([*bag_lines(bag), topics_table(bag)]))
