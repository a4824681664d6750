"""Compare a saved model with records, and its error with the known discrepancy.

Writes report.html, summary.json and model.yaml: the model with its residual on these
records as its discrepancy. Only records that were not used to identify the model validate it.
"""

from __future__ import annotations

import argparse

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.axes import add_axes_options, validate_several
from piezo_hysteresis.cli.shared_options import (
    add_conditions,
    add_out,
    add_statements,
    statements_of,
)

EXAMPLE = 'validate out/check --model out/model/model.yaml --out out/validation'

LIMITS_HELP = 'state the smallest size of each known effect that these records would show'
_STEADY = 'the same as --start settled'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('data', nargs='+', metavar='DATA', help='bag folders, .mcap/.db3 or CSV files')
    add('--model', required=True, metavar='YAML', help='model file of identify or discover')
    add_out(parser)
    add('--warm-up', type=float, metavar='S', help='initial time excluded from errors [s]')
    add('--steady', action='store_true', help=_STEADY)
    add_conditions(parser)
    add('--actuator', help='actuator, if a bag holds several')
    add_statements(parser)
    add_axes_options(parser)
    add('--detection-limits', action='store_true', help=LIMITS_HELP)


def run(arguments: argparse.Namespace) -> int:
    """Simulate every record and write the errors."""
    from piezo_hysteresis.discovery import limits_of
    from piezo_hysteresis.identification.method_settings import warmed
    from piezo_hysteresis.identification.validate import validate
    from piezo_hysteresis.models import ModelFile
    from piezo_hysteresis.models.modelfile import is_modal
    from piezo_hysteresis.records.load import loaded
    from piezo_hysteresis.reporting.validation_report import limits_line, write_validation

    if is_modal(arguments.model):
        return validate_several(arguments)
    saved = ModelFile.load(arguments.model)
    data = loaded(arguments.data, statements_of(arguments), arguments.salvage, arguments.actuator)
    records = warmed(data, arguments.warm_up)
    begins = 'settled' if arguments.steady else arguments.start
    found = validate(records, saved, begins=begins, zero=arguments.zero)
    limits = limits_of(records, saved) if arguments.detection_limits else ()
    write_validation(
        arguments.out, found, model=arguments.model, data=arguments.data, limits=limits
    )
    for row in found.records:
        print(
            f'{row.record}: free run {1e6 * row.free_run_rms:.4g} µm '
            f'({row.nrmse_percent:.3g} %), one step {1e6 * row.one_step_rms:.4g} µm'
        )
    print(found.remark)
    if limits:
        print(f'  detection limits: {limits_line(limits)}')
    print(f'written to {arguments.out}; open {arguments.out}/report.html')
    for warning in found.warnings:
        verbosity.warn(warning)
    return 0
