"""Reading a bag as whole topics against plain rosbags, message by message.

Both read the same file in this run and must give equal arrays; the ratio of processor times is
what counts.

    python bench/records.py [--samples 1000000] [--large 5000000]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis import records
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records.definitions import STATE, typestore


def sweep(samples: int) -> records.Record:
    """Return a record of that many samples; reading does not care for their values."""
    rng = np.random.default_rng(1)
    voltage = 75 + 75 * np.sin(2 * np.pi * 23 * np.arange(samples) / 10_000)
    displacement = 1e-7 * voltage + 1e-8 * rng.standard_normal(samples)
    return records.Record('sweep', 1e-4, voltage, displacement)


def plain(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return voltage and displacement as a user of rosbags reads them."""
    from rosbags.rosbag2 import Reader

    store = typestore()
    voltage, displacement = [], []
    with Reader(path) as reader:
        wanted = [c for c in reader.connections if c.msgtype == STATE]
        for _, _, data in reader.messages(wanted):
            message: Any = store.deserialize_cdr(data, STATE)
            voltage.append(message.voltage)
            displacement.append(message.displacement)
    return np.array(voltage), np.array(displacement)


def timed(task: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time a task took [s], and its result: others may load the machine."""
    start = time.process_time()
    result = task()
    return time.process_time() - start, result


def main() -> int:
    """Run the comparison; exit code 1 if the arrays differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--samples', type=int, default=1_000_000, help='for the comparison')
    parser.add_argument('--large', type=int, default=5_000_000, help='for ours alone; 0: skip')
    options = parser.parse_args()
    equal = True
    with tempfile.TemporaryDirectory() as folder:
        records.write_bag(Path(folder) / 'warm', [sweep(100)])
        records.read_bag(Path(folder) / 'warm')  # compiles the walk
        print('storage   samples   write s   read s   rosbags s   ratio   equal')
        for storage in ('mcap', 'sqlite3'):
            for samples in filter(None, (options.samples, options.large)):
                path = Path(folder) / f'{storage}_{samples}'
                record = sweep(samples)
                written, _ = timed(partial(records.write_bag, path, [record], storage=storage))
                read, (ours,) = timed(partial(records.read_bag, path))
                line = f'{storage:8} {samples:8d} {written:9.2f} {read:8.2f}'
                if samples == options.samples:
                    slow, theirs = timed(partial(plain, path))
                    same = np.array_equal(ours.voltage, theirs[0]) and np.array_equal(
                        ours.displacement, theirs[1]
                    )
                    equal &= same
                    line += f' {slow:11.2f} {slow / read:7.1f}   {same}'
                print(line, flush=True)
    return 0 if equal else 1


if __name__ == '__main__':
    sys.exit(main())
