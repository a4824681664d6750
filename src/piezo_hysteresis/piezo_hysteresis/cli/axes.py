"""Records of several axes: options, and what identify and validate do with them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.cli.shared_options import statements_of
from piezo_hysteresis.cli.verbosity import progress_bar

if TYPE_CHECKING:
    from piezo_hysteresis.axes.axes_record import AxesRecord
    from piezo_hysteresis.records.damage import DamageLog

__all__ = ['add_axes_options', 'axes_records_of', 'read_axes', 'states_axes']

_PATTERN = 'columns, arrays or files of the {}s of all axes by pattern'


def add_axes_options(parser: argparse.ArgumentParser, *, patterns: bool = True) -> None:
    """Add ``--axes``, ``--fs``, ``--periodic`` and, unless it has them, the `patterns`.

    The parser has those of `shared_options.add_statements` as well.
    """
    group = parser.add_argument_group('records of several axes')
    add: Any = group.add_argument
    add('--axes', type=int, metavar='N', help='number of voltages that the records must have')
    if patterns:
        for what, example in (('voltage', "'u*:V'"), ('displacement', "'y*:um'")):
            add(f'--{what}', metavar='PATTERN[:UNIT]',
                help=f'{_PATTERN.format(what)}, as {example}')  # fmt: skip
    add('--fs', type=float, metavar='HZ', help='sampling rate of data without a time')
    add(
        '--periodic', nargs='?', type=int, const=1, metavar='N',
        help='the records are N whole periods of a steady state (default one)',
    )  # fmt: skip


def states_axes(arguments: argparse.Namespace) -> bool:
    """Return whether the options say that the data are of several axes."""
    given = [arguments.voltage or '', arguments.displacement or '']
    by_pattern = any('*' in each or '?' in each for each in given)
    return by_pattern or arguments.axes is not None or arguments.periodic is not None


def axes_records_of(
    arguments: argparse.Namespace, data: Sequence[Any] | None = None
) -> list[AxesRecord]:
    """Return the records of several axes that the arguments name, or those of `data`."""
    from piezo_hysteresis.records.load import warn_of

    records, log = read_axes(arguments, arguments.data if data is None else data)
    warn_of(log)
    return records


def read_axes(
    arguments: argparse.Namespace, data: Sequence[Any], *, salvage: bool = False
) -> tuple[list[AxesRecord], DamageLog]:
    """Return the records of several axes, and what was found while they were read."""
    from piezo_hysteresis.axes.axes_load import AxesReading
    from piezo_hysteresis.records.damage import DamageLog
    from piezo_hysteresis.records.load import interval

    named = {'voltage': arguments.voltage, 'displacement': arguments.displacement}
    given = statements_of(arguments)
    options = replace(
        given,
        columns={what: text for what, text in named.items() if text},
        interval=interval(given.interval, arguments.fs),
        header_row=getattr(arguments, 'header_row', None),
        axes=True,
    )
    log = DamageLog(salvage or arguments.salvage)
    reading = AxesReading(log, options, periodic=arguments.periodic)
    return reading.records(data, arguments.axes), log


MODES = 'modes'


def identify_several(arguments: argparse.Namespace) -> int:
    """Identify a modal model and write the results."""
    from piezo_hysteresis.axes.modal_search import identify_axes
    from piezo_hysteresis.process_setup import number_of_workers
    from piezo_hysteresis.reporting.axes_report import mode_rows, write_axes_identification

    records = axes_records_of(arguments)
    with progress_bar('modes of all axes') as progress:
        found = identify_axes(
            records,
            workers=number_of_workers(arguments.workers),
            report=print,
            progress=lambda fraction: progress(fraction, 'adds effects'),
        )
        write_axes_identification(arguments.out, found, records)
    print(f'{"mode [Hz]":>20}{"damping [%]":>18}{"softening [%]":>15}  shape')
    for frequency, damping, softening, shape in mode_rows(found.model):
        print(f'{frequency:>20}{damping:>18}{softening:>15}  {shape}')
    if found.disturbed:
        print(f'left out as disturbed: {", ".join(found.disturbed)}')
    print(f'written to {arguments.out}; open {arguments.out}/report.html')
    return 0


def validate_several(arguments: argparse.Namespace) -> int:
    """Write the error of a modal model on records, by level, and a page."""
    from piezo_hysteresis.axes import modal_file
    from piezo_hysteresis.axes.modal_search import levels_of, rms_error
    from piezo_hysteresis.reporting.axes_report import write_axes_validation

    model = modal_file.load(arguments.model)
    records = axes_records_of(arguments)
    rows = []
    for level, those in levels_of(records).items():
        for record in those:
            left = rms_error(model, record)
            noise = None if record.noise is None else float(record.noise.mean())
            rows.append(
                {'record': record.name, 'level': level, 'free_run_rms_m': left, 'noise_m': noise}
            )
            known = '' if noise is None else f', noise {1e6 * noise:.4g} µm'
            print(f'{record.name} ({level}): free run {1e6 * left:.4g} µm{known}')
    write_axes_validation(arguments.out, model, records, rows)
    print(f'written to {arguments.out}; open {arguments.out}/report.html')
    return 0


def discover_several(arguments: argparse.Namespace) -> int:
    """Find cross-talk and what modes lack, and write the verdict."""
    from piezo_hysteresis.axes.axes_discovery import discover_axes
    from piezo_hysteresis.errors import IdentificationError
    from piezo_hysteresis.process_setup import number_of_workers
    from piezo_hysteresis.reporting.axes_report import write_axes_discovery

    unused = [each for each in ('reference', 'repeats', 'policy') if getattr(arguments, each)]
    if unused:
        raise IdentificationError(f'--{unused[0]} is of one axis; leave it out')
    records = axes_records_of(arguments)
    with progress_bar(f'discover, baseline {arguments.baseline}') as progress:
        found = discover_axes(
            records,
            arguments.baseline,
            workers=number_of_workers(arguments.workers),
            progress=lambda fraction: progress(fraction, 'adds effects'),
        )
        write_axes_discovery(arguments.out, found, records)
    print(found)
    print(f'written to {arguments.out} ({found.seconds:.1f} s); open {arguments.out}/report.html')
    return 0
