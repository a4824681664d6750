"""Simulate how well a model compensates a plant in closed loop, without hardware.

The plant is a model as well, usually another one or one with other parameters, or a simulated
actuator: preset:NAME. With a controller (--on) the actuator itself is driven. The reference is a
waveform, KIND:setting=value,... (amplitude in m), e.g.
sine:frequency=23,amplitude=120e-6.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

from piezo_hysteresis.cli import compensate_links as links
from piezo_hysteresis.cli.shared_options import add_out, add_statements, statements_of
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.operating_limits import rate_of
from piezo_hysteresis.compensation.study import PRESET, Run, Study, remarks, track, waveform_of
from piezo_hysteresis.drivers import open_controller
from piezo_hysteresis.drivers.addresses import FORMS, TAKE_OVER
from piezo_hysteresis.drivers.tracking import Learning, LearntRun
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile, is_modal
from piezo_hysteresis.waveforms import Sine

EXAMPLE = (
    'compensate --model out/model/model.yaml --plant preset:fdk_pzba_00030 '
    '--reference sine:frequency=23,amplitude=120e-6,duration=4 --out out/study'
)

# Options of both modes, options that only a controller takes, and those for several axes.
_COMMON = {'model', 'reference', 'out', 'overwrite', 'low', 'high', 'slew', 'plant', 'on'}
_OF_CONTROLLER = {'axis', 'rounds', 'take_over'}
_OF_SEVERAL = {'noise', 'seed', 'plant_set', 'periods', 'set'}


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('--model', required=True, metavar='YAML', help='model whose inverse is the feedforward')
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        '--plant',
        metavar='YAML|preset:NAME',
        help='plant: a model, or a preset of `python -m piezo_sim presets`',
    )
    what.add_argument(
        '--on',
        metavar='ADDRESS',
        help=f'actuator on a motion controller, whose wave is learnt from run to run: {FORMS}',
    )
    add('--axis', default='1', help='axis of the controller')
    add('--take-over', action='store_true', help=TAKE_OVER)
    add(
        '--rounds',
        type=int,
        default=8,
        metavar='N',
        help='with --on: largest number of learning runs',
    )
    add(
        '--plant-set',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='parameters and effects of a preset, such as effects.creep=true',
    )
    add(
        '--reference',
        required=True,
        action='append',
        metavar='KIND:...|CSV',
        help='desired displacement [m]; or a file of time_s, reference_um; of several axes '
        'N=KIND:... for each axis that moves',
    )
    add_out(parser)
    add('--rate', type=float, help='sampling rate [Hz] (default: that of the model data, or 1000)')
    add('--low', type=float, help='lowest voltage [V] (default: of the preset or the model)')
    add('--high', type=float, help='highest voltage [V] (default: of the preset or the model)')
    add('--slew', type=float, help='slew rate limit [V/s] (default: of the preset or the model)')
    add('--noise', type=float, default=0.0, help='rms of the measurement noise [m]')
    add('--seed', type=int, default=0, help='seed of the noise')
    add(
        '--from-seconds',
        type=float,
        help='start of the evaluated part [s] (default: half of the reference)',
    )
    add(
        '--periods',
        type=int,
        default=0,
        metavar='N',
        help='of several axes: follow the references N periods tick by tick as well, as nodes do',
    )
    add_statements(parser)
    links.configure(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the study and write its results."""
    from piezo_hysteresis.reporting.compensation_report import write_compensation

    started = time.perf_counter()
    several = is_modal(arguments.model)
    _require_used(arguments, several=several)
    if several:
        from piezo_hysteresis.cli.compensate_axes import compensate_several

        return compensate_several(arguments)
    arguments.reference = _only(arguments.reference)
    study, runs = (_simulated if arguments.on is None else _learnt)(arguments)
    out = Path(arguments.out)
    write_compensation(out, study, runs, arguments.reference, time.perf_counter() - started)
    if arguments.on is None:
        usual = [_usual(study)] if study.about else []
        print('\n'.join((*_table(runs), *usual, *remarks(study, runs))))
    print(f'written to {out}; open {out}/report.html')
    return 0


def _simulated(arguments: argparse.Namespace) -> tuple[Study, list[Run]]:
    """Run the study on a model or a preset."""
    from piezo_hysteresis.interface.compensate_runs import reference_of

    model = ModelFile.load(arguments.model)
    reference, rate = reference_of(
        arguments.reference, arguments.rate, model, statements_of(arguments), arguments.salvage
    )
    controllers = links.controllers_of(arguments, model, 1.0 / rate_of(model, rate))
    return track(
        controllers, _plant(arguments), reference, low=arguments.low,
        high=arguments.high, slew=arguments.slew, together=arguments.together,
        noise=arguments.noise, seed=arguments.seed, from_seconds=arguments.from_seconds,
        plant_settings=arguments.plant_set,
    )  # fmt: skip


def _require_used(arguments: argparse.Namespace, *, several: bool) -> None:
    """Reject options of a controller, of a study or of one axis where they have no effect."""
    parser = argparse.ArgumentParser()
    configure(parser)
    needed = ['--model', '', '--on', '', '--reference', '', '--out', '']
    given = {
        name
        for name, default in vars(parser.parse_args(needed)).items()
        if name not in _COMMON and getattr(arguments, name, default) != default
    }
    if several:
        unused, ways = given - _OF_SEVERAL, ('one axis', 'a model of several axes')
        unused |= {'on'} if arguments.on is not None else set()
    elif arguments.on is not None:
        unused, ways = given - _OF_CONTROLLER, ('a study', '--on')
    else:
        unused, ways = given & _OF_CONTROLLER, ('a controller', '--plant')
    if not several and 'periods' in given:
        unused, ways = {'periods'}, ('several axes', 'a model of one')
    if unused:
        names = ', '.join(f'--{name.replace("_", "-")}' for name in sorted(unused))
        raise CompensationError(f'{names}: of {ways[0]}, not used with {ways[1]}; leave it out')


def _only(references: list[str]) -> str:
    """Return the reference of a model of one axis."""
    if len(references) > 1:
        raise CompensationError('the model has one axis; state one --reference')
    return references[0]


def _usual(study: Study) -> str:
    """Return one line about the usual range and reference of the preset."""
    about, limits, wave = study.about, study.limits, study.waveform
    line = f'{about["preset"]}: {limits.low:g} to {limits.high:g} V, at most {limits.slew:g} V/s'
    if about['offset_m']:
        offset = 1e6 * float(getattr(wave, 'offset', 0.0))
        phase = math.degrees(getattr(wave, 'phase', 0.0))
        line += f'; reference about {offset:g} µm, phase {phase:g} degrees at its start'
    return line


def _plant(arguments: argparse.Namespace) -> ModelFile | str:
    """Return the model used as the plant, or the name of a preset."""
    if arguments.plant.startswith(PRESET):
        if arguments.noise:
            raise CompensationError(
                'a simulated plant has its own noise; set it by --plant-set sensor.noise_rms=...'
            )
        return str(arguments.plant.removeprefix(PRESET))
    if arguments.plant_set:
        raise CompensationError('--plant-set is for a simulated plant, preset:NAME')
    return ModelFile.load(arguments.plant)


def _table(runs: list[Run]) -> list[str]:
    lines = [f'{"run":<24}{"rms [µm]":>12}{"largest [µm]":>14}{"mean [µm]":>12}']
    for each in runs:
        m = each.metrics
        lines.append(
            f'{each.name:<24}{m.rms * 1e6:>12.4f}{m.largest * 1e6:>14.4f}{m.mean * 1e6:>12.4f}'
        )
    return lines


def _learnt(arguments: argparse.Namespace) -> tuple[Study, list[Run]]:
    """Run iterative learning on the controller, in the form of a study."""
    reference = waveform_of(arguments.reference)
    if not isinstance(reference, Sine):
        raise CompensationError(
            'a controller learns a sine: --reference sine:frequency=23,amplitude=40e-6,duration=2'
        )
    model = ModelFile.load(arguments.model)
    with open_controller(
        arguments.on,
        arguments.axis,
        arguments.low,
        arguments.high,
        arguments.slew,
        take_over=arguments.take_over,
    ) as controller:
        controller.open_loop()
        learning = Learning(controller, model.at(reference.frequency), reference)
        runs = [_reported(each) for each in learning.runs(arguments.rounds)]
        study = Study(
            Controllers(learning.dt, controller.limits, model), '', reference,
            learning.from_seconds, controller=controller.identity.name,
        )  # fmt: skip
    return study, runs


def _reported(learnt: LearntRun) -> Run:
    """Print a line about a run, and return the run in the form of a study."""
    floors = f', {learnt.rms / learnt.noise:.3g} noise floors' if learnt.noise > 0.0 else ''
    print(f'{learnt.name:<18}{1e6 * learnt.rms:10.4f} µm rms{floors}', flush=True)
    return Run(learnt.name, learnt.result, learnt.metrics)
