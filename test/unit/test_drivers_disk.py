"""A sweep in a controller and the disk: room before any voltage, no record lost on a full one."""

from __future__ import annotations

import errno
import shutil
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_drivers_gcs import RATE, served

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.drivers import driver_sweep
from piezo_hysteresis.records import load


def swept(address: str, out: Path) -> int:
    words = ['--frequencies', '20', '--amplitudes', '1', '--seconds', '0.2', '-q']
    return main(['sweep', '--on', address, *words, '--out', str(out)])


def test_a_sweep_needs_room_before_a_voltage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: SimpleNamespace(free=1e5))
    with served('tcp') as (address, controller):
        assert swept(address, tmp_path / 'sweep') == 2
        assert not controller.tables  # no wave was loaded
    assert 'has 0 MB free; the sweep needs' in capsys.readouterr().err


def test_what_was_measured_survives_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written, spare = driver_sweep.write_measured, tmp_path / 'spare'
    spare.mkdir()

    def full(bag: Path, *words: Any) -> None:
        if spare not in bag.parents:
            raise OSError(errno.ENOSPC, 'No space left on device')
        written(bag, *words)

    monkeypatch.setattr('piezo_hysteresis.cli.sweep.write_measured', full)
    monkeypatch.setattr(tempfile, 'tempdir', str(spare))
    with served('tcp') as (address, _):
        assert swept(address, tmp_path / 'sweep') == 2
    kept = Path(capsys.readouterr().err.split('the measured records are in ')[1].splitlines()[0])
    (record,) = load(kept)
    assert len(record) == 0.2 * RATE
