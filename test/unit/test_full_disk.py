"""Verbs that write, where files cannot grow: one sentence, and what is kept is whole."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, load, write_bag

pytestmark = pytest.mark.component

MOST = 4096  # size that a file may reach [byte]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Return a folder with a bag, a CSV file and a model."""
    time = 1e-3 * np.arange(4000)
    record = Record('r', 1e-3, np.sin(9 * time), 1e-4 * np.sin(9 * time))
    write_bag(tmp_path / 'bag', [record])
    columns = np.column_stack([time, record.voltage, 1e6 * record.displacement])
    (tmp_path / 'csv').mkdir()
    np.savetxt(
        tmp_path / 'csv' / 'r.csv', columns, delimiter=',', comments='',
        header='time_s,voltage_V,displacement_um',
    )  # fmt: skip
    model = named('bouc_wen_mode')
    ModelFile(model, model.defaults()).save(tmp_path / 'model.yaml')
    return tmp_path


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST, MOST))


@pytest.mark.parametrize(
    'words',
    [
        'import csv/r.csv --out out',
        'import csv/r.csv --out out.npz',
        'export bag --out out',
        'export model.yaml --out out',
        'identify bag --model linear_mode --out out',
        'batch identify csv --model linear_mode --out out',
    ],
)
def test_a_file_that_cannot_grow_is_one_sentence(data: Path, words: str) -> None:
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_hysteresis', *words.split()],
        cwd=data, preexec_fn=limited,
        # Python 3.11 leaves a cut .pyc of a module that such a process imports first.
        env={**os.environ, 'MPLCONFIGDIR': str(data), 'PYTHONDONTWRITEBYTECODE': '1'},
        capture_output=True, text=True, timeout=120.0, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count('error: ') == 1
    assert 'cannot be written (File too large)' in done.stderr
    assert 'Traceback' not in done.stderr
    for kept in (*data.glob('out*/*.mcap'), *data.glob('out*/*.csv'), *data.glob('out*.npz')):
        assert len(load(kept)[0]) == 4000
