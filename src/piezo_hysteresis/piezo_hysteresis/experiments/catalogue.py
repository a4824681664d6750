"""Catalogue of all experiments that the limits allow."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil

from piezo_hysteresis.experiments.experiment_limits import ExperimentLimits, InvestigationError
from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment, Spec, composed
from piezo_hysteresis.waveforms import reversal_curves

# Drive frequencies of the sines [Hz], and their amplitudes relative to the largest.
DRIVES = (1.0, 2.0, 5.0, 10.0, 14.0, 20.0, 33.0, 50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0)
SHARES = (0.99, 0.5)
# Number of periods of a sine, and its shortest duration [s].
PERIODS, SHORTEST = 5, 1.0
# Smallest number of ticks per period of a sine.
FINEST = 6
# Hold times of the steps [s], and rise time without a slew limit [s].
HOLDS, RISE = (4.0, 12.0, 30.0), 0.005
RESTS = (5.0, 20.0)


def catalogue(limits: ExperimentLimits, rate: float) -> tuple[PlannedExperiment, ...]:  # rate [Hz]
    """Return every experiment within the limits, in a fixed order."""
    highest = min(limits.frequency, rate / FINEST)
    made = (
        composed(name, main, seconds, limits, rate, frequency)
        for name, main, seconds, frequency in _wanted(limits, highest)
    )
    found = tuple(each for each in made if each is not None)
    if not any(each.amplitude > 0.0 for each in found):
        raise InvestigationError(
            'these limits allow no experiment that moves the actuator: allow a faster slew, a '
            'higher frequency or more heat'
        )
    return found


def _wanted(limits: ExperimentLimits, highest: float) -> Iterator[tuple[str, Spec, float, float]]:
    """Yield name, main part, its duration [s] and drive frequency [Hz] of every experiment."""
    full = SHARES[0] * limits.amplitude
    for share in SHARES:
        for drive in (drive for drive in DRIVES if drive <= highest):
            length = ceil(max(PERIODS, SHORTEST * drive)) / drive
            yield _sine(f'sine {drive:g} Hz', share * limits.amplitude, drive, length, length / 5)
    drive = min(5.0, highest)
    length = ceil(3.0 * drive) / drive
    yield _sine(f'growing sine {drive:g} Hz', full, drive, length, length)
    slow = min(0.5, highest)
    triangle = {'kind': 'triangle', 'amplitude': full, 'frequency': slow, 'duration': 2.0 / slow}
    yield f'triangle {slow:g} Hz', triangle, 2.0 / slow, slow
    for share, top in ((0.5, highest), (0.25, highest)):
        yield _chirp(share * limits.amplitude, top)
    for hold in HOLDS:
        yield _step(full, hold, max(RISE, full / limits.slew))
    curves = reversal_curves(full, 4, min(8.0 * limits.amplitude, limits.slew))
    lines = {'kind': 'lines', 'times': list(curves.times), 'values': list(curves.values)}
    yield 'reversal curves', lines, curves.duration, 0.0
    for rest in RESTS:
        lines = {'kind': 'lines', 'times': [0.0, rest], 'values': [0.0, 0.0]}
        yield f'rest for {rest:g} s', lines, rest, 0.0


def _sine(
    name: str, amplitude: float, drive: float, length: float, ramp: float
) -> tuple[str, Spec, float, float]:
    main = {'kind': 'sine', 'amplitude': amplitude, 'frequency': drive, 'duration': length}
    return f'{name} at {amplitude:.3g} V', {**main, 'ramp': ramp}, length, drive


def _chirp(amplitude: float, highest: float) -> tuple[str, Spec, float, float]:
    first = min(1.0, 0.5 * highest)
    mean = 0.5 * (first + highest)
    length = ceil(4.0 * mean) / mean  # whole periods: the chirp ends at its center voltage
    main = {
        'kind': 'chirp', 'amplitude': amplitude, 'frequency': first, 'highest': highest,
        'duration': length, 'ramp': 0.2,
    }  # fmt: skip
    return f'chirp to {highest:g} Hz at {amplitude:.3g} V', main, length, 0.0


def _step(amplitude: float, hold: float, rise: float) -> tuple[str, Spec, float, float]:
    times = [0.0, 0.2, 0.2 + rise, 0.2 + rise + hold, 0.2 + 2.0 * rise + hold]
    values = [0.0, 0.0, amplitude, amplitude, 0.0]
    main = {'kind': 'lines', 'times': times, 'values': values}
    return f'step to {amplitude:.3g} V held for {hold:g} s', main, times[-1], 0.0
