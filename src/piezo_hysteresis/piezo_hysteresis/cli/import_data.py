"""Turn CSV files (or other bags) into one bag, one record per file.

A bag of other message types is taken in by naming the fields that mean something:
--voltage /amplifier/command.data --displacement /laser/position.point.x:um
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from piezo_hysteresis.cli.data_report import print_survey_notes, records_table
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, Survey, survey, write_bag
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.foreign import foreign_records

HELP = 'CSV files to one bag, one record per file'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of this verb."""
    parser.add_argument(
        'files',
        nargs='+',
        metavar='FILE',
        help='CSV with columns time_s, voltage_V, displacement_um (or _m, _mm, _nm; force_N); '
        'bags are taken too',
    )
    parser.add_argument('--out', required=True, metavar='BAG', help='bag folder to create')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap')
    parser.add_argument(
        '--actuator', help='its name: given to CSV records, chosen among those of a bag'
    )
    parser.add_argument(
        '--salvage', action='store_true', help='keep what is readable of damaged data'
    )
    fields = parser.add_argument_group('bags of other message types')
    for quantity in ('voltage', 'displacement', 'reference'):
        fields.add_argument(f'--{quantity}', metavar='/TOPIC.FIELD[:UNIT]')


def run(arguments: argparse.Namespace) -> int:
    """Read, write and list the records."""
    found = _read(arguments)
    records = [_named(record, arguments.actuator) for record in found.records]
    write_bag(arguments.out, records, storage=arguments.storage)
    print_survey_notes(found)
    print(records_table(records))
    print(f'{len(records)} records in {arguments.out}')
    return 0


def _read(arguments: argparse.Namespace) -> Survey:
    named = [arguments.voltage, arguments.displacement]
    if named == [None, None]:
        return survey(arguments.files, salvage=arguments.salvage, actuator=arguments.actuator)
    if None in named:
        raise RecordError('--voltage and --displacement belong together; name both fields')
    log = DamageLog(arguments.salvage)
    records = [
        record
        for path in arguments.files
        for record in foreign_records(
            path,
            log,
            voltage=arguments.voltage,
            displacement=arguments.displacement,
            reference=arguments.reference,
        )
    ]
    return Survey(records, log.findings, log.notes)


def _named(record: Record, actuator: str | None) -> Record:
    if actuator is None or record.info.actuator:
        return record
    return replace(record, info=replace(record.info, actuator=actuator))
