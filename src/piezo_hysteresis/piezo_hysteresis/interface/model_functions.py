"""Functions of a model with values: frequency response, inverse of an array, C library."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_hysteresis.compensation.controllers import Controllers, Feedback
from piezo_hysteresis.compensation.drive_selection import entry_of
from piezo_hysteresis.compensation.feedback.feedback_link import PidGains
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.inverses.inverse_choice import model_gain
from piezo_hysteresis.compensation.inverses.reach import reach_of
from piezo_hysteresis.compensation.limiter import EnergyLimits, packed_limits
from piezo_hysteresis.compensation.offline_loop import ModelPlant, closed_loop
from piezo_hysteresis.compensation.operating_limits import (
    UNSTATED,
    above_nyquist,
    limited_samples,
    operating_limits,
    rate_of,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.export.library import Drive, Request, files_of
from piezo_hysteresis.export.native import known_target
from piezo_hysteresis.models.choice import ModelLike, with_values
from piezo_hysteresis.models.model_actions import InverseResult
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.reporting.folder import check_folder, write_folder
from piezo_hysteresis.waveforms.waveform import Sampled

# Amplitude of the sine of example and test vectors, relative to the range of the model.
_SHARE = 0.8
IDENTIFIER = re.compile(r'[A-Za-z_]\w*')
TARGET = 'x86_64-linux'


def frequency_response(
    model: ModelLike, frequency: ArrayLike, *, amplitude: float | None, rate: float | None
) -> NDArray[np.complex128]:
    """Return the complex gain, see `ModelActions.frequency_response`."""
    given = with_values(model)
    sampled = rate_of(given, rate)
    lines = np.asarray(frequency, np.float64)
    if not np.all(np.abs(lines) < 0.5 * sampled):
        raise CompensationError(
            f'frequencies must be below {0.5 * sampled:g} Hz, half the rate; give a higher rate='
        )
    level = _half_range(given) if amplitude is None else amplitude
    flat = np.atleast_1d(lines).ravel().tolist()
    drives = {id(own): own for own in (given.at(abs(line)) for line in flat)}
    gains = {
        key: model_gain(own.model, own.values, 1.0 / sampled, level) for key, own in drives.items()
    }
    found = [gains[id(given.at(abs(line)))](line) for line in flat]
    return np.array(found, np.complex128).reshape(lines.shape)


def _half_range(model: ModelFile) -> float:
    covered = model.provenance.voltage
    if covered is None:
        raise CompensationError(
            f'{UNSTATED}: identify again, or give amplitude=, that of the large drive [V]'
        )
    return 0.5 * (covered.high - covered.low)


def inverse(
    model: ModelLike,
    reference: ArrayLike,
    dt: float | None,
    *,
    low: float | None,
    high: float | None,
    slew: float | None,
    law: str,
) -> InverseResult:
    """Return the voltage for a reference, see `ModelActions.inverse`."""
    given = with_values(model)
    step = 1.0 / rate_of(given) if dt is None else dt
    if not (isinstance(step, (int, float)) and math.isfinite(step) and step > 0):
        raise CompensationError(f'dt must be a positive number [s], got {dt!r}')
    try:
        values = np.asarray(reference, np.float64)
    except (TypeError, ValueError):
        raise CompensationError(
            'inverse takes an array of displacements [m] and dt [s]; a reference in words, such '
            "as 'sine:frequency=23,amplitude=80e-6', goes to ph.compensate"
        ) from None
    wave = Sampled(values, step)
    bounds = operating_limits(given, low=low, high=high, slew=slew)
    link = Controllers(step, limits=bounds.limits, model=given, law=law, start=0.0).inverse()
    samples = wave.sample(np.asarray(step * np.arange(values.size), np.float64))
    own = entry_of(given, samples, step)
    plant = ModelPlant(own.model, own.values, step)
    run = closed_loop(samples, [link], plant, bounds.limits, step)
    counts = run.counters['limiter']
    at_end = int(np.sum((run.voltage <= bounds.limits.low) | (run.voltage >= bounds.limits.high)))
    counts = {**counts, 'out_of_range': max(at_end, counts['out_of_range'])}
    return InverseResult(
        step, run.reference, run.voltage, run.displacement,
        limited_samples(bounds.limits, counts, values.size),
        (*bounds.warnings, *above_nyquist(given, step)),
    )  # fmt: skip


def export(
    model: ModelLike,
    path: str | Path,
    *,
    rate: float | None = None,
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    law: str = 'auto',
    attenuation: AttenuationSettings | None = None,
    pid: Sequence[float] | None = None,
    name: str = 'piezo',
    target: str = TARGET,
    frequency: float | None = None,
    only_plant: bool = False,
) -> Path:
    """Write a model and its compensator as a C library.

    Parameters
    ----------
    model : str, Path, Model, Identification or Discovery
        A model with values.
    path : str or Path
        Folder of the library, its header, an example and its tests.
    rate : float, optional
        Steps per second [Hz]; that of the data of the model, or 1000.
    low, high, slew : float, optional
        Limits of the voltage [V], [V/s]; those of the data of the model.
    law : str
        Kind of inverse, one of `piezo_hysteresis.compensation.link.INVERSES`.
    attenuation : AttenuationSettings, optional
        Attenuation of harmonics; none by default.
    pid : sequence of float, shape (3,), optional
        Gains of a PID controller: [V/m], [V/(m s)], [V s/m].
    name : str
        Name of the library and prefix of its symbols.
    target : str
        ``x86_64-linux`` or ``aarch64-linux``.
    frequency : float, optional
        Frequency of the sine in the example [Hz], by default 23; of a model identified per
        frequency also that of the exported entry.
    only_plant : bool
        Whether the library holds the model alone.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    PiezoError
        If the model has no values or cannot be exported, or the folder holds other files.
    """
    given = with_values(model)
    sampled = rate_of(given, rate)
    feedback = None if pid is None else Feedback('pid', PidGains(*pid))
    bounds = operating_limits(given, low=low, high=high, slew=slew)
    for sentence in bounds.warnings:
        warnings.warn(sentence, stacklevel=3)
    controllers = Controllers(
        1.0 / sampled, limits=bounds.limits, model=given, law=law, attenuation=attenuation,
        feedback=feedback,
    )  # fmt: skip
    write_library(given, controllers, path, name=name, target=target, frequency=frequency,
                  only_plant=only_plant)  # fmt: skip
    return Path(path)


def write_library(
    model: ModelFile,
    controllers: Controllers,
    path: str | Path,
    *,
    name: str,
    target: str,
    frequency: float | None,
    only_plant: bool,
    energy: Sequence[float] | None = None,
) -> int:
    """Write the complete library, no file after an error; return the size of the archive."""
    check_folder(path, 'export')
    known_target(target)
    if model.schedule is not None and frequency is None:
        raise CompensationError(
            'a library holds one set of parameters, and this model has one per frequency; give '
            'the frequency of the drive (--frequency 23)'
        )
    frequency = 23.0 if frequency is None else frequency
    model = model.at(frequency)
    controllers = replace(controllers, model=model)
    dt, limits = controllers.dt, controllers.limits
    if not 1.0 / dt <= 1e6:
        raise CompensationError(f'the rate must be above 0 and up to 1 MHz, got {1.0 / dt:g} Hz')
    if not 0.0 < frequency < 0.25 / dt:
        raise CompensationError(
            f'a sine of {frequency:g} Hz cannot be tracked at {1.0 / dt:g} Hz; give a frequency '
            'below a quarter of the rate'
        )
    if not IDENTIFIER.fullmatch(name):
        raise CompensationError(f'{name!r} is no name in C; give letters and digits')
    # without a limit only the length of the window matters; the supply is the voltage range
    power, capacitance, window = energy or (0.0, 1e-6, max(1.0, 20.0 * dt))
    bound = EnergyLimits(power, capacitance, window, limits.high - limits.low)
    packed_limits(limits, dt, bound)
    reach = reach_of(model.model, model.values, dt, limits)
    mode = controllers.mode()
    assert mode is not None
    centre = 0.5 * (limits.low + limits.high)
    drive = Drive(frequency, _SHARE * reach.half, reach.middle, mode.gain, centre)
    asked = Request(
        name, model, lambda: [] if only_plant else controllers.links(by_mode=True), limits, bound,
        dt, target, drive,
    )  # fmt: skip
    files = files_of(asked)
    write_folder(path, files, 'export')
    return len(files[f'lib{name}.a'])
