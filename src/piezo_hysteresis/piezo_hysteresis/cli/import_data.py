"""Convert CSV files (or other bags) to one bag, one record per file.

A bag with other message types is imported by the names of its fields:
--voltage /amplifier/command.data --displacement /laser/position.point.x:um, or
--displacement /joint_states.position[stage]. Columns of a CSV file are named in the same way:
--time "Time (s)" --voltage CH1:V --displacement CH2:um, or by their number from 1.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.data_report import print_survey_notes, records_table
from piezo_hysteresis.cli.shared_options import add_reading, options_of
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, Survey, survey, write_bag
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.sampling import resampled

EXAMPLE = "import lab.csv --time 'Time (s)' --voltage CH1:V --displacement CH2:um --out bag"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument(
        'files',
        nargs='+',
        metavar='FILE',
        help='CSV, .mat, .npz, .h5, .xlsx, .parquet, .tdms with columns time_s, voltage_V, '
        'displacement_um (or _m, _mm, _nm; force_N); or bags',
    )
    parser.add_argument('--out', required=True, metavar='BAG', help='bag folder to create')
    parser.add_argument(
        '--storage', default='mcap', help='storage of the bag: mcap (sqlite3 is read only)'
    )
    parser.add_argument(
        '--actuator', help='name of the actuator: assigned to CSV records, selected from a bag'
    )
    parser.add_argument(
        '--resample', type=float, metavar='HZ', help='resample every record to this rate [Hz]; '
        'jittering stamps are interpolated first'
    )  # fmt: skip
    parser.add_argument(
        '--without-steps', action='store_true',
        help='take out jumps of the displacement that stay and that no jump of the input explains '
        '(a counter that slipped or was set to zero)',
    )  # fmt: skip
    add_reading(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read, write and list the records."""
    found = _read(arguments)
    records = [_named(record, arguments.actuator) for record in found.records]
    if arguments.resample is not None:
        records = [resampled(record, arguments.resample) for record in records]
    if arguments.without_steps:
        from piezo_hysteresis.identification.measurement import corrected

        records = [corrected(record) for record in records]
    write_bag(arguments.out, records, storage=arguments.storage)
    if any(record.second is not None for record in records):
        verbosity.warn('a bag has no second channel; give its file to discover')
    print_survey_notes(found)
    print(records_table(records))
    print(f'{counted(len(records), "record")} in {arguments.out}')
    return 0


def _read(arguments: argparse.Namespace) -> Survey:
    options = options_of(arguments)
    if len({'voltage', 'force'} & options.columns.keys()) == 2:
        raise RecordError('the input is a voltage or a force: name one of them')
    log = DamageLog(arguments.salvage, interpolate=arguments.resample is not None)
    return survey(arguments.files, actuator=arguments.actuator, log=log, options=options)


def _named(record: Record, actuator: str | None) -> Record:
    if actuator is None or record.info.actuator:
        return record
    return replace(record, info=replace(record.info, actuator=actuator))
