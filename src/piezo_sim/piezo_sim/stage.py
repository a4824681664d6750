"""The verb `stage`: stiffness and stroke from the dimensions of a flexure guide."""

from __future__ import annotations

import argparse

from piezo_sim.flexure import Flexure, FlexureError
from piezo_sim.presets import load_preset
from piezo_sim.simulation_errors import PresetError


def configure_stage(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add = parser.add_argument
    add('--preset', help='preset whose dimensions are the defaults')
    for name, text in (
        ('modulus', "Young's modulus [Pa]"),
        ('depth', 'depth of the hinges, b [m]'),
        ('thickness', 'smallest thickness of the hinges, t [m]'),
        ('radius', 'radius of the circular hinges, R [m]'),
        ('link', 'length between two hinges, L [m]'),
    ):
        add(f'--{name}', type=float, help=text)
    add('--hinges', type=int, help='number of bending hinges (default 8)')
    add('--stroke', type=float, default=1e-5, help='stroke of the stage [m]')
    add('--actuator-stiffness', type=float, default=1e8, help='stiffness of the actuator [N/m]')
    add('--mass', type=float, default=0.3, help='mass of the stage [kg]')
    parser.set_defaults(run=_stage)


def _stage(options: argparse.Namespace) -> int:
    """Print the properties of a guide, and the lines for a preset."""
    base = load_preset(options.preset).flexure if options.preset else None
    if options.preset and base is None:
        raise PresetError(f'the preset {options.preset} has no flexure; give its dimensions')
    names = ('modulus', 'depth', 'thickness', 'radius', 'link', 'hinges')
    given = {name: getattr(options, name) for name in names}
    known = {name: getattr(base, name) for name in names} if base else {'hinges': 8}
    chosen = {**known, **{name: value for name, value in given.items() if value is not None}}
    missing = [name for name in names if name not in chosen]
    if missing:
        raise FlexureError(f'give --{" --".join(missing)}, or a --preset with a flexure')
    for name in ('stroke', 'actuator_stiffness', 'mass'):
        if not getattr(options, name) > 0.0:
            raise FlexureError(f'--{name.replace("_", "-")} must be positive')
    guide = Flexure(**chosen)
    stiffness = options.actuator_stiffness
    for quantity, value, unit in (
        ('rotation of a link', 1e3 * guide.angle(options.stroke), 'mrad'),
        ('hinge Kr', guide.hinge_stiffness, 'N m/rad'),
        ('hinge Kr, exact bending', guide.exact_hinge_stiffness, 'N m/rad'),
        ('guide ke', 1e-6 * guide.stiffness, 'N/um'),
        ('guide ke, exact bending', 1e-6 * guide.exact_stiffness, 'N/um'),
        ('energy in the hinges', 1e3 * guide.energy(options.stroke), 'mJ'),
        ('remaining share of the free stroke', 100.0 * guide.left(stiffness), '%'),
        ('first mode', guide.natural_frequency(stiffness, options.mass), 'Hz'),
    ):
        print(f'{quantity:30} {value:10.5g} {unit}')
    print('\nflexure:  # of a preset')
    for name, value in chosen.items():
        print(f'  {name}: {value if name == "hinges" else format(value, ".6e")}')
    return 0
