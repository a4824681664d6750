"""The verb `plant`: an actuator that another program drives over a pipe, one tick at a time.

It writes one line of JSON with its properties, then answers every voltage with the displacement
measured before that voltage acts: eight bytes in, eight bytes out, little-endian doubles. A
voltage that is not a number resets the actuator to rest and is answered by 0. The program ends
with its input.

Several axes take blocks of ticks: the number of ticks (eight bytes, an integer), then as many
voltages as there are axes for each tick; the answer are the displacements in the same order. No
ticks reset the actuators to rest, without an answer.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import yaml

from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.records import Record, write_bag, write_csv
from piezo_sim.axes_plant import FOLDER, AxesPlant
from piezo_sim.plant import Plant
from piezo_sim.presets import preset_names
from piezo_sim.simulation_errors import SweepError


def check_target(path: Path, count: int) -> None:
    """Reject a target that cannot store `count` records, before the simulation."""
    if path.exists():
        raise SweepError(f'{path} exists already; remove it or choose another name')
    if path.suffix == '.csv' and count != 1:
        raise SweepError(
            f'a CSV file holds one record, the sweep has {count}; write a bag (a name without '
            'suffix) or an archive (.npz)'
        )


def write_records(path: Path, records: Sequence[Record]) -> None:
    """Write records as a bag, or in the format of the suffix (``.npz``, ``.csv``)."""
    if path.suffix == '.csv':
        write_csv(path, records[0])
    elif path.suffix == '.npz':
        columns: dict[str, Any] = {}
        for record in records:
            columns[f'{record.name}/time_s'] = record.time
            columns[f'{record.name}/voltage_V'] = record.voltage
            columns[f'{record.name}/displacement_m'] = record.displacement
        write_arrays(path, columns)
    else:
        write_bag(path, records)


def labels(
    plant: Plant, preset: str, overrides: Mapping[str, float | bool], seed: int
) -> dict[str, Any]:
    """Return the true simulation settings, which a bag does not contain."""
    usual = Plant.from_preset(preset).effects
    on = [name for name, active in plant.effects.items() if active]
    return {
        'preset': preset,
        'seed': seed,
        'rate_hz': plant.rate,
        'overrides': dict(overrides),
        'effects': on,
        'effects_beyond_the_preset': [name for name in on if not usual[name]],
        'exotic_effects': [
            row.name for row in plant.effect_table if row.exotic and row.name in on
        ],
        'parameters': plant.parameters,
    }


def write_labels(path: Path, content: Mapping[str, Any]) -> None:
    """Write `labels` as JSON or YAML, according to the suffix."""
    if path.suffix == '.json':
        text = json.dumps(content, indent=2) + '\n'
    elif path.suffix in ('.yaml', '.yml'):
        text = yaml.safe_dump(dict(content), sort_keys=False)
    else:
        raise SweepError(f'{path}: the labels are written as .json or .yaml')
    _replace(path, lambda temporary: temporary.write_text(text, encoding='utf-8'))


def write_arrays(path: Path, columns: Mapping[str, Any]) -> None:
    """Write arrays as .npz, complete or not at all."""
    _replace(path, lambda temporary: _save(temporary, columns))


def _save(path: Path, columns: Mapping[str, Any]) -> None:
    with path.open('wb') as file:
        np.savez_compressed(file, allow_pickle=False, **columns)


def _replace(path: Path, write: Any) -> None:
    """Write a temporary file and rename it to `path`, so that it is complete or unchanged."""
    try:
        with write_atomically(path) as temporary:
            write(temporary)
    except OSError as error:
        raise SweepError(f'{path} cannot be written: {reason_of(error)}') from None


_NUMBER = struct.Struct('<d')
_COUNT = struct.Struct('<q')


def about(plant: Plant) -> dict[str, str | float]:  # -> [rad]
    """Return the properties of an actuator for a controller: rate, range and usual drive."""
    preset = plant.preset
    low, high = _range(plant)
    slew = plant.parameters['amplifier.slew_rate'] if plant.effects['slew_limit'] else math.inf
    return {
        'preset': preset.name,
        'rate_hz': plant.rate,
        'low_v': low,
        'high_v': high,
        'slew_v_per_s': min(float(slew), (high - low) * plant.rate),
        'offset_m': preset.displacement * preset.bias / preset.voltage,
        'phase': preset.phase,
    }


def _range(plant: Plant) -> tuple[float, float]:
    """Return the voltage range of a controller [V]."""
    names = ('amplifier.range_low', 'amplifier.range_high')
    low, high = (float(plant.parameters[name]) for name in names)
    own, preset = plant.preset.values(), plant.preset
    if (low, high) != tuple(own[name] for name in names):
        return low, high
    more = 1.2 * preset.voltage
    return max(low, preset.bias - more), min(high, preset.bias + more)


def serve(plant: Plant, source: BinaryIO, sink: BinaryIO) -> None:
    """Answer voltages until `source` ends."""
    sink.write(json.dumps(about(plant)).encode() + b'\n')
    sink.flush()
    while len(number := source.read(_NUMBER.size)) == _NUMBER.size:
        (voltage,) = _NUMBER.unpack(number)
        if math.isnan(voltage):
            plant.reset()
            answer = 0.0
        else:
            answer = plant.exchange(voltage)
        sink.write(_NUMBER.pack(answer))
        sink.flush()


def serve_axes(plant: AxesPlant, source: BinaryIO, sink: BinaryIO) -> None:
    """Answer blocks of voltages of all axes until `source` ends."""
    low, high = plant.command_range
    about = {
        'preset': plant.preset.name, 'rate_hz': plant.rate, 'axes': plant.axes, 'low_v': low,
        'high_v': high,
    }  # fmt: skip
    sink.write(json.dumps(about).encode() + b'\n')
    sink.flush()
    while len(number := source.read(_COUNT.size)) == _COUNT.size:
        (ticks,) = _COUNT.unpack(number)
        if ticks == 0:
            plant.reset()
            continue
        block = source.read(ticks * plant.axes * _NUMBER.size)
        voltages = np.frombuffer(block, '<f8').reshape(ticks, plant.axes)
        sink.write(plant.run(voltages).astype('<f8').tobytes())
        sink.flush()


def run(options: argparse.Namespace, overrides: dict[str, float | bool]) -> int:
    """Serve the actuator of the command line on its standard streams."""
    if options.preset in preset_names(FOLDER):
        several = AxesPlant.from_preset(options.preset, options.rate, options.seed, overrides)
        several.run(np.zeros((1, several.axes)))  # compiled before the first tick
        several.reset()
        serve_axes(several, sys.stdin.buffer, sys.stdout.buffer)
        return 0
    plant = Plant.from_preset(options.preset, options.rate, options.seed, overrides)
    plant.exchange(0.0)  # compiled before the first tick
    plant.reset()
    serve(plant, sys.stdin.buffer, sys.stdout.buffer)
    return 0
