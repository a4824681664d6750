"""Study in closed loop, without hardware, how well a model compensates a plant.

The plant is a model too, usually another one or one with other numbers, or a simulated actuator:
preset:NAME. On a controller (--on) the actuator itself is driven. The reference is a waveform,
KIND:setting=value,... (amplitude in m), e.g.
sine:frequency=23,amplitude=120e-6.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezo_hysteresis.cli import compensate_links as links
from piezo_hysteresis.cli.compensate_on import run_on
from piezo_hysteresis.cli.compensate_study import (
    Run,
    Study,
    open_plant,
    parse_reference,
    run_study,
)
from piezo_hysteresis.cli.compensate_study import write_results as write
from piezo_hysteresis.cli.shared_options import add_out
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers.addresses import FORMS
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.reporting.folder import check_folder

HELP = 'compensation by a model: offline on a plant, or on a controller'

PRESET = 'preset:'
# Words that both ways take, and those that only a controller takes.
_COMMON = {'model', 'reference', 'out', 'overwrite', 'low', 'high', 'slew', 'plant', 'on'}
_OF_CONTROLLER = {'axis', 'rounds'}


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('--model', required=True, metavar='YAML', help='model that is inverted')
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        '--plant',
        metavar='YAML|preset:NAME',
        help='model instead of the actuator, or a simulated one (piezo_sim presets)',
    )
    what.add_argument(
        '--on',
        metavar='ADDRESS',
        help=f'the actuator on a controller: its wave is learnt from run to run; {FORMS}',
    )
    add('--axis', default='1', help='of the controller (1)')
    add('--rounds', type=int, default=8, metavar='N', help='with --on: runs that learn, at most')
    add(
        '--plant-set',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='parameters and effects of a simulated plant: effects.creep=true',
    )
    add('--reference', required=True, metavar='KIND:...', help='desired displacement [m]')
    add_out(parser)
    add('--rate', type=float, help='sampling rate [Hz]; that of the model data, or 1000')
    add('--low', type=float, help='lowest voltage [V]; of the preset, or -1.2')
    add('--high', type=float, help='highest voltage [V]; of the preset, or 1.2')
    add('--slew', type=float, help='fastest change of it [V/s]; of the preset, or 1000')
    add('--noise', type=float, default=0.0, help='rms of the measurement noise [m]')
    add('--seed', type=int, default=0, help='seed of the noise')
    add('--from-seconds', type=float, help='errors count from here [s]; half of the reference')
    links.configure(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the study and write its results."""
    started = time.perf_counter()
    _require_used(arguments)
    check_folder(arguments.out, 'compensate')
    if arguments.on is not None:
        return run_on(arguments)
    model = ModelFile.load(arguments.model)
    rate = arguments.rate if arguments.rate is not None else model.provenance.rate or 1000.0
    _require_numbers(arguments, rate)
    parse_reference(arguments.reference)  # refused before a plant is started
    plant = _plant(arguments)
    with open_plant(
        plant, 1.0 / rate, arguments.seed, noise=arguments.noise, settings=arguments.plant_set
    ) as (driven, about):
        study = _study(arguments, model, plant, rate, about)
        runs = run_study(study, driven)
    out = Path(arguments.out)
    write(out, study, runs, arguments.reference, time.perf_counter() - started)
    for line in _table(runs):
        print(line)
    if about:
        print(_usual(study, about))
    for remark in dict.fromkeys(remark for each in runs for remark in each.words):
        print(remark)
    print(f'written to {out}; open {out}/report.html')
    return 0


def _require_used(arguments: argparse.Namespace) -> None:
    """Refuse study options with a controller, and controller options in a study."""
    parser = argparse.ArgumentParser()
    configure(parser)
    needed = ['--model', '', '--on', '', '--reference', '', '--out', '']
    given = {
        name
        for name, default in vars(parser.parse_args(needed)).items()
        if name not in _COMMON and getattr(arguments, name, default) != default
    }
    unused = given - _OF_CONTROLLER if arguments.on is not None else given & _OF_CONTROLLER
    if unused:
        names = ', '.join(f'--{name.replace("_", "-")}' for name in sorted(unused))
        ways = ('a study', '--on') if arguments.on is not None else ('a controller', '--plant')
        raise CompensationError(f'{names}: of {ways[0]}, not used with {ways[1]}; leave it out')


def _study(
    arguments: argparse.Namespace,
    model: ModelFile,
    plant: ModelFile | str,
    rate: float,
    about: Mapping[str, Any],
) -> Study:
    """Return what is to be run; a simulated actuator has a range and a drive of its own."""
    usual = {'offset': about.get('offset_m', 0.0), 'phase': about.get('phase', 0.0)}
    waveform = parse_reference(arguments.reference, {k: v for k, v in usual.items() if v})
    frequency = float(getattr(waveform, 'frequency', 0.0))
    if frequency >= 0.5 * rate:
        raise CompensationError(
            f'a reference of {frequency:g} Hz cannot be sampled at {rate:g} Hz; lower the '
            'frequency or raise --rate'
        )
    if not math.isfinite(waveform.duration) or waveform.duration * rate > 5e7:
        raise CompensationError('the reference is too long; give it a duration')
    from_seconds = arguments.from_seconds
    low, high, slew = (
        about.get(key, default) if given is None else given
        for given, key, default in (
            (arguments.low, 'low_v', -1.2),
            (arguments.high, 'high_v', 1.2),
            (arguments.slew, 'slew_v_per_s', 1000.0),
        )
    )
    return Study(
        model=model,
        slow=None if arguments.slow_model is None else ModelFile.load(arguments.slow_model),
        law=arguments.law,
        switch=arguments.switch,
        plant=plant,
        waveform=waveform,
        dt=1.0 / rate,
        limits=Limits(low, high, slew),
        attenuation=links.attenuation_of(arguments),
        gain_model=None if arguments.gain_model is None else ModelFile.load(arguments.gain_model),
        feedback=links.feedback_of(arguments),
        together=arguments.together,
        noise=arguments.noise,
        seed=arguments.seed,
        from_seconds=0.5 * waveform.duration if from_seconds is None else from_seconds,
    )


def _usual(study: Study, about: Mapping[str, Any]) -> str:
    """Return one line about the range and the reference that the preset stands behind."""
    limits, wave = study.limits, study.waveform
    line = f'{about["preset"]}: {limits.low:g} to {limits.high:g} V, at most {limits.slew:g} V/s'
    if about['offset_m']:
        offset = 1e6 * float(getattr(wave, 'offset', 0.0))
        phase = math.degrees(getattr(wave, 'phase', 0.0))
        line += f'; reference about {offset:g} µm, phase {phase:g} degrees at its start'
    return line


def _plant(arguments: argparse.Namespace) -> ModelFile | str:
    """Return the model in the place of the actuator, or the name of a preset."""
    if arguments.plant.startswith(PRESET):
        if arguments.noise:
            raise CompensationError(
                'a simulated plant has its own noise; set it by --plant-set sensor.noise_rms=...'
            )
        return str(arguments.plant.removeprefix(PRESET))
    if arguments.plant_set:
        raise CompensationError('--plant-set is for a simulated plant, preset:NAME')
    return ModelFile.load(arguments.plant)


def _require_numbers(arguments: argparse.Namespace, rate: float) -> None:
    """Refuse numbers that mean nothing."""
    if not (math.isfinite(rate) and rate > 0):
        raise CompensationError(f'the rate must be positive, got {rate:g} Hz')
    for name, value, unit in (
        ('noise', arguments.noise, 'm'),
        ('resonance', arguments.resonance, 'Hz'),
        ('from-seconds', arguments.from_seconds or 0.0, 's'),
        ('seed', arguments.seed, ''),
    ):
        if not (math.isfinite(value) and value >= 0):
            raise CompensationError(f'--{name} must be 0 or more, got {value:g} {unit}'.rstrip())


def _table(runs: list[Run]) -> list[str]:
    lines = [f'{"run":<24}{"rms [µm]":>12}{"largest [µm]":>14}{"mean [µm]":>12}']
    for each in runs:
        m = each.metrics
        lines.append(
            f'{each.name:<24}{m.rms * 1e6:>12.4f}{m.largest * 1e6:>14.4f}{m.mean * 1e6:>12.4f}'
        )
    return lines
