"""A sweep that runs in the controller: each record is one wave, at the rate of the servo."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.drivers.gcs.connection import DriverError
from piezo_hysteresis.drivers.gcs.controller import GcsController
from piezo_hysteresis.records import Record
from piezo_hysteresis.runtime.sweep_plan import RETURN, Sweep, parse_options

#: Time at 0 V before and behind a record [s].
REST = 0.05


def sweep(
    controller: GcsController,
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    seconds: float,
    *,
    warm_up: float = 0.0,
    waveform: str = 'sine',
    options: Mapping[str, object] | str = '',
    actuator: str = '',
    progress: Callable[[float, str], None] = lambda fraction, words: None,
) -> list[Record]:
    """Measure every frequency at every amplitude.

    All waves are checked before the first is loaded.

    Parameters
    ----------
    controller : GcsController
        In open loop, see `GcsController.open_loop`.
    frequencies, amplitudes : sequence of float
        [Hz], [V].
    seconds, warm_up : float
        Length of each record, and what errors leave out of it [s].
    waveform, options
        As `piezo_sim describe waveforms` lists them; options also as text in YAML.
    actuator : str
        Name of the actuator in the records.
    progress : callable
        Called with ``(fraction, name of the record)``.

    Returns
    -------
    list of Record
        With the voltage of the output, and what was commanded before the first sample.

    Raises
    ------
    PiezoError
        If a wave leaves the limits, or the controller fails.
    """
    divider = controller.divider_for(seconds + 2.0 * (REST + RETURN))
    rate = controller.identity.rate / divider
    settings = parse_options(options) if isinstance(options, str) else options
    planned = Sweep(
        frequencies, amplitudes, seconds, rate,
        warm_up=warm_up, waveform=waveform, options=settings,
    ).records  # fmt: skip
    waves = [whole(record.voltages, rate) for record in planned]
    for record, (_, wave) in zip(planned, waves, strict=True):
        try:
            controller.limits.require(wave, rate)
        except DriverError as error:
            raise DriverError(f'record {record.name}: {error}') from None
    records = []
    for k, (record, (first, wave)) in enumerate(zip(planned, waves, strict=True)):
        progress(k / len(planned), record.name)
        played = controller.play(wave, divider)
        last = first + record.voltages.size
        records.append(
            Record(
                record.name,
                played.dt,
                played.voltage[first:last],
                played.displacement[first:last],
                info=replace(record.info, actuator=actuator, start=_start(record.voltages)),
                before=played.voltage[:first],
            )
        )
    progress(1.0, 'measured')
    return records


def _start(voltages: FloatArray) -> str:
    """Return how a record begins: a bag does not keep the ramp before it."""
    return 'step' if voltages[0] == 0.0 else 'auto'


def whole(voltages: FloatArray, rate: float) -> tuple[int, FloatArray]:
    """Return a wave from 0 V to 0 V with a record in it, and the place of its first sample."""
    rest, ramp = np.zeros(max(2, round(REST * rate))), max(2, round(RETURN * rate))
    smooth = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, ramp + 1) / ramp)
    begin = [rest] if voltages[0] == 0.0 else [rest, voltages[0] * smooth[:-1]]
    end = [voltages[-1] * (1.0 - smooth), rest]
    wave = np.concatenate([*begin, voltages, *end])
    return sum(part.size for part in begin), wave
