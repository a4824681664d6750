"""The noise floor of records, in which more than noise changes from period to period."""

import numpy as np
import pytest

from piezo_hysteresis.discovery.dataset import split
from piezo_hysteresis.discovery.floor import Noise, consensus, noise_floor, record_noise
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.records import Record, RecordInfo

RATE, NOISE = 1000.0, 2e-8


def record(frequency, seconds=4.0, seed=0, add=0.0, noise=NOISE):
    t = np.arange(round(seconds * RATE)) / RATE
    u = np.sin(2 * np.pi * frequency * t)
    y = 1e-4 * (u - 0.2 * u**3) + add + noise * np.random.default_rng(seed).normal(size=t.size)
    info = RecordInfo(
        excitation='sine' if frequency else 'rest', frequency=float(frequency), amplitude=1.0
    )
    return Record(f'{frequency}Hz_{seed}', 1.0 / RATE, u, y, info=info)


def sweep(add=0.0):
    return [record(f, seed=k, add=add) for k, f in enumerate((1, 2, 4, 5, 8, 10, 20, 0))]


def test_it_is_as_sure_as_it_says():
    found = noise_floor(split(sweep()))
    assert 0.0 < found.doubt < 0.06
    assert (found.rms / NOISE) ** 2 == pytest.approx(1.0, abs=3.0 * found.doubt)


def test_tones_and_drift_are_no_noise():
    t = np.arange(4000) / RATE
    disturbed = sweep(2e-6 * np.sin(2 * np.pi * 17.37 * t) + 1e-5 * t)
    found = noise_floor(split(disturbed))
    assert found.rms == pytest.approx(NOISE, rel=0.06)


def test_a_disturbed_record_does_not_count():
    records = sweep()
    records[2] = record(4, seed=2, noise=5.0 * NOISE)
    assert record_noise(records[2], 250).rms > 4.0 * NOISE
    assert noise_floor(split(records)).rms == pytest.approx(NOISE, rel=0.06)


def test_many_lines_outweigh_few():
    found = consensus([Noise(1.0, 4000), Noise(1.04, 100), Noise(1.5, 90), Noise(9.0, 50)])
    assert found.rms == pytest.approx(1.0, abs=0.01)
    assert found.lines == 4100


def test_records_that_show_no_noise_are_refused():
    short = [record(100, seconds=0.03)]
    with pytest.raises(IdentificationError, match='no record shows the noise'):
        noise_floor(split(short))
