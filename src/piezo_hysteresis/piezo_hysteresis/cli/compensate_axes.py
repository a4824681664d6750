"""What ``compensate`` does with a model of several axes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.axes_tracking import tracked
from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.compensation.study import require_sampled, waveform_of
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.interface.axes_runs import axes_plant
from piezo_hysteresis.reporting.folder import check_folder

# Ratio of a level to that of the identification from which its model extrapolates.
_BEYOND = 1.2
# Share of the range of a reference that is negligible.
_SMALL = 1e-3


def compensate_several(arguments: argparse.Namespace) -> int:
    """Follow references of several axes on a plant, and write the voltages."""
    from piezo_hysteresis.reporting.axes_report import tracking_rows, write_axes_tracking

    check_folder(arguments.out, 'compensate')
    model = modal_file.load(arguments.model)
    _require_numbers(arguments)
    texts, reference = references_of(arguments.reference, model.layout.outputs, model.dt)
    noise, seed = arguments.noise, arguments.seed
    with axes_plant(
        arguments.plant, model.dt, noise=noise, seed=seed, settings=arguments.plant_set
    ) as plant:
        runs = tracked(model, plant, reference, noise=noise, seed=seed)
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


def references_of(given: Sequence[str], outputs: int, dt: float) -> tuple[list[str], FloatArray]:
    """Return the text and the samples of the reference of each output, (n, outputs) [m]."""
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
    reference = np.zeros((time.size, outputs))
    for place, wave in waves.items():
        reference[:, place] = wave.sample(time).value
    return texts, reference


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
