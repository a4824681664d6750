"""Run a saved model over records and say how far it is off, and whether that is more than known.

Writes report.html, summary.json, figures and model.yaml: the model with what it misses on these
records as its discrepancy. Records that were not used to identify the model are the ones that
count.
"""

from __future__ import annotations

import argparse
import json
import time

from piezo_hysteresis.cli import talk
from piezo_hysteresis.cli.shared_options import START_HELP, STARTS, ZERO_HELP, ZEROS, add_out
from piezo_hysteresis.models import ModelFile

HELP = 'free-run and one-step errors of a saved model'

_STEADY = 'the same as --start settled'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of this verb."""
    add = parser.add_argument
    add('data', nargs='+', metavar='DATA', help='bag folders, .mcap/.db3 or CSV files')
    add('--model', required=True, metavar='YAML', help='what identify or discover wrote')
    add_out(parser)
    add('--warm-up', type=float, metavar='S', help='seconds that errors leave out')
    add('--steady', action='store_true', help=_STEADY)
    add('--start', choices=STARTS, default='auto', help=START_HELP)
    add('--zero', choices=ZEROS, default='auto', help=ZERO_HELP)
    add('--actuator', help='which actuator, where a bag holds several')


def run(arguments: argparse.Namespace) -> int:
    """Simulate every record and write the errors."""
    from dataclasses import replace

    from piezo_hysteresis.identification.clock import clock_of
    from piezo_hysteresis.identification.comparison import (
        compared,
        comparison_summary,
        comparison_words,
    )
    from piezo_hysteresis.identification.discrepancy import discrepancy_of, residuals_of
    from piezo_hysteresis.identification.errors import free_run_of, judged, views_of
    from piezo_hysteresis.identification.identify import record_summary
    from piezo_hysteresis.identification.initial_conditions.revision import Choices
    from piezo_hysteresis.identification.noise import floor_of
    from piezo_hysteresis.identification.settings import warmed
    from piezo_hysteresis.identification.units import require_plausible
    from piezo_hysteresis.records import load
    from piezo_hysteresis.records.fingerprint import fingerprints
    from piezo_hysteresis.reporting.folder import check_folder, write_folder
    from piezo_hysteresis.reporting.identification_figures import figures
    from piezo_hysteresis.reporting.validation_report import validation_page

    started = time.perf_counter()
    check_folder(arguments.out, 'validate')
    saved = ModelFile.load(arguments.model)
    records = load(arguments.data, actuator=arguments.actuator)
    records = warmed(records, arguments.warm_up)
    warnings = require_plausible(records)
    late = saved.sampling_offset
    choices = Choices('settled' if arguments.steady else arguments.start, arguments.zero)
    views = views_of(saved.model, saved.values, records, late, choices)
    late = clock_of(saved, views)
    rows = judged(saved.model, saved.values, views, late)
    simulated = {v.name: free_run_of(saved.model, saved.values, v, late) for v in views}
    noise = floor_of(records).rms
    left = residuals_of(saved.model, saved.values, records, views, late)
    known = compared(left, saved.discrepancy) if saved.discrepancy is not None else []
    known_records = (*saved.provenance.records, *fingerprints(records))
    updated = replace(
        saved,
        discrepancy=discrepancy_of(left, held_out=True),
        provenance=replace(saved.provenance, records=known_records),
    )
    summary = {
        'model': saved.model.name,
        'method': 'validate',
        'parameters': {
            q.name: {
                'value': float(saved.values[q.name]),
                'std': saved.deviations.get(q.name),
                'unit': q.unit,
            }
            for q in saved.model.parameters
        },
        'records': [record_summary(row) for row in rows],
        'noise_floor_rms_m': noise if noise > 0 else None,
        'sampling_offset_s': late,
        'discrepancy': comparison_summary(known, saved.discrepancy),
        'warnings': warnings,
        'seconds': time.perf_counter() - started,
    }
    remarks = comparison_words(known, saved.discrepancy)
    write_folder(
        arguments.out,
        {
            'report.html': validation_page(
                saved,
                records,
                simulated,
                rows,
                noise,
                [remarks, *map(str, warnings)],
                model=arguments.model,
                data=arguments.data,
            ),
            'summary.json': json.dumps(summary, indent=2, allow_nan=False) + '\n',
            'model.yaml': updated.text(),
            **figures(records, simulated, rows, noise_floor=noise),
        },
        'validate',
    )
    for row in rows:
        print(
            f'{row.record}: free run {1e6 * row.free_run_rms:.4g} µm '
            f'({row.nrmse_percent:.3g} %), one step {1e6 * row.one_step_rms:.4g} µm'
        )
    print(remarks)
    print(f'written to {arguments.out}; open {arguments.out}/report.html')
    for warning in warnings:
        talk.warn(str(warning))
    return 0
