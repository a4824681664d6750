"""Identify a model from records.

Writes report.html, model.yaml (the model), params.yaml (for ros2 param load) and summary.json to
the output folder. Warnings state what the records do not determine and what to record instead.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.axes import MODES, add_axes_options, identify_several
from piezo_hysteresis.cli.shared_options import (
    add_conditions,
    add_out,
    add_statements,
    statements_of,
)
from piezo_hysteresis.cli.verbosity import progress_bar
from piezo_hysteresis.common.recipes import NAMES
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.process_setup import number_of_workers

EXAMPLE = 'identify out/sweep --model bouc_wen_mode --out out/model'

_METHODS = (
    'output_error (default), rls, rls_ud, pi_bank, pso, pso_modified, de, or of a paper: '
    'fujii2018, tatebatake2017, zhou2021, xiao2014, fang2019'
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('data', nargs='+', metavar='DATA', help='bags, CSV files, or folders of them')
    add(
        '--model',
        metavar='NAME[+BLOCK...]|YAML',
        help=f'{", ".join(NAMES)}, optionally with blocks after a +; or a model.yaml as start; '
        'without it the model that predicts best is selected; modes: several coupled axes',
    )
    add_out(parser)
    add('--method', default='output_error', metavar='NAME', help=_METHODS)
    add(
        '--per-frequency',
        action='store_true',
        help='one more set of parameters and one harmonic order for each drive of the records',
    )
    add('--seed', type=int, default=0, help='seed of the search methods')
    add('--warm-up', type=float, metavar='S', help='initial time excluded from errors [s]')
    add(
        '--frequency',
        type=float,
        metavar='HZ',
        help='drive frequency [Hz], if the data do not contain it',
    )
    add(
        '--before',
        nargs='+',
        type=float,
        default=[],
        metavar='V',
        help='extremes of the voltage before each record, which define its remanence [V]',
    )
    add(
        '--held-out',
        nargs='+',
        default=[],
        metavar='DATA',
        help='held-out data: the discrepancy of the model is estimated from them',
    )
    add_conditions(parser)
    add('--hold', nargs='+', default=[], metavar='NAME=VALUE', help='parameters to fix (SI)')
    add('--set', nargs='+', default=[], metavar='NAME=VALUE', help='start values (SI)')
    add(
        '--weights',
        choices=('equal', 'relative'),
        help='weights of the records: errors in metres, or relative to the displacement',
    )
    add('--whole', action='store_true', help='fit all samples instead of averaged periods')
    add(
        '--no-sampling-offset',
        action='store_true',
        help='do not estimate a clock offset between voltage and displacement',
    )
    add('--max-evaluations', type=int, help='largest number of evaluations of a search')
    add(
        '--swarm',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='constants of a swarm: population, constriction, inertia, inertia_end, own, common, '
        'tolerance',
    )
    add('--forgetting', type=float, help='forgetting factor of a recursive method')
    add(
        '--variant',
        choices=('V0', 'V1', 'V2', 'basic'),
        help='form of rls, by default that of the model: V1 is Fujii 2018 (3), V0 its (10), V2 is '
        'Tatebatake 2017 (10), basic its (18)',
    )
    add('--no-offset', action='store_true', help='rls without an offset, as in the paper')
    add(
        '--p0',
        type=float,
        help='rls: factor of the identity as initial P (default 1, as in the papers)',
    )
    add('--rls-unit', choices=('m', 'mm', 'um', 'nm'), help='working unit of rls (default mm)')
    add(
        '--workers',
        type=int,
        default=1,
        metavar='N',
        help='threads, 0 for one per core; the result does not depend on it',
    )
    add('--actuator', help='actuator, if a bag holds several')
    add_statements(parser)
    add_axes_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Identify and write the results."""
    if arguments.model == MODES:
        return identify_several(arguments)
    from piezo_hysteresis.interface.verbs import identify
    from piezo_hysteresis.reporting.identification_report import write_identification

    options = options_of(arguments)
    with progress_bar(f'{arguments.method} {arguments.model or "automatic model"}') as progress:
        found = identify(arguments.data, progress=progress, **options)
        write_identification(arguments.out, found, found.data, arguments.data)
    _print_result(found, arguments.data, arguments.out)
    return 0


def options_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `piezo_hysteresis.identify` other than the data."""
    from piezo_hysteresis.identification.method_settings import pairs

    return {
        'model': arguments.model,
        'method': arguments.method,
        'per_frequency': arguments.per_frequency,
        'seed': arguments.seed,
        'hold': pairs(arguments.hold),
        'start': pairs(arguments.set),
        'before': tuple(arguments.before),
        'warm_up': arguments.warm_up,
        'frequency': arguments.frequency,
        'held_out': tuple(arguments.held_out),
        'actuator': arguments.actuator,
        'salvage': arguments.salvage,
        'reading': statements_of(arguments),
        **_options(arguments),
    }


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the selected method; options of other methods are rejected."""
    from piezo_hysteresis.identification import methods
    from piezo_hysteresis.identification.method_settings import pairs

    given = {
        'weights': arguments.weights,
        'folded': False if arguments.whole else None,
        'sampling_offset': False if arguments.no_sampling_offset else None,
        'begins': arguments.start if arguments.start != 'auto' else None,
        'zero': arguments.zero if arguments.zero != 'auto' else None,
        'max_evaluations': arguments.max_evaluations,
        'swarm': pairs(arguments.swarm) or None,
        'forgetting': arguments.forgetting,
        'variant': arguments.variant,
        'offset': False if arguments.no_offset else None,
        'unit': arguments.rls_unit,
        'p0': arguments.p0,
        'start': arguments.set or (arguments.model or '').endswith(('.yaml', '.yml')) or None,
    }
    takes = methods.options_of(arguments.method)
    stray = sorted(
        name for name, value in given.items() if value is not None and name not in takes
    )
    if stray:
        called = {'start': 'set', 'begins': 'start', 'unit': 'rls_unit'}
        listed = ', '.join(called.get(name, name) for name in stray)
        raise IdentificationError(
            f'{arguments.method} does not take {listed.replace("_", "-")}; leave it out'
        )
    kept = {k: value for k, value in given.items() if value is not None and k != 'start'}
    return {**kept, 'workers': number_of_workers(arguments.workers)}


def _print_result(found: Any, data: Sequence[str], out: str) -> None:
    """Print parameters with their significant digits, errors and warnings."""
    from piezo_hysteresis.identification.model_discrepancy import discrepancy_text
    from piezo_hysteresis.identification.uncertainty import digits
    from piezo_hysteresis.reporting.display_units import shown
    from piezo_hysteresis.reporting.identification_report import (
        discover_command,
        error_exceeds_noise,
    )

    print(f'{found.chain.name} by {found.method}: {found.message} ({found.seconds:.2f} s)')
    for parameter in found.chain.parameters:
        name = parameter.name
        unit, factor = shown(parameter.unit)
        value = factor * found.values[name]
        if math.isinf(found.std.get(name, 0.0)):
            print(f'  {name:20} {value:>28.2g} {unit} (not determined)')
        elif name in found.std:
            number = digits(value, abs(factor) * found.std[name])
            print(f'  {name:20} {number:>28} {unit}'.rstrip())
        else:
            print(f'  {name:20} {value:>28.6g} {unit} (held)')
    for each in found.records:
        print(
            f'  {each.record}: free run {1e6 * each.free_run_rms:.4g} µm '
            f'({each.nrmse_percent:.3g} %), one step {1e6 * each.one_step_rms:.4g} µm'
        )
    _print_drives(found)
    if found.noise_floor > 0:
        print(f'  noise floor {1e6 * found.noise_floor:.4g} µm')
    if found.discrepancy is not None:
        print('  ' + discrepancy_text(found.discrepancy))
    print(f'written to {out}; open {out}/report.html')
    for warning in found.warnings:
        verbosity.warn(str(warning))
    if error_exceeds_noise(found):
        print(f'next: {discover_command(found.chain, data)}')


def _print_drives(found: Any) -> None:
    """Print one row per drive: its order, and what its model and others leave."""
    if not found.drives:
        return
    print(f'  {"drive":16}{"order":>6}  {"own [µm]":>10}{"of all":>10}{"nearest other":>16}')
    for each in found.drives:
        left = ''.join(
            f'{1e6 * value:>{width}.4g}'
            for value, width in ((each.rms, 10), (each.rms_of_all, 10), (each.rms_left_out, 16))
        )
        print(f'  {each.point.name:16}{each.point.order:>6}  {left}')
