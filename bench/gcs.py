"""A sweep in a controller at 20 kHz against the same sweep over nodes in real time at 1 kHz.

    python bench/gcs.py [--frequencies 10] [--seconds 2] [--preset fdk_pzba_00030]

Both drive the same simulated actuator, over the loopback; nothing here ran on hardware. A sample
is off where it does not hold the planned voltage: its command was late. Jitter is the rms
deviation of the time at which a recorder gets one sample after the other. The controller numbers
samples by ticks of its servo, so that one which holds its planned voltage has none. Wall time is
that of the sweep with loading and reading, without the start of the nodes (NodeProcesses), per
second of record.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.common import topics
from piezo_hysteresis.drivers import open_controller, planned_sweep, sweep
from piezo_hysteresis.nodes.live import LiveSweep, record_sweep
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.bag_content import read_content
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.runtime.sweep_plan import Sweep, SweepRecord
from piezo_sim.gcs.controller import SimulatedController
from piezo_sim.gcs.server import GcsServer
from piezo_sim.plant import Plant

CONTROLLER_RATE, NODE_RATE = 20_000.0, 1000.0
ROUNDING = 1e-8  # of voltages in answers of the controller [V]


@dataclass(frozen=True)
class Way:
    """What one way to sweep shows.

    Attributes
    ----------
    name : str
        Of the way.
    rate : float
        Of its samples [Hz].
    samples, off : int
        Recorded, and those without the planned voltage.
    jitter : float
        Rms deviation of the time between two samples [us].
    wall : float
        Time of the whole sweep per second of record [1].
    """

    name: str
    rate: float
    samples: int
    off: int
    jitter: float
    wall: float

    def line(self) -> str:
        """Return a row of the table."""
        return (
            f'{self.name:12}{self.rate:8g} Hz{self.samples:10} samples, '
            f'{100.0 * self.off / self.samples:7.3f} % off, jitter {self.jitter:8.2f} us, '
            f'{self.wall:5.2f} s per s of record'
        )


def off(records: list[Record], planned: list[SweepRecord]) -> int:
    """Return how many samples do not hold the planned voltage, or are not there."""
    count = 0
    for record, plan in zip(records, planned, strict=True):
        size = min(len(record), plan.voltages.size)
        wrong = np.abs(record.voltage[:size] - plan.voltages[:size]) > ROUNDING
        count += int(np.count_nonzero(wrong)) + plan.voltages.size - size
    return count


def in_controller(preset: str, frequencies: list[float], seconds: float) -> Way:
    """Sweep in the controller, in real time."""
    server = GcsServer(SimulatedController(Plant.from_preset(preset, CONTROLLER_RATE)))
    serving = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    serving.start()
    with open_controller(f'gcs://127.0.0.1:{server.server_address[1]}') as controller:
        controller.open_loop()
        planned, _ = planned_sweep(controller, frequencies, [1.0], seconds)
        began = time.monotonic()
        records = sweep(controller, frequencies, [1.0], seconds)
        taken = time.monotonic() - began
    server.shutdown()
    serving.join()
    server.server_close()
    samples, wrong = sum(map(len, records)), off(records, planned)
    jitter = 0.0 if wrong == 0 else float('nan')
    return Way(
        'controller', records[0].rate, samples, wrong, jitter, taken * records[0].rate / samples
    )


def over_nodes(preset: str, frequencies: list[float], seconds: float) -> Way:
    """Sweep over simulator, excitation and recorder, in real time."""
    order = LiveSweep(frequencies, [1.0], seconds, 0.0)
    with tempfile.TemporaryDirectory() as name:
        bag = Path(name) / 'bag'
        records = record_sweep(preset, order, bag, simulator={'clock': 'real_time'})
        content = read_content(bag, DamageLog())
        (state,) = (t for n, t in content.topics.items() if n.endswith(topics.STATE))
        logged = state.log_time()
    steps = 1e-3 * np.diff(logged)
    planned = Sweep(frequencies, [1.0], seconds, NODE_RATE).records
    wall = 1e-9 * float(logged[-1] - logged[0]) / (seconds * len(frequencies))
    jitter = float(np.sqrt(np.mean((steps - 1e6 / NODE_RATE) ** 2)))
    samples = sum(map(len, records))
    return Way('nodes', NODE_RATE, samples, off(records, planned), jitter, wall)


def main() -> int:
    """Measure both ways and print a table, and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frequencies', type=int, default=10, help='how many, from 1 to 100 Hz')
    parser.add_argument('--seconds', type=float, default=2.0, help='of each record')
    parser.add_argument('--preset', default='fdk_pzba_00030')
    words = parsed(parser, frequencies=2, seconds=0.5)
    frequencies = [round(float(f), 3) for f in np.geomspace(1.0, 100.0, words.frequencies)]
    controller = in_controller(words.preset, frequencies, words.seconds)
    print(controller.line(), flush=True)
    nodes = over_nodes(words.preset, frequencies, words.seconds)
    print(nodes.line())
    print(
        f'controller to nodes: {controller.samples / nodes.samples:.3g} times the samples, '
        f'{controller.wall / nodes.wall:.3g} times the wall time'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
