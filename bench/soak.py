"""Memory and file handles of every node of the loop over a long run: flat, or not.

    python bench/soak.py [--minutes 30] [--every 1] [--rate 100] [--out out/soak.json]

Samples resident memory and open file handles of every process at even intervals, fits a line to
the samples after the first quarter (caches fill, allocators settle) and reports a node as flat
if growth at the upper end of the slope's 95 % interval stays below 5 % of its memory in a day,
or below 1 MiB an hour, whichever is more, and if no file handle is gained. The interval takes
into account that neighbouring values are alike. All samples are stored with the verdicts, as .npz.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.live_loop import NODES, Loop, Setting, end_on_terminate, wait_until
from bench.live_observer import Observer
from bench.quick import parsed
from piezo_hysteresis.ros.processes import NodeProcesses

MIB = 1 << 20
SHARE_PER_DAY = 0.05
FLOOR_PER_HOUR = 1.0 * MIB
_SIZES = ('VmRSS', 'RssAnon', 'RssShmem')


@dataclass(frozen=True)
class Verdict:
    """What the memory and the handles of one node did."""

    rss: float  # mean resident memory after the first quarter [byte]
    slope: float  # [byte/h]
    low: float  # [byte/h]
    high: float  # [byte/h]
    private: float
    shared: float
    handles_first: int
    handles_last: int
    flat: bool  # whether both stay where they are


class Sample(NamedTuple):
    """What a process holds: resident memory, its private and shared part [byte], file handles."""

    rss: int
    private: int
    shared: int
    handles: int


def sample_of(pid: int) -> Sample:
    """Look at a process."""
    lines = Path(f'/proc/{pid}/status').read_text().splitlines()
    sizes = {k: v for k, v in (line.split(':', 1) for line in lines) if k in _SIZES}
    rss, private, shared = (1024 * int(sizes[name].split()[0]) for name in _SIZES)
    return Sample(rss, private, shared, sum(1 for _ in Path(f'/proc/{pid}/fd').iterdir()))


def slope_of(time: np.ndarray, values: np.ndarray, blocks: int = 12) -> tuple[float, float, float]:
    """Return the slope of `values` over `time` and its 95 % interval.

    Means over blocks stand for the values: within a block they are alike, and counting them as
    independent would make the interval far too narrow.
    """
    from scipy.stats import linregress, t

    parts = [part for part in np.array_split(np.arange(len(time)), blocks) if len(part)]
    x = np.array([time[part].mean() for part in parts])
    y = np.array([values[part].mean() for part in parts])
    fit = linregress(x, y)
    if np.ptp(y) == 0.0:  # no page more or less: there is nothing to be unsure of
        return 0.0, 0.0, 0.0
    half = float(t.ppf(0.975, len(parts) - 2) * fit.stderr)
    return float(fit.slope), float(fit.slope) - half, float(fit.slope) + half


def judge(seconds: np.ndarray, samples: np.ndarray) -> Verdict:  # seconds [s] (n,); samples (n, 4)
    """Say what one node did."""
    late = seconds >= seconds[0] + 0.25 * (seconds[-1] - seconds[0])
    rss, private, shared, after = samples[late].T
    slope, low, high = (3600.0 * each for each in slope_of(seconds[late], rss))
    heap, common = (3600.0 * slope_of(seconds[late], each)[0] for each in (private, shared))
    mean = float(rss.mean())
    third = max(1, len(after) // 3)
    first, last = int(np.median(after[:third])), int(np.median(after[-third:]))
    bound = max(FLOOR_PER_HOUR, SHARE_PER_DAY * mean / 24.0)
    flat = high <= bound and last <= first
    return Verdict(mean, slope, low, high, heap, common, first, last, flat)


def soak(
    seconds: float, setting: Setting, folder: Path, every: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:  # -> seconds [s] (n,), samples (n, nodes, 4)
    """Run the loop for so long."""
    with NodeProcesses() as processes, closing(Observer(processes)) as observer:
        loop = Loop(processes, folder, setting)
        for name in NODES:
            loop.start(name)
        counts = observer.seen.counts
        if not wait_until(lambda: all(counts[name] for name in NODES), 120.0):
            silent = [name for name in NODES if not counts[name]]
            raise SystemExit(f'the loop does not run: nothing is heard of {", ".join(silent)}')
        started = time.monotonic()
        times: list[float] = []
        rows: list[list[Sample]] = []
        while times[-1] < seconds if times else True:
            processes.check()
            times.append(time.monotonic() - started)
            rows.append([sample_of(loop.running[name].pid) for name in NODES])
            observer.seen.discard()
            time.sleep(every)
        ticks = observer.seen.states[-1].sample
        loop.stop()
    print(f'{ticks} ticks in {times[-1]:.0f} s')
    return np.array(times), np.array(rows, dtype=float)


def show(verdicts: dict[str, Verdict]) -> None:
    """Print the table."""
    print(
        f'{"node":16}{"RSS MiB":>9}{"MiB/h":>9}{"95 % interval":>20}{"private":>9}{"shared":>9}'
        f'{"handles":>10}'
    )
    for name, v in verdicts.items():
        span = f'{v.low / MIB:.2f} .. {v.high / MIB:.2f}'
        print(
            f'{name:16}{v.rss / MIB:9.1f}{v.slope / MIB:9.2f}{span:>20}'
            f'{v.private / MIB:9.2f}{v.shared / MIB:9.2f}'
            f'{v.handles_first:>5} {v.handles_last:>4}  {"flat" if v.flat else "GROWS"}'
        )


def main() -> int:
    """Run the soak and print its table; the exit code states whether all is flat."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=30.0)
    parser.add_argument('--every', type=float, default=1.0, help='between two samples [s]')
    parser.add_argument('--rate', type=float, default=100.0, help='sampling rate of the loop [Hz]')
    parser.add_argument('--out', type=Path, default=Path('out/soak.json'))
    words = parsed(parser, minutes=0.1, every=0.2)
    end_on_terminate()
    load = os.getloadavg()
    with tempfile.TemporaryDirectory() as folder:
        setting = Setting(rate=words.rate)
        seconds, samples = soak(60.0 * words.minutes, setting, Path(folder), words.every)
    verdicts = {name: judge(seconds, samples[:, k]) for k, name in enumerate(NODES)}
    print(f'load of the machine {load[0]:.1f} before, {os.getloadavg()[0]:.1f} after')
    show(verdicts)
    words.out.parent.mkdir(parents=True, exist_ok=True)
    words.out.write_text(json.dumps({k: asdict(v) for k, v in verdicts.items()}, indent=2) + '\n')
    np.savez(words.out.with_suffix('.npz'), nodes=NODES, seconds=seconds, samples=samples)
    return 0 if words.quick or all(v.flat for v in verdicts.values()) else 1


if __name__ == '__main__':
    sys.exit(main())
