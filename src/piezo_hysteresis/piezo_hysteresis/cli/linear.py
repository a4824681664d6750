"""Fit a transfer function to records of small displacements, for the H-infinity design.

Writes one YAML file with numerator and denominator in s, from volt to metre; compensate reads it
with --transfer-function, the feedback node as plant.numerator and plant.denominator.
"""

from __future__ import annotations

import argparse

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.shared_options import add_statements, statements_of

_POOR = 10.0  # largest residual of a linear model, in percent of the motion

EXAMPLE = 'linear small.csv --out plant.yaml'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('data', nargs='+', metavar='DATA', help='bag folders, .mcap/.db3 or CSV files')
    add('--out', required=True, metavar='YAML', help='file of the transfer function')
    add('--poles', type=int, default=3, help='order of the denominator')
    add('--zeros', type=int, default=1, help='order of the numerator')
    add(
        '--method',
        choices=('refined', 'arx'),
        default='refined',
        help='refined: errors of the free run (Steiglitz and McBride); arx: as in Xiao 2014',
    )
    add('--warm-up', type=float, metavar='S', help='initial time excluded [s]')
    add('--actuator', help='actuator, if a bag holds several')
    add_statements(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fit and write the file."""
    import numpy as np

    from piezo_hysteresis.identification.arx import fit_transfer_function
    from piezo_hysteresis.identification.checks import require_each_usable
    from piezo_hysteresis.identification.method_settings import warmed
    from piezo_hysteresis.records.load import loaded

    data = loaded(arguments.data, statements_of(arguments), arguments.salvage, arguments.actuator)
    records = warmed(data, arguments.warm_up)
    for sentence in require_each_usable(records):
        verbosity.warn(sentence)
    more = {'rounds': 0} if arguments.method == 'arx' else {}
    found = fit_transfer_function(records, arguments.poles, arguments.zeros, **more)
    found.save(arguments.out)
    print(f'gain at rest {found.gain:.6g} m/V, free run misses {found.nrmse_percent:.3g} %')
    print(f'numerator   {_listed(found.numerator)}')
    print(f'denominator {_listed(found.denominator)}')
    for pole in sorted(np.roots(found.denominator), key=lambda each: -each.real):
        print(f'pole {pole.real:.5g}{pole.imag:+.5g}j rad/s ({abs(pole) / (2 * np.pi):.4g} Hz)')
    print(f'written to {arguments.out}')
    if found.gain <= 0.0 or found.nrmse_percent > _POOR:
        verbosity.warn(
            'this is no model of an actuator; record faster and smaller moves (steps, a chirp '
            'above 1 Hz), and leave what settles at the start out with --warm-up'
        )
    return 0


def _listed(numbers: tuple[float, ...]) -> str:
    return ', '.join(f'{each:.6g}' for each in numbers)
