"""Bags as whole topics against plain rosbags, message by message.

Both read the same file in this run and must give equal arrays; the ratio of processor times is
what counts. Then both write the same serialised messages as MCAP, and both are asked what a writer
that is killed leaves.

    python bench/records.py [--samples 1000000] [--large 5000000]
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis import records
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import cdr
from piezo_hysteresis.records.bag_writer import fixed_fields
from piezo_hysteresis.records.definitions import STATE, definition_of, typestore
from piezo_hysteresis.records.recorder import Recorder


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


def plain_writer(folder: Path, payloads: list[bytes]) -> Any:
    """Write states to an MCAP bag by rosbags; return the writer, still open."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.open()
    state = writer.add_connection('/actuator/state', STATE, typestore=typestore())
    for k, payload in enumerate(payloads):
        writer.write(state, 100_000 * k, payload)
    return writer


def readable(path: Path) -> int:
    """Return how many states plain rosbags reads of a bag folder, 0 where it refuses."""
    from rosbags.rosbag2 import Reader

    count = 0
    try:
        with Reader(path) as reader:
            for connection, _, _ in reader.messages():
                count += connection.msgtype == STATE
    except Exception:  # whatever it raises, nothing more is read
        return count
    return count


def states(samples: int) -> list[bytes]:
    """Return that many serialised states."""
    record, ticks = sweep(samples), np.arange(samples)
    columns = {'sample': ticks, 'voltage': record.voltage, 'displacement': record.displacement}
    rows = cdr.encode(fixed_fields(STATE), ticks * 100_000, columns)
    return [row.tobytes() for row in rows]


def writing(folder: Path, samples: int) -> None:
    """Compare the cost of writing MCAP, and the readable part after a writer was killed."""
    payloads = states(samples)
    slow, writer = timed(partial(plain_writer, folder / 'theirs', payloads))
    shutil.copytree(folder / 'theirs', folder / 'theirs_killed')
    ending, _ = timed(writer.close)
    record = sweep(samples)
    quick, _ = timed(partial(records.write_bag, folder / 'ours', [record]))
    recorder = Recorder(folder / 'growing')
    topic = recorder.add_topic('/actuator/state', STATE, definition=definition_of(STATE)[0])
    for k, payload in enumerate(payloads):
        recorder.write(topic, payload, 100_000 * k)
    recorder.flush()
    while recorder.status.written < samples:
        time.sleep(0.01)
    shutil.copytree(folder / 'growing', folder / 'ours_killed')
    recorder.close()
    print(f'MCAP, {samples} states: ours {quick:.2f} s, rosbags {slow + ending:.2f} s, '
          f'ratio {(slow + ending) / quick:.1f}')  # fmt: skip
    print(f'killed before it closed, read by rosbags: of ours {readable(folder / "ours_killed")}, '
          f'of its own {readable(folder / "theirs_killed")}')  # fmt: skip


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
    options = parsed(parser, samples=20_000, large=0)
    equal = True
    with tempfile.TemporaryDirectory() as folder:
        records.write_bag(Path(folder) / 'warm', [sweep(100)])
        records.read_bag(Path(folder) / 'warm')  # compiles the walk
        print(' samples   write s   read s   rosbags s   ratio   equal')
        for samples in filter(None, (options.samples, options.large)):
            path = Path(folder) / str(samples)
            written, _ = timed(partial(records.write_bag, path, [sweep(samples)]))
            read, (ours,) = timed(partial(records.read_bag, path))
            line = f'{samples:8d} {written:9.2f} {read:8.2f}'
            if samples == options.samples:
                slow, theirs = timed(partial(plain, path))
                same = np.array_equal(ours.voltage, theirs[0]) and np.array_equal(
                    ours.displacement, theirs[1]
                )
                equal &= same
                line += f' {slow:11.2f} {slow / read:7.1f}   {same}'
            print(line, flush=True)
        writing(Path(folder), options.samples)
    return 0 if equal else 1


if __name__ == '__main__':
    sys.exit(main())
