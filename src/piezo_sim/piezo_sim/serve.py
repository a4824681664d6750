"""The verb `plant`: an actuator that another program drives over a pipe, one tick at a time.

It writes one line of JSON with its properties, then answers every voltage with the displacement
measured before that voltage acts: eight bytes in, eight bytes out, little-endian doubles. A
voltage that is not a number resets the actuator to rest and is answered by 0. The program ends
with its input.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import sys
from typing import BinaryIO

from piezo_sim.plant import Plant

_NUMBER = struct.Struct('<d')


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


def run(options: argparse.Namespace, overrides: dict[str, float | bool]) -> int:
    """Serve the actuator of the command line on its standard streams."""
    plant = Plant.from_preset(options.preset, options.rate, options.seed, overrides)
    plant.exchange(0.0)  # compiled before the first tick
    plant.reset()
    serve(plant, sys.stdin.buffer, sys.stdout.buffer)
    return 0
