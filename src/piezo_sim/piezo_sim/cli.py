"""``python -m piezo_sim``: sweeps faster than real time; presets and their parameters."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import OneLineParser, counted, reason_of
from piezo_hysteresis.waveforms import KINDS, PiezoError, has_setting
from piezo_sim import __version__, serve
from piezo_sim.axes_plant import FOLDER, AxesPlant, load_axes_preset
from piezo_sim.axes_records import configure_axes
from piezo_sim.gcs import server
from piezo_sim.gcs.server import FAULTS
from piezo_sim.plant import Plant
from piezo_sim.presets import load_preset, preset_names
from piezo_sim.serve import check_target, labels, write_labels, write_records
from piezo_sim.simulation_errors import SimulationError, SweepError
from piezo_sim.stage import configure_stage
from piezo_sim.sweep import grid, simulate


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 0, or 2 for an error that the user can correct."""
    options = build_parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except (SimulationError, PiezoError) as error:
        print(f'error: {error}', file=sys.stderr)
        return 2


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = OneLineParser(
        prog='piezo_sim', description='Simulate records of piezo actuators, faster than real time.'
    )
    parser.add_argument('--version', action='version', version=__version__)
    verbs = parser.add_subparsers(title='verbs', metavar='VERB', required=True)
    _configure_sweep(verbs.add_parser('sweep', help='simulate records and write a bag or file'))
    configure_axes(
        verbs.add_parser('axes', help='simulate periodic records of several coupled axes'),
        _numbers, _assignment,
    )  # fmt: skip
    verbs.add_parser('presets', help='list the simulated actuators').set_defaults(run=_presets)
    configure_stage(verbs.add_parser('stage', help='design a flexure stage from its dimensions'))
    _configure_plant(
        verbs.add_parser('plant', help='simulate an actuator for another program, through a pipe')
    )
    for name, what in (
        ('gcs', 'simulate a controller with GCS 2, on a TCP port or a pty'),
        ('nv200', 'simulate an amplifier NV200 of piezosystem jena, on a pty'),
    ):
        _configure_controller(verbs.add_parser(name, help=what), name)
    describe = verbs.add_parser(
        'describe', help='list parameters and effects of a preset, or the waveforms'
    )
    describe.add_argument(
        'name', nargs='?', help='preset, or "waveforms" (default: the tables of parameters)'
    )
    describe.set_defaults(run=_describe)
    return parser


def _configure_sweep(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        '--preset',
        default='fdk_pzba_00030',
        help='simulated actuator, see `python -m piezo_sim presets`',
    )
    add('--out', type=Path, required=True, help='bag folder, or a .npz or .csv file (one record)')
    add('--waveform', default='sine', help=f'waveform: {", ".join(KINDS)}')
    add('--frequencies', type=_numbers, help='frequencies [Hz]: 1,5,23 or 1:50 or 1:50:0.5')
    add('--amplitudes', type=_numbers, help='amplitudes [V] (default: the drive of the preset)')
    add('--seconds', type=float, help='length of each record [s] (default: 10)')
    add('--warm-up', type=float, help='initial time excluded from errors [s] (default: a tenth)')
    add('--options', type=_mapping, default={}, help='settings of the waveform, such as a=1,b=odd')
    add(
        '--plan',
        type=Path,
        help='YAML file with a list of waveforms, instead of the options above',
    )
    add('--rate', type=float, help='sampling rate [Hz] (default: of the preset)')
    add(
        '--noise',
        type=float,
        help='rms of the sensor noise [m], 0 for none (default: of the preset)',
    )
    add('--seed', type=int, default=0, help='seed of all noise')
    add('--set', type=_assignment, action='append', default=[], metavar='NAME=VALUE',
        help='parameter of the simulator, or effects.NAME=true|false')  # fmt: skip
    add('--actuator', help='name of the actuator in the records (default: the preset)')
    add('-q', '--quiet', action='store_true', help='print no progress')
    add(
        '--reveal',
        type=Path,
        help='write the true effects and parameters to this .json or .yaml file',
    )
    parser.set_defaults(run=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    overrides = _overrides(options)
    specs = _plan(options.plan) if options.plan else _grid(options)
    plant = Plant.from_preset(options.preset, options.rate, options.seed, overrides)
    check_target(options.out, len(specs))
    if options.reveal is not None:
        if options.reveal.suffix not in ('.json', '.yaml', '.yml'):
            raise SweepError(f'{options.reveal}: the labels are written as .json or .yaml')
        check_target(options.reveal, 1)
    for spec in specs:
        if options.warm_up is not None:
            spec.setdefault('warm_up', options.warm_up)
    if remark := plant.idle_effects:
        print(f'warning: {remark}', file=sys.stderr)
    started = time.perf_counter()
    records = simulate(
        options.preset, specs, overrides, options.seed, options.rate,
        actuator=options.actuator,
        progress=_progress if sys.stderr.isatty() and not options.quiet else None,
    )  # fmt: skip
    simulated = time.perf_counter()
    write_records(options.out, records)
    if options.reveal is not None:
        write_labels(options.reveal, labels(plant, options.preset, overrides, options.seed))
    samples = sum(len(record) for record in records)
    print(
        f'{options.out}: {counted(len(records), "record")}, {samples} samples, '
        f'{samples / plant.rate:g} s at {plant.rate:g} Hz; '
        f'simulated in {simulated - started:.2f} s, '
        f'written in {time.perf_counter() - simulated:.2f} s'
    )
    return 0


def _configure_plant(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        '--preset',
        default='fdk_pzba_00030',
        help='simulated actuator, see `python -m piezo_sim presets`',
    )
    add('--rate', type=float, help='sampling rate [Hz] (default: of the preset)')
    add('--seed', type=int, default=0, help='seed of all noise')
    add('--set', type=_assignment, action='append', default=[], metavar='NAME=VALUE',
        help='parameter of the simulator, or effects.NAME=true|false')  # fmt: skip
    parser.set_defaults(run=lambda options: serve.run(options, dict(options.set)))


def _configure_controller(parser: argparse.ArgumentParser, language: str) -> None:
    add = parser.add_argument
    add(
        '--preset',
        default='fdk_pzba_00030',
        help='simulated actuator, see `python -m piezo_sim presets`',
    )
    if language == 'gcs':
        add('--rate', type=float, default=20_000.0, help='servo rate [Hz]')
        add('--port', type=int, default=50_000, help='TCP port on this machine, 0 for a free one')
        add('--pty', action='store_true', help='use a pseudo terminal, like a serial cable')
    else:
        parser.set_defaults(rate=20_000.0)
    add('--link', type=Path, help='with a pty: symbolic link to the port, removed at the end')
    add(
        '--speed',
        type=float,
        default=1.0,
        help='speed relative to real time; inf plays waves at once',
    )
    add('--seed', type=int, default=0, help='seed of all noise')
    add('--fault', default='', metavar='KIND:N',
        help=f'inject one of {", ".join(FAULTS)}, once, after N lines')  # fmt: skip
    add('--set', type=_assignment, action='append', default=[], metavar='NAME=VALUE',
        help='parameter of the simulator, or effects.NAME=true|false')  # fmt: skip
    parser.set_defaults(run=lambda options: server.run(options, dict(options.set), language))


def _overrides(options: argparse.Namespace) -> dict[str, float | bool]:
    overrides: dict[str, float | bool] = dict(options.set)
    if options.noise is not None:
        overrides['effects.noise'] = options.noise > 0.0
        if options.noise > 0.0:
            overrides['sensor.noise_rms'] = options.noise
    return overrides


def _grid(options: argparse.Namespace) -> list[dict[str, Any]]:
    preset, kind = load_preset(options.preset), options.waveform
    settings = dict(options.options)
    if options.seconds is not None:
        if not has_setting(kind, 'duration'):
            raise SweepError(
                f'the length of a {kind} follows from its settings: leave out --seconds'
            )
        settings['duration'] = options.seconds
    if preset.bias and has_setting(kind, 'offset'):
        settings.setdefault('offset', preset.bias)
    if preset.phase and has_setting(kind, 'phase'):
        settings.setdefault('phase', preset.phase)
    amplitudes = options.amplitudes
    if amplitudes is None:
        amplitudes = [] if 'amplitude' in settings else [preset.voltage]
    return grid(kind, options.frequencies or [], amplitudes, settings)


def _plan(path: Path) -> list[dict[str, Any]]:
    try:
        content = plain_yaml.load_file(path)
    except (OSError, yaml.YAMLError) as error:
        raise SweepError(f'the plan {path} cannot be read: {reason_of(error)}') from error
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise SweepError(f'the plan {path} must be a list of waveforms, each a mapping')
    return content


def _presets(_: argparse.Namespace) -> int:
    for name in preset_names():
        preset = load_preset(name)
        print(f'{name:20} {preset.description}')
        print(f'{"":20}   {preset.source}; {preset.rate:g} Hz; {", ".join(preset.effects)}')
    for name in preset_names(FOLDER):
        several = load_axes_preset(name)
        print(f'{name:20} {several.description}')
        print(
            f'{"":20}   {several.source}; {several.rate:g} Hz; '
            f'{counted(len(several.axes), "axis")}; '
            f'{", ".join(several.effects)}'
        )
    return 0


def _describe(options: argparse.Namespace) -> int:
    if options.name == 'waveforms':
        _describe_waveforms()
        return 0
    several = options.name in preset_names(FOLDER)
    plant: Plant | AxesPlant = Plant()
    if options.name:
        plant = (AxesPlant if several else Plant).from_preset(options.name)
    print(f'{plant.preset.name}: {plant.preset.description}\n')
    for effect in plant.effect_table:
        mark = 'on ' if plant.effects[effect.name] else 'off'
        print(f'effects.{effect.name:24} {mark}  {effect.description}')
    print()
    for row in plant.parameter_table:
        bounds = f'{row.low:g} .. {row.high:g}'
        print(f'{row.name:32} {row.default:12.6g} {row.unit:6} {bounds:18} {row.description}')
    return 0


def _describe_waveforms() -> None:
    for kind in KINDS.values():
        print(f'{kind.name:20} {kind.description}')
        for row in kind.settings:
            choices = f' ({", ".join(row.choices)})' if row.choices else ''
            default = '' if row.name == 'parts' else row.default
            print(f'  {row.name:18} {default!s:>10} {row.unit:8} {row.description}{choices}')


def _progress(fraction: float) -> None:
    print(f'\r{100.0 * fraction:3.0f} %', end='\n' if fraction >= 1.0 else '', file=sys.stderr)


def _numbers(text: str) -> list[float]:
    """Return the numbers of ``1,5,23``, ``1:50`` (step 1) or ``1:50:0.5``."""
    numbers: list[float] = []
    for item in text.split(','):
        try:
            ends = [float(end) for end in item.split(':')]
        except ValueError:
            raise argparse.ArgumentTypeError(f'{item!r} is not a number or a range') from None
        if len(ends) == 1:
            numbers += ends
            continue
        first, last, step = (*ends, 1.0)[:3]
        if len(ends) > 3 or step <= 0.0 or not 0.0 <= (last - first) / step < 1e5:
            raise argparse.ArgumentTypeError(f'{item!r} is not a range like 1:50 or 1:50:0.5')
        numbers += [first + step * k for k in range(int((last - first) / step + 1e-9) + 1)]
    return numbers


def _assignment(text: str) -> tuple[str, float | bool]:
    name, equals, value = text.partition('=')
    switches = {'true': True, 'on': True, 'false': False, 'off': False}
    if value.lower() in switches:
        return name, switches[value.lower()]
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{text!r} is not NAME=number or NAME=true|false' if equals else f'{text!r} has no ='
        ) from None


def _mapping(text: str) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for item in filter(None, text.split(',')):
        name, equals, value = item.partition('=')
        if not equals:
            raise argparse.ArgumentTypeError(f'{item!r} has no =; write a=1,b=odd')
        try:
            result[name] = float(value)
        except ValueError:
            result[name] = value
    return result
