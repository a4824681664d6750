"""The verb `axes`: periodic records of several axes, driven independently, in steady state."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from piezo_hysteresis.common.wording import counted
from piezo_sim.axes_plant import AxesPlant
from piezo_sim.serve import check_target, write_arrays, write_labels
from piezo_sim.simulation_errors import SweepError

FloatArray = npt.NDArray[np.float64]

# Signs of up to three axes in four records: every pair of axes has every pair of signs, so that
# records in which one axis repeats its voltage show what the others do to it.
SIGNS = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]])
_WAVEFORMS = 2  # of each axis, in eight realisations
SETTLING = 2  # periods before the recorded ones
RECORDED = 2  # periods of a record: their difference shows the noise


def configure_axes(parser: argparse.ArgumentParser, numbers: Any, assignment: Any) -> None:
    """Add the arguments of the verb; `numbers` and `assignment` parse as for the other verbs."""
    add = parser.add_argument
    add('--preset', default='xy_scanner', help='actuators, see `python -m piezo_sim presets`')
    add('--out', type=Path, required=True, help='.npz file of u_LEVEL, y_LEVEL and dt')
    add('--levels', type=numbers, help='rms of the voltages [V] (default: a tenth and a fifth of '
        'the usual drive)')  # fmt: skip
    add(
        '--realisations',
        type=int,
        help='records of each level (default: 5, four of the same waveforms with other signs)',
    )
    add('--seconds', type=float, default=0.5, help='one period [s]; two are recorded')
    add('--band', type=numbers, default=[2.0, 1500.0], help='lowest, highest frequency [Hz]')
    add('--rate', type=float, help='sampling rate [Hz] (default: of the preset)')
    add('--seed', type=int, default=0, help='seed of the drive and of all noise')
    add('--set', type=assignment, action='append', default=[], metavar='NAME=VALUE',
        help='parameter, such as axis_1.effects.creep=false or effects.cross_talk_1_to_2=false'
        )  # fmt: skip
    add('--reveal', type=Path, help='write the true parameters to this .json or .yaml file')
    parser.set_defaults(run=run)


def multisine(
    axes: int, samples: int, rate: float, band: tuple[float, float], rng: np.random.Generator
) -> FloatArray:
    """Return one period for each axis, of unit rms, phases and axes independent, (samples, axes).

    The lines have equal power up to a tenth of the band, and fall with the frequency beyond, as
    slew rates of amplifiers demand.
    """
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    lines = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]) & (frequency > 0.0))
    if lines.size < 2:
        raise SweepError(
            f'{band[0]:g} to {band[1]:g} Hz holds less than two lines of a period of '
            f'{samples / rate:g} s; lengthen it or widen the band'
        )
    spectrum = np.zeros((frequency.size, axes), complex)
    corner = band[0] + 0.1 * (band[1] - band[0])
    size = 1.0 / np.maximum(1.0, frequency[lines] / corner)
    spectrum[lines] = size[:, None] * np.exp(2j * np.pi * rng.random((lines.size, axes)))
    x = np.fft.irfft(spectrum, samples, axis=0)
    return np.asarray(x / np.sqrt(np.mean(x**2, axis=0)))


def simulate_axes(
    plant: AxesPlant,
    level: float,
    realisations: int,
    seconds: float,
    band: tuple[float, float],
    seed: int = 0,
) -> tuple[FloatArray, FloatArray]:
    """Return voltages [V] and displacements [m], (samples, axes, realisations, periods).

    Of eight realisations every other one has the same waveforms with other `SIGNS`, so that
    neighbours are independent.
    """
    samples = round(seconds * plant.rate)
    shape = (samples, plant.axes, realisations, RECORDED)
    voltage, displacement = np.empty(shape), np.empty(shape)
    low, high = plant.command_range
    for k in range(realisations):
        key = [seed, k, round(1e6 * level)]
        block, place = divmod(k, _WAVEFORMS * len(SIGNS))
        rng = np.random.default_rng([seed, _WAVEFORMS * block + place % _WAVEFORMS, key[2]])
        u = level * multisine(plant.axes, samples, plant.rate, band, rng)
        u *= SIGNS[place // _WAVEFORMS, : plant.axes]
        if u.min() < low or u.max() > high:
            raise SweepError(
                f'{level:g} V rms reach {u.min():.3g} to {u.max():.3g} V, but the amplifiers take '
                f'{low:g} to {high:g} V; lower the level'
            )
        plant.reset(int(np.random.SeedSequence(key).generate_state(1, np.uint64)[0]))
        y = plant.run(np.tile(u, (SETTLING + RECORDED, 1)))[SETTLING * samples :]
        for period in range(RECORDED):
            voltage[:, :, k, period] = u
            displacement[:, :, k, period] = y[period * samples : (period + 1) * samples]
    return voltage, displacement


def run(options: argparse.Namespace) -> int:
    """Simulate the records of the command line and write them."""
    overrides = dict(options.set)
    plant = AxesPlant.from_preset(options.preset, options.rate, options.seed, overrides)
    if options.out.suffix != '.npz' or len(options.band) != 2:
        raise SweepError('records of several axes are written as .npz; --band takes two numbers')
    check_target(options.out, 1)
    usual = plant.preset.voltage
    levels = options.levels or [0.1 * usual, 0.2 * usual]
    many = options.realisations or _WAVEFORMS * len(SIGNS) + 1
    arrays: dict[str, Any] = {'dt': 1.0 / plant.rate}
    for level in levels:
        name = f'{level:g}V'
        arrays[f'u_{name}'], arrays[f'y_{name}'] = simulate_axes(
            plant, level, many, options.seconds, tuple(options.band), options.seed
        )
    write_arrays(options.out, arrays)
    if options.reveal is not None:
        write_labels(options.reveal, {
            'preset': options.preset, 'seed': options.seed, 'rate_hz': plant.rate,
            'overrides': overrides, 'parameters': plant.parameters,
        })  # fmt: skip
    print(
        f'{options.out}: {counted(plant.axes, "axis")}, {counted(len(levels), "level")} '
        f'of {counted(many, "realisation")}, {RECORDED} periods of {options.seconds:g} s at '
        f'{plant.rate:g} Hz'
    )
    return 0
