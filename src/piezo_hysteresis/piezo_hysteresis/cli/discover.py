"""Find the effects that a model lacks in recorded data.

Writes verdict.json, model.yaml (the baseline with the found effects), params.yaml (for the nodes
feedforward and gap_monitor) and report.html.
"""

from __future__ import annotations

import argparse
from typing import Any

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.axes import MODES, add_axes_options, discover_several, states_axes
from piezo_hysteresis.cli.shared_options import (
    add_conditions,
    add_out,
    add_statements,
    statements_of,
)
from piezo_hysteresis.cli.verbosity import progress_bar
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.process_setup import number_of_workers

EXAMPLE = 'discover out/sweep --baseline bouc_wen_mode --out out/found'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('data', nargs='+', metavar='DATA', help='bags, CSV files, or folders of them')
    add(
        '--baseline',
        required=True,
        metavar='NAME[+BLOCK...]|YAML',
        help='named model, fitted to these data; or model.yaml of other data, kept fixed; of '
        'several axes: gain, modes or their model.yaml',
    )
    add(
        '--reference',
        nargs='+',
        default=(),
        metavar='DATA',
        help='data from before a change: errors of the baseline on them are not reported',
    )
    add(
        '--repeats',
        nargs='+',
        default=(),
        metavar='DATA',
        help='data with nothing changed, at least two records of one drive: how much they differ '
        'is no new effect',
    )
    add_out(parser)
    add(
        '--seed',
        type=int,
        default=0,
        help='seed of all random choices; the same seed gives the same verdict',
    )
    add('--workers', type=int, default=0, metavar='N', help='threads, 0 for one per core')
    add('--warm-up', type=float, metavar='S', help='initial time excluded from errors [s]')
    add_conditions(parser)
    add(
        '--policy',
        nargs='+',
        default=(),
        metavar='NAME=VALUE',
        help='decision thresholds, see docs/reference/policy.md',
    )
    add(
        '--time-limit',
        type=float,
        default=180.0,
        metavar='S',
        help='time after which the search stops with the best model so far and lists the skipped '
        'steps [s]; 0 for no limit',
    )
    add('--actuator', help='actuator, if a bag holds several')
    add(
        '--second',
        metavar='COLUMN[:UNIT]',
        help='column of another sensor, of the charge or of the current: tells a curve of the '
        'sensor from one of the actuator',
    )
    add_statements(parser)
    add_axes_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Discover and write the results."""
    from piezo_hysteresis.models.modelfile import is_modal

    if states_axes(arguments) or arguments.baseline == MODES or is_modal(arguments.baseline):
        return discover_several(arguments)
    from piezo_hysteresis.interface.verbs import discover
    from piezo_hysteresis.reporting.discovery_report import write_discovery

    options = options_of(arguments)
    title = f'discover, baseline {arguments.baseline}'
    with progress_bar(title, arguments.time_limit) as progress:
        found = discover(arguments.data, progress=progress, **options)
        write_discovery(arguments.out, found, arguments.data)
    _print_result(found.verdict, arguments.out)
    for finding in found.check.findings:
        verbosity.warn(str(finding))
    return 0


def options_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `piezo_hysteresis.discover` other than the data."""
    from piezo_hysteresis.identification.method_settings import pairs

    if not arguments.time_limit >= 0.0:
        raise IdentificationError('--time-limit must be 0 (none) or more seconds')
    return {
        'baseline': arguments.baseline,
        'seed': arguments.seed,
        'workers': number_of_workers(arguments.workers),
        'warm_up': arguments.warm_up,
        'actuator': arguments.actuator,
        'salvage': arguments.salvage,
        'reading': _reading(arguments),
        'reference': tuple(arguments.reference),
        'repeats': tuple(arguments.repeats),
        'begins': arguments.start,
        'zero': arguments.zero,
        'policy': pairs(arguments.policy),
        'time_limit': arguments.time_limit,
    }


def _reading(arguments: argparse.Namespace) -> Any:
    """Return what is stated about the files, with the column of the second channel."""
    from dataclasses import replace

    from piezo_hysteresis.records.columns import second_column

    options = statements_of(arguments)
    if arguments.second is None:
        return options
    return replace(options, columns={**options.columns, **second_column(arguments.second)})


def _print_result(verdict: Any, out: str) -> None:
    """Print the verdict, its certainty and the recommended experiments."""
    from piezo_hysteresis.reporting.discovery_report import effect_values, probability_text
    from piezo_hysteresis.reporting.folding import folded
    from piezo_hysteresis.reporting.validation_report import limits_line

    print(verdict.summary)
    for effect in verdict.effects:
        chance = f'probability {effect.probability:.3g}, p {probability_text(effect.p_value)}'
        print(f'  {effect.name} ({chance})')
        for name, value, unit in folded(effect_values(effect)):
            print(f'    {name} {value} {unit}'.rstrip())
        for other in effect.alternatives:
            print(f'    or {other.name} (probability {other.probability:.3g})')
        for near in effect.only_alike:
            print(f'    or {near.name} (within {near.distance:.2g} standard deviations)')
    for lag in verdict.two_way:
        print(f'  up and down differ in {lag}')
    if verdict.unexplained.significant:
        print(f'  remaining residual: {verdict.unexplained.description}')
    if verdict.detection_limits:
        print(f'  detection limits: {limits_line(verdict.detection_limits)}')
    for each in verdict.next_experiments:
        print(f'  next: {each}')
    print(f'written to {out} ({verdict.seconds:.1f} s); open {out}/report.html')
