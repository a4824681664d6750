"""Arguments of ``export`` for a model: loop, limits, target."""

from __future__ import annotations

import argparse
from dataclasses import replace

from piezo_hysteresis.cli import compensate_links as chain
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.operating_limits import above_nyquist, operating_limits, rate_of
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile, is_modal
from piezo_hysteresis.runtime.coupled_ticks import matrix_settings

TARGETS = ('x86_64-linux', 'aarch64-linux')
_LIMITS = ('low', 'high', 'slew')


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a library."""
    add = parser.add_argument_group(
        'C library of a model (MODEL.yaml instead of DATA)'
    ).add_argument
    add(
        '--rate',
        type=float,
        help='steps per second [Hz] (default: that of the model data, or 1000)',
    )
    add(
        '--limits',
        type=float,
        nargs=3,
        metavar=('LOW', 'HIGH', 'SLEW'),
        help='limits of the voltage [V] and its slew [V/s] (default: those of the model data)',
    )
    add(
        '--energy',
        type=float,
        nargs=3,
        metavar=('WATT', 'FARAD', 'SECONDS'),
        help='limit of the mean power [W], capacitance [F], averaging time [s] (default: none)',
    )
    add('--target', default=TARGETS[0], metavar='TARGET', help=f'target: {", ".join(TARGETS)}')
    add('--name', default='piezo', help='name of the library and prefix of its symbols')
    add(
        '--frequency',
        type=float,
        help='frequency of the sine in the example [Hz] (default 23), and of the exported '
        'entry of a model identified per frequency',
    )
    add('--only', choices=('plant',), help='export only the model, without a compensator')
    chain.configure(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the complete library; no file after an error."""
    from piezo_hysteresis.interface.model_functions import write_library

    if len(arguments.data) != 1:
        raise CompensationError('a library holds one model; give one MODEL.yaml')
    if is_modal(arguments.data[0]):
        return _run_several(arguments)
    model = ModelFile.load(arguments.data[0])
    rate = rate_of(model, arguments.rate)
    bounds = operating_limits(model, **dict(zip(_LIMITS, arguments.limits or (), strict=False)))
    controllers = replace(chain.controllers_of(arguments, model, 1.0 / rate), limits=bounds.limits)
    size = write_library(
        model, controllers, arguments.out, name=arguments.name, target=arguments.target,
        frequency=arguments.frequency, only_plant=bool(arguments.only), energy=arguments.energy,
    )  # fmt: skip
    print(f'lib{arguments.name}.a for {arguments.target} at {rate:g} Hz: {size / 1000:.0f} kB')
    for sentence in (*bounds.warnings, *above_nyquist(model, 1.0 / rate)):
        print(sentence)
    print(f'written to {arguments.out}; make -C {arguments.out} test run')
    return 0


def _run_several(arguments: argparse.Namespace) -> int:
    """Write the library of a model of several axes."""
    from piezo_hysteresis.interface.axes_runs import write_coupled_library

    for name in ('energy', 'only', 'frequency', 'transfer_function'):
        if getattr(arguments, name, None) is not None:
            option = name.replace('_', '-')
            raise CompensationError(f'--{option} is for a model of one axis; leave it out')
    if arguments.limits is None:
        raise CompensationError(
            'a model of several axes states no limits; give --limits LOW HIGH SLEW, for each axis'
        )
    size = write_coupled_library(
        arguments.data[0], arguments.out, limits=Limits(*arguments.limits), rate=arguments.rate,
        settings=matrix_settings(chain.stated(arguments.set, ('coupled',))['coupled']),
        name=arguments.name, target=arguments.target,
    )  # fmt: skip
    print(f'lib{arguments.name}.a for {arguments.target}: {size / 1000:.0f} kB')
    print(f'written to {arguments.out}; make -C {arguments.out} test')
    return 0
