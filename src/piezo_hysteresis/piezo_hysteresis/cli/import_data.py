"""Turn CSV files (or other bags) into one bag, one record per file."""

from __future__ import annotations

import argparse
from dataclasses import replace

from piezo_hysteresis.cli.data_report import print_survey_notes, records_table
from piezo_hysteresis.records import Record, survey, write_bag

HELP = 'CSV files to one bag, one record per file'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of this verb."""
    parser.add_argument(
        'files', nargs='+', metavar='FILE', help='CSV with columns time_s, voltage_V, '
        'displacement_um (or _m, _mm, _nm; force_N); bags are taken too',
    )  # fmt: skip
    parser.add_argument('--out', required=True, metavar='BAG', help='bag folder to create')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap')
    parser.add_argument(
        '--actuator',
        help='its name: given to CSV records, chosen among those of a bag',
    )
    parser.add_argument(
        '--salvage', action='store_true', help='keep what is readable of damaged data'
    )


def run(arguments: argparse.Namespace) -> int:
    """Read, write and list the records."""
    found = survey(arguments.files, salvage=arguments.salvage, actuator=arguments.actuator)
    records = [_named(record, arguments.actuator) for record in found.records]
    write_bag(arguments.out, records, storage=arguments.storage)
    print_survey_notes(found)
    print(records_table(records))
    print(f'{len(records)} records in {arguments.out}')
    return 0


def _named(record: Record, actuator: str | None) -> Record:
    if actuator is None or record.info.actuator:
        return record
    return replace(record, info=replace(record.info, actuator=actuator))
