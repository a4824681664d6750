"""Sweeps: many records of one actuator, simulated much faster than real time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Waveform, from_spec, has_setting
from piezo_hysteresis.waveforms.sine import smooth_ramp
from piezo_sim.plant import Plant
from piezo_sim.simulation_errors import SweepError

FloatArray = npt.NDArray[np.float64]

LEAD_IN = 1.0  # duration of the transition to the first voltage of a record [s]
_OWN_KEYS = ('name', 'warm_up')


def simulate(
    preset: str,
    waveform_specs: Iterable[Mapping[str, Any]],
    overrides: Mapping[str, float | bool] | None = None,
    seed: int = 0,
    rate: float | None = None,  # [Hz]
    *,
    actuator: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Record]:
    """Simulate one record per waveform, each from rest.

    If a waveform does not start at 0 V, the actuator first moves there smoothly within a second,
    which is not recorded.
    """
    plant = Plant.from_preset(preset, rate, seed, overrides)
    specs = list(waveform_specs)
    if not specs:
        raise SweepError('the sweep has no records; give at least one frequency and amplitude')
    waveforms = [
        from_spec({key: spec[key] for key in spec if key not in _OWN_KEYS}) for spec in specs
    ]
    names = record_names(specs)
    voltages = [commands(waveform, plant.rate) for waveform in waveforms]
    _check_range(plant, voltages, names)
    records = []
    for k, (spec, waveform) in enumerate(zip(specs, waveforms, strict=True)):
        plant.reset(seed=record_seed(seed, k))
        info = RecordInfo(
            actuator=actuator if actuator is not None else preset,
            excitation=str(spec['kind']),
            frequency=_frequency(waveform),
            amplitude=abs(float(spec.get('amplitude', 0.0))),
            warm_up=float(spec.get('warm_up', 0.1 * waveform.duration)),
        )
        voltage = np.clip(voltages[k], *plant.command_range)
        lead_in(plant, float(voltage[0]))
        displacement = plant.run(voltage)
        records.append(Record(names[k], 1.0 / plant.rate, voltage, displacement, info=info))
        if progress is not None:
            progress((k + 1) / len(specs))
    return records


def record_seed(seed: int, index: int) -> int:
    """Return the seed of record `index`, independent of the other records."""
    return int(np.random.SeedSequence([seed, index]).generate_state(1, np.uint64)[0])


def commands(waveform: Waveform, rate: float) -> FloatArray:
    """Return the voltage commands [V] of a waveform at every tick of its duration."""
    count = round(waveform.duration * rate)
    if count < 2:
        raise SweepError(f'{waveform.duration:g} s at {rate:g} Hz is less than two samples')
    return waveform.sample(np.arange(count) / rate).value


def lead_in(plant: Plant, voltage: float) -> None:
    """Move the actuator smoothly from 0 V to `voltage` [V] before a record."""
    if voltage != 0.0:
        share = np.linspace(0.0, 1.0, max(2, round(LEAD_IN * plant.rate)))
        plant.run(voltage * smooth_ramp(share, 1.0)[0])


def record_names(specs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a name for every record: the given one, or kind, frequency and amplitude."""
    names: list[str] = []
    for spec in specs:
        parts = [str(spec.get('kind', 'unknown'))]
        parts += [f'{spec["frequency"]:g}Hz'] if 'frequency' in spec else []
        parts += [f'{spec["amplitude"]:g}V'] if 'amplitude' in spec else []
        name = label = str(spec.get('name') or '_'.join(parts))
        again = 2
        while name in names:
            name, again = f'{label}_{again}', again + 1
        names.append(name)
    return names


def grid(
    kind: str,
    frequencies: Sequence[float],
    amplitudes: Sequence[float],
    settings: Mapping[str, Any],
) -> list[dict[str, Any]]:
    """Return one specification per frequency and amplitude; kinds without them occur once each."""
    axes = {'amplitude': amplitudes, 'frequency': frequencies}
    given = {name: values for name, values in axes.items() if values and has_setting(kind, name)}
    return [
        {'kind': kind, **settings, **dict(zip(given, values, strict=True))}
        for values in product(*given.values())
    ]


def _frequency(waveform: Waveform) -> float:
    """Return the fundamental [Hz], 0 if it varies or does not exist."""
    frequency = waveform.sample(np.linspace(0.0, waveform.duration, 9)).frequency
    return float(frequency[0]) if np.all(frequency == frequency[0]) else 0.0


def _check_range(plant: Plant, voltages: Sequence[FloatArray], names: Sequence[str]) -> None:
    low, high = plant.command_range
    for values, name in zip(voltages, names, strict=True):
        if values.min() < low - 1e-9 or values.max() > high + 1e-9:
            raise SweepError(
                f'record {name} needs {values.min():g} .. {values.max():g} V, but the amplifier '
                f'takes {low:g} .. {high:g} V; lower the amplitude or set amplifier.range_low and '
                'amplifier.range_high'
            )
