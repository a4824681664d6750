"""The verb `plant`: an actuator that another program drives, one tick after another, over a pipe.

It writes one line of JSON about itself, then answers every voltage with the displacement that was
measured before that voltage acts: eight bytes in, eight bytes out, doubles with the lowest byte
first. A voltage that is no number puts it back to rest and is answered by 0. It ends with its
input.
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


def serve(plant: Plant, source: BinaryIO, sink: BinaryIO) -> None:
    """Send voltages until `source` ends."""
    values = plant.parameters
    about = {
        'preset': plant.preset.name,
        'rate_hz': plant.rate,
        'low_v': float(values['amplifier.range_low']),
        'high_v': float(values['amplifier.range_high']),
    }
    sink.write(json.dumps(about).encode() + b'\n')
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
