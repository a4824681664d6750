"""How fast, and in how much memory, a large CSV file is read: by pyarrow and line by line.

    python bench/csv_reading.py [--rows 3000000]

Each way is a process of its own, so that the largest memory is that way's.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.records import Record, csv_columns, read_csv, write_csv

WAYS = ('lines', 'pyarrow')


def read(file: Path, way: str) -> None:
    """Read a file in one way and print what that took."""
    csv_columns.LARGE = 0 if way == 'pyarrow' else sys.maxsize
    started = time.process_time()
    record = read_csv(file)
    spent = time.process_time() - started
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f'{way:8} {len(record)} rows  {spent:5.1f} s of processor time  {largest} MB')


def main() -> int:
    """Write a file and read it in both ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rows', type=int, default=3_000_000)
    parser.add_argument('--read', nargs=2, help=argparse.SUPPRESS)
    arguments = parsed(parser, rows=50_000)
    if arguments.read:
        read(Path(arguments.read[0]), arguments.read[1])
        return 0
    with tempfile.TemporaryDirectory() as folder:
        phase = np.linspace(0.0, 40.0 * arguments.rows * 1e-4, arguments.rows)
        file = Path(folder) / 'large.csv'
        write_csv(file, Record('large', 1e-4, np.sin(phase), 1.3e-4 * np.sin(phase - 0.1)))
        for way in WAYS:
            words = [sys.executable, __file__, '--read', str(file), way]
            subprocess.run(words, check=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
