"""Arguments of ``export`` for a model: loop, limits, target."""

from __future__ import annotations

import argparse
import re

from piezo_hysteresis.cli import compensate_links as chain
from piezo_hysteresis.compensation.energy import EnergyLimits
from piezo_hysteresis.compensation.inverses.reach import reach_of
from piezo_hysteresis.compensation.limiter import packed_limits
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.operating_limits import above_nyquist, operating_limits, rate_of
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.reporting.folder import check_folder, write_folder

TARGETS = ('x86_64-linux', 'aarch64-linux')
# Amplitude of the sine of example and test vectors, relative to the range of the model.
_SHARE = 0.8
_LIMITS = ('low', 'high', 'slew')
_IDENTIFIER = re.compile(r'[A-Za-z_]\w*')


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
    add('--frequency', type=float, default=23.0, help='frequency of the sine in the example [Hz]')
    add('--only', choices=('plant',), help='export only the model, without a compensator')
    chain.configure(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the complete library; no file after an error."""
    from piezo_hysteresis.export.library import Request, files_of
    from piezo_hysteresis.export.native import known_target
    from piezo_hysteresis.export.programs import Drive

    check_folder(arguments.out, 'export')
    known_target(arguments.target)
    model = ModelFile.load(arguments.data[0])
    rate = rate_of(model, arguments.rate)
    _require_numbers(arguments, rate)
    dt = 1.0 / rate
    bounds = operating_limits(model, **dict(zip(_LIMITS, arguments.limits or (), strict=False)))
    limits = bounds.limits
    energy = _energy(arguments, limits, dt)
    packed_limits(limits, dt, energy)
    reach = reach_of(model.model, model.values, dt, limits)
    controllers = chain.controllers_of(arguments, model, dt, limits)
    mode = controllers.mode()
    assert mode is not None
    centre = 0.5 * (limits.low + limits.high)
    drive = Drive(arguments.frequency, _SHARE * reach.half, reach.middle, mode.gain, centre)
    asked = Request(
        arguments.name, model,
        lambda: [] if arguments.only else controllers.links(by_mode=True), limits, energy, dt,
        arguments.target, drive, controllers.slow,
    )  # fmt: skip
    files = files_of(asked)
    write_folder(arguments.out, files, 'export')
    size = len(files[f'lib{arguments.name}.a'])
    print(f'lib{arguments.name}.a for {arguments.target} at {rate:g} Hz: {size / 1000:.0f} kB')
    for sentence in (*bounds.warnings, *above_nyquist(model, dt)):
        print(sentence)
    print(f'written to {arguments.out}; make -C {arguments.out} test run')
    return 0


def _energy(arguments: argparse.Namespace, limits: Limits, dt: float) -> EnergyLimits:
    """Return the limit of the mean power; the supply is the voltage range, as in the nodes."""
    # without a limit only the length of the window matters
    power, capacitance, window = arguments.energy or (0.0, 1e-6, max(1.0, 20.0 * dt))
    return EnergyLimits(power, capacitance, window, limits.high - limits.low)


def _require_numbers(arguments: argparse.Namespace, rate: float) -> None:
    if len(arguments.data) != 1:
        raise CompensationError('a library holds one model; give one MODEL.yaml')
    if not rate <= 1e6:
        raise CompensationError(f'the rate must be above 0 and up to 1 MHz, got {rate:g} Hz')
    if not 0.0 < arguments.frequency < 0.25 * rate:
        raise CompensationError(
            f'a sine of {arguments.frequency:g} Hz cannot be tracked at {rate:g} Hz; give '
            '--frequency below a quarter of the rate'
        )
    if not _IDENTIFIER.fullmatch(arguments.name):
        raise CompensationError(f'{arguments.name!r} is no name in C; give letters and digits')
