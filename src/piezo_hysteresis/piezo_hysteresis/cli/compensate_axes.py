"""What ``compensate`` does with a model of several axes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_tracking import tracked
from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.compensate_links import stated
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.study import require_sampled, waveform_of
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.interface.axes_runs import axes_plant, tick_by_tick
from piezo_hysteresis.runtime.coupled_ticks import matrix_settings
from piezo_hysteresis.waveforms.waveform import Samples

# Ratio of a level to that of the identification from which its model extrapolates.
_BEYOND = 1.2
# Share of the range of a reference that is negligible.
_SMALL = 1e-3


def compensate_several(arguments: argparse.Namespace) -> int:
    """Follow references of several axes on a plant, and write the voltages."""
    from piezo_hysteresis.reporting.axes_report import tracking_rows, write_axes_tracking

    model = modal_file.load(arguments.model)
    _require_numbers(arguments)
    settings = matrix_settings(stated(arguments.set, ('coupled',))['coupled'])
    texts, samples = references_of(arguments.reference, model.layout.outputs, model.dt)
    reference = np.stack([each.value for each in samples], 1)
    noise, seed = arguments.noise, arguments.seed
    with axes_plant(
        arguments.plant, model.dt, noise=noise, seed=seed, settings=arguments.plant_set
    ) as plant:
        runs = tracked(model, plant, reference, noise=noise, seed=seed)
        if arguments.periods:
            limits = _limits(arguments, plant, model.dt)
            runs[-1:-1] = tick_by_tick(model, plant, samples, limits, settings, arguments.periods)
    _require_within(arguments, runs[-1].voltage, model.dt)
    write_axes_tracking(arguments.out, runs, model.dt, texts)
    headers, rows = tracking_rows(runs)
    for row in (headers, *rows):
        print(f'{row[0]:<20}' + ''.join(f'{each:>16}' for each in row[1:]))
    for remark in _remarks(reference):
        print(remark)
    level = float(np.sqrt(np.mean(runs[-1].voltage ** 2)))
    if level > _BEYOND * model.full_level:
        verbosity.warn(
            f'the voltages have {level:.3g} V rms, the model was identified up to '
            f'{model.full_level:.3g} V rms; identify it from larger records, or move less'
        )
    print(f'written to {arguments.out}; open {arguments.out}/report.html')
    return 0


def _limits(arguments: argparse.Namespace, plant: object, dt: float) -> Limits:
    """Return the limits of each axis: those that are stated, or the range of the plant."""
    about = getattr(plant, 'about', {})
    low = about.get('low_v', -np.inf) if arguments.low is None else arguments.low
    high = about.get('high_v', np.inf) if arguments.high is None else arguments.high
    slew = (high - low) / dt if arguments.slew is None else arguments.slew
    return Limits(low, high, slew)


def references_of(
    given: Sequence[str], outputs: int, dt: float
) -> tuple[list[str], list[Samples]]:
    """Return the text and one period of the reference of each output [m]."""
    # dt [s]
    texts, waves = [''] * outputs, {}
    for each in given:
        number, equals, text = each.partition('=')
        if not equals or not number.isdecimal():
            raise CompensationError(
                f'a model of several axes takes --reference N=KIND:..., such as '
                f'1=triangle:frequency=20,amplitude=1e-6,duration=0.5, not {each!r}'
            )
        place = int(number) - 1
        if not 0 <= place < outputs or texts[place]:
            raise CompensationError(
                f'--reference {each}: axes are 1 to {outputs}, each at most once'
            )
        texts[place], waves[place] = text, waveform_of(text)
        require_sampled(waves[place], 1.0 / dt)
    lengths = {each.duration for each in waves.values()}
    if max(lengths) - min(lengths) > 0.5 * dt:
        stated = ', '.join(f'{length:g}' for length in sorted(lengths))
        raise CompensationError(
            f'the references last {stated} s; state one duration for all: they repeat with it'
        )
    time: FloatArray = dt * np.arange(round(max(lengths) / dt), dtype=np.float64)
    still = np.zeros(time.size)
    found = [Samples(still, still, still, still, still) for _ in range(outputs)]
    for place, wave in waves.items():
        found[place] = wave.sample(time)
    return texts, found


def _remarks(reference: FloatArray) -> list[str]:
    """Return sentences on what of the references is not followed."""
    found = []
    for j, x in enumerate(reference.T):
        mean, reach = float(x.mean()), float(np.ptp(x))
        if abs(mean) > _SMALL * reach > 0.0:
            found.append(
                f'axis {j + 1}: the mean of the reference, {1e6 * mean:.4g} µm, is left out; the '
                'model has no position at rest, add a constant voltage'
            )
        jump, step = abs(float(x[0] - 2.0 * x[-1] + x[-2])), float(np.abs(np.diff(x)).max())
        if jump > 2.0 * step + _SMALL * reach:
            found.append(
                f'axis {j + 1}: the reference jumps by {1e6 * jump:.4g} µm where it repeats; give '
                'a duration of whole periods'
            )
    return found


def _require_numbers(arguments: argparse.Namespace) -> None:
    """Reject options that mean nothing."""
    if not arguments.noise >= 0.0:
        raise CompensationError(f'--noise must be 0 or more, got {arguments.noise!r}')
    low, high, slew = arguments.low, arguments.high, arguments.slew
    if not arguments.periods and arguments.set:
        raise CompensationError('--set: of the runs tick by tick; give --periods, or leave it out')
    if arguments.periods < 0:
        raise CompensationError(f'--periods must be 0 or more, got {arguments.periods}')
    if low is not None and high is not None and not low < high:
        raise CompensationError(f'--low {low:g} must be below --high {high:g}')
    if slew is not None and not slew > 0.0:
        raise CompensationError(f'--slew must be positive, got {slew!r}')


def _require_within(arguments: argparse.Namespace, voltage: FloatArray, dt: float) -> None:
    """Reject voltages beyond the limits that are stated."""
    low, high = float(voltage.min()), float(voltage.max())
    least, most = arguments.low, arguments.high
    if (least is not None and low < least) or (most is not None and high > most):
        raise CompensationError(
            f'the references need {low:.4g} to {high:.4g} V, beyond --low and --high: move less '
            'or slower'
        )
    fastest = float(np.abs(np.diff(voltage, axis=0, append=voltage[:1])).max()) / dt
    if arguments.slew is not None and fastest > arguments.slew:
        raise CompensationError(
            f'the references need {fastest:.4g} V/s, more than --slew: move less or slower'
        )
