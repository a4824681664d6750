"""Short simulated records that stand in for measured ones where a study runs with `--quick`."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from piezo_hysteresis.records import write_csv
from piezo_sim.sweep import simulate

PRESET = 'fdk_pzba_00030'
FREQUENCY = 5.0
PERIODS, HIGHEST = 5, 100.0  # of a multisine; Hz


@contextmanager
def records_in(data: Path | None, files: Sequence[str], seconds: float = 2.0) -> Iterator[Path]:
    """Yield the folder of measured records, or one of stand-ins where there is none."""
    # seconds [s]
    if data is not None:
        yield data
        return
    print('simulated records stand in for measured ones')
    with tempfile.TemporaryDirectory() as folder:
        for seed, file in enumerate(files):
            path = Path(folder) / file
            path.parent.mkdir(parents=True, exist_ok=True)
            plan: dict[str, Any] = {'kind': 'sine', 'frequency': FREQUENCY, 'amplitude': 1.0}
            if 'multisine' in file:
                plan |= {'kind': 'multisine', 'frequency': PERIODS / seconds, 'highest': HIGHEST}
            write_csv(path, simulate(PRESET, [plan | {'duration': seconds}], seed=seed)[0])
        yield Path(folder)
