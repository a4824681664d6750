"""Verbs on records of several axes: what ``identify`` and ``validate`` do with them."""

from __future__ import annotations

import argparse
import json

from piezo_hysteresis.cli.axes_options import axes_records_of
from piezo_hysteresis.cli.progress import progress_bar

MODES = 'modes'


def identify_several(arguments: argparse.Namespace) -> int:
    """Identify a modal model and write the results."""
    from piezo_hysteresis.axes.modal_search import identify_axes
    from piezo_hysteresis.process_setup import number_of_workers
    from piezo_hysteresis.reporting.axes_report import mode_rows, write_axes_identification
    from piezo_hysteresis.reporting.folder import check_folder

    records = axes_records_of(arguments)
    check_folder(arguments.out, 'identify')
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
    """Write the error of a modal model on records, by level."""
    from piezo_hysteresis.axes import modal_file
    from piezo_hysteresis.axes.modal_search import levels_of, rms_error
    from piezo_hysteresis.reporting.folder import check_folder, write_folder

    check_folder(arguments.out, 'validate')
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
    write_folder(
        arguments.out, {'summary.json': json.dumps({'records': rows}, indent=1)}, 'validate'
    )
    print(f'written to {arguments.out}/summary.json')
    return 0
