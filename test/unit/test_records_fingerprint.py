"""A record is recognised in another file and under another name; a repeat is not one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, RecordInfo, load, write_csv
from piezo_hysteresis.records.fingerprint import Fingerprint, fingerprints, recognised

DT = 1e-3


def measured(seed: int, noise: float = 2e-8, frequency: float = 22.0) -> Record:
    u = np.sin(2 * np.pi * frequency * DT * np.arange(3000))
    rng = np.random.default_rng(seed)
    return Record(
        'sine', DT, u, 5e-6 + 1e-4 * u + noise * rng.standard_normal(u.size), info=RecordInfo()
    )


@pytest.mark.parametrize('micro_digits', [9, 4, 3])
def test_a_rounded_copy_is_the_same_record(micro_digits: int) -> None:
    record = measured(1)
    rounded = 1e-6 * np.round(1e6 * record.displacement, micro_digits)
    copy = replace(record, name='other', displacement=rounded, voltage=np.round(record.voltage, 6))
    assert recognised([copy], fingerprints([record])) == ['other']


def test_a_csv_file_of_a_record_is_the_same_record(tmp_path: Path) -> None:
    record = measured(1)
    write_csv(tmp_path / 'elsewhere.csv', record)
    assert recognised(load([str(tmp_path / 'elsewhere.csv')]), fingerprints([record]))


@pytest.mark.parametrize('noise', [1e-6, 2e-8, 1e-9])
def test_a_repeat_is_another_record(noise: float) -> None:
    known = fingerprints([measured(0, noise)])
    assert recognised([measured(k, noise) for k in range(1, 200)], known) == []


@pytest.mark.parametrize(
    'change',
    [
        lambda r: replace(r, displacement=1.001 * r.displacement),
        lambda r: replace(r, displacement=r.displacement + 1e-7 * r.time),
        lambda r: replace(r, displacement=r.displacement + 1e-7 * np.sin(300.0 * r.time)),
        lambda r: replace(r, voltage=1.01 * r.voltage),
        lambda r: replace(r, dt=2 * r.dt),
        lambda r: r.section(0, 2900),
    ],
)
def test_a_changed_record_is_another_one(change: Callable[..., Any]) -> None:
    record = measured(1)
    assert recognised([change(record)], fingerprints([record])) == []


def test_a_row_is_read_as_it_was_written_or_refused() -> None:
    row = Fingerprint.of(measured(1)).to_dict()
    assert Fingerprint.parse(row) == Fingerprint.of(measured(1))
    for wrong in ({'sums': 'xyz'}, {'sums': '00'}, {'samples': 'many'}):
        with pytest.raises(RecordError, match='identify again'):
            Fingerprint.parse({**row, **wrong})
