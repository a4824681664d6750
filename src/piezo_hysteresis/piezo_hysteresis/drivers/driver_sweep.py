"""A sweep that runs in the controller: each record is one wave, at the rate of the servo."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.drivers.controller import Controller
from piezo_hysteresis.drivers.wires import DriverError
from piezo_hysteresis.records import Record, RecordInfo, write_bag
from piezo_hysteresis.runtime.sweep_plan import RETURN, Sweep, SweepRecord, parse_options

#: Time at 0 V before and behind a record [s].
REST = 0.05
#: File with the identity of the controller, in the folder of a bag.
ABOUT = 'controller.yaml'


def sweep(
    controller: Controller,
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    seconds: float,
    *,
    warm_up: float = 0.0,
    waveform: str = 'sine',
    options: Mapping[str, object] | str = '',
    actuator: str = '',
    progress: Callable[[float, str], None] = lambda fraction, words: None,
    watch: Callable[[], None] = lambda: None,
) -> list[Record]:
    """Measure every frequency at every amplitude.

    All waves are checked before the first is loaded.

    Parameters
    ----------
    controller : Controller
        In open loop, see `Controller.open_loop`.
    frequencies, amplitudes : sequence of float
        [Hz], [V].
    seconds, warm_up : float
        Length of each record, and its part that is excluded from errors [s].
    waveform, options
        As `piezo_sim describe waveforms` lists them; options also as text in YAML.
    actuator : str
        Name of the actuator in the records.
    progress : callable
        Called with ``(fraction, name of the record)``.
    watch : callable
        Called periodically while a wave runs; an exception stops the sweep at rest.

    Returns
    -------
    list of Record
        With the output voltage, and the commands before the first sample.

    Raises
    ------
    PiezoError
        If a wave leaves the limits, or the controller fails.
    """
    planned, divider = planned_sweep(
        controller, frequencies, amplitudes, seconds, warm_up, waveform, options
    )
    records = []
    for k, record in enumerate(planned):
        progress(k / len(planned), record.name)
        info = replace(record.info, actuator=actuator)
        records.append(measured(controller, record.name, record.voltages, info, divider, watch))
    progress(1.0, 'measured')
    return records


def planned_sweep(
    controller: Controller,
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    seconds: float,
    warm_up: float = 0.0,
    waveform: str = 'sine',
    options: Mapping[str, object] | str = '',
) -> tuple[list[SweepRecord], int]:
    """Return the records of a sweep, all of them checked, and the servo ticks per point."""
    divider = controller.divider_for(seconds + 2.0 * (REST + RETURN))
    rate = controller.identity.rate / divider
    settings = parse_options(options) if isinstance(options, str) else options
    planned = Sweep(
        frequencies, amplitudes, seconds, rate,
        warm_up=warm_up, waveform=waveform, options=settings,
    ).records  # fmt: skip
    for record in planned:
        try:
            controller.require(whole(record.voltages, rate)[1], rate)
        except DriverError as error:
            raise DriverError(f'record {record.name}: {error}') from None
    return planned, divider


def measured(
    controller: Controller,
    name: str,
    voltages: FloatArray,  # [V] (n,)
    info: RecordInfo,
    divider: int,
    watch: Callable[[], None] = lambda: None,
) -> Record:
    """Play one record and return what was measured."""
    first, wave = whole(voltages, controller.identity.rate / divider)
    played = controller.play(wave, divider, watch)
    own = slice(first, first + voltages.size)
    reached = _reached(played.voltage, divider) if controller.interpolates else played.voltage
    return Record(
        name,
        played.dt,
        reached[own],
        played.displacement[own],
        info=replace(info, start=_start(voltages)),
        before=reached[:first],
    )


def _reached(voltage: FloatArray, divider: int) -> FloatArray:
    """Return the voltage of each sample when the next displacement is taken.

    A model holds the voltage of a sample until then. An output that moves in a straight line over
    `divider` ticks has reached the next voltage but for one tick: the displacement of a tick is
    taken before its voltage is set.
    """
    return voltage + np.diff(voltage, append=voltage[-1]) * (1.0 - 1.0 / divider)


def write_measured(
    bag: Path, records: Sequence[Record], about: Mapping[str, Any], namespace: str = 'piezo'
) -> None:
    """Write a bag, with the identity of the controller in its folder."""
    rates = {'rate': records[0].rate} if records else {}
    write_bag(bag, records, namespace=namespace)
    with write_atomically(bag / ABOUT) as path:
        text = yaml.safe_dump({**about, **rates}, sort_keys=False, allow_unicode=True)
        path.write_text(text, 'utf-8')


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
