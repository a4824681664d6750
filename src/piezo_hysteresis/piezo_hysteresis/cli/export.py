"""Write every record of the data as a file, with its annotations in records.yaml.

A MODEL.yaml becomes a C library instead: compensator and plant with bit-identical results.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import asdict
from pathlib import Path

import yaml

from piezo_hysteresis.cli import export_library
from piezo_hysteresis.cli.data_report import print_survey_notes
from piezo_hysteresis.cli.shared_options import add_out
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.records import Record, survey, write_csv
from piezo_hysteresis.records.columns import LENGTHS
from piezo_hysteresis.records.formats.reading import WRITTEN, write_table
from piezo_hysteresis.records.tabular import INFO_FILE
from piezo_hysteresis.reporting.folder import replacing

# File name extensions of models.
MODELS = ('.yaml', '.yml')

EXAMPLE = 'export out/sweep --format mat --out matlab'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument(
        'data', nargs='+', metavar='DATA', help='bag folder, .mcap, .db3 or CSV; or MODEL.yaml'
    )
    add_out(parser)
    _configure_records(parser)
    export_library.configure(parser)


def _configure_records(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--unit', choices=('m', 'mm', 'um', 'nm'), default='um',
        help='unit of the displacement; m keeps every digit',
    )  # fmt: skip
    parser.add_argument(
        '--format', choices=('csv', *WRITTEN), default='csv', help='format of the files'
    )
    parser.add_argument('--actuator', help='actuator, if a bag holds several')
    parser.add_argument(
        '--salvage', action='store_true', help='keep the readable part of damaged data'
    )


def _refuse_unknown(arguments: argparse.Namespace, of_model: bool) -> None:
    """Reject the options of the other kind of export."""
    parsers = argparse.ArgumentParser(), argparse.ArgumentParser()
    _configure_records(parsers[0])
    export_library.configure(parsers[1])
    for action in parsers[not of_model]._actions:
        if getattr(arguments, action.dest, action.default) != action.default:
            raise PiezoError(
                f'{action.option_strings[0]} belongs to the export of '
                f'{"records" if of_model else "a MODEL.yaml"}; leave it out'
            )


def run(arguments: argparse.Namespace) -> int:
    """Write all files; none after an error."""
    of_model = any(Path(each).suffix in MODELS for each in arguments.data)
    _refuse_unknown(arguments, of_model)
    if of_model:
        return export_library.run(arguments)
    found = survey(arguments.data, salvage=arguments.salvage, actuator=arguments.actuator)
    folder = Path(arguments.out)
    with replacing(folder, 'export') as made:
        _write(made, found.records, arguments.unit, arguments.format)
    print_survey_notes(found)
    print(f'{counted(len(found.records), "file")} in {folder}')
    return 0


def _write(folder: Path, records: list[Record], unit: str, kind: str) -> None:
    assert unit in LENGTHS
    notes: dict[str, dict[str, object]] = {}
    for record in records:
        stem = re.sub(r'[^\w.+-]+', '_', record.name).strip('.') or 'record'
        name, number = f'{stem}.{kind}', 2
        while name.lower() in {taken.lower() for taken in notes}:
            name, number = f'{stem}-{number}.{kind}', number + 1
        if kind == 'csv':
            write_csv(folder / name, record, unit=unit)
        else:
            write_table(folder / name, record, unit=unit)
        notes[name] = {'record': record.name, 'rate': record.rate, **asdict(record.info)}
    text = yaml.safe_dump(notes, sort_keys=False)
    (folder / INFO_FILE).write_text(text, 'utf-8')
