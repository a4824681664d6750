"""The Python interface on several axes: arrays (sample, axis) in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_sim import AxesPlant
from piezo_sim.axes_records import simulate_axes

LEVELS, SECONDS, BAND = (2.0, 5.0), 0.2, (5.0, 1000.0)


@pytest.fixture(scope='module')
def records() -> list[ph.AxesRecord]:
    """Return records of the simulated scanner at 4 kHz, from arrays."""
    plant = AxesPlant.from_preset('xy_scanner', 4000.0)
    found = []
    for level in LEVELS:
        u, y = simulate_axes(plant, level, 5, SECONDS, BAND)
        pairs = [(u[:, :, k, 0], y[:, :, k, 0]) for k in range(5)]
        found += ph.load_axes(pairs, fs=4000.0, periodic=True)
    return found


@pytest.fixture(scope='module')
def found(records: list[ph.AxesRecord]) -> Any:
    return ph.identify(records, 'modes', effects=['voltage_hysteresis'], modes=3)


def raster() -> FloatArray:
    t = np.arange(2000) / 4000.0
    fast, slow = np.sin(2.0 * np.pi * 20.0 * t), np.sin(2.0 * np.pi * 2.0 * t)
    return 1e-6 * np.column_stack([fast, slow])


@pytest.mark.component
def test_a_modal_model_is_identified_simulated_and_saved(
    found: Any, records: list[ph.AxesRecord], tmp_path: Path
) -> None:
    assert 'voltage_hysteresis' in repr(found)
    y = found.simulate(records[-1])
    left = records[-1].displacement - records[-1].displacement.mean(0) - y
    assert np.std(left) < 0.1 * np.std(records[-1].displacement)
    rest = found.simulate(np.zeros((100, 2)))
    assert rest.shape == (100, 2)
    assert not rest.any()
    path = tmp_path / 'model.yaml'
    found.save(path)
    again = ph.AxesModel.load(path).simulate(records[-1])
    assert np.allclose(again, y, atol=1e-12)
    with pytest.raises(ph.PiezoError, match=r'shape \(samples, 2\)'):
        found.simulate(np.zeros(100))


@pytest.mark.component
def test_discover_names_the_cross_talk_of_the_scanner(records: list[ph.AxesRecord]) -> None:
    verdict = ph.discover(records, 'gain')
    assert verdict.effects == ('cross_talk', 'cross_talk_through_mode')
    static, modes = (
        {(p.voltage, p.displacement): p for p in verdict.cross_talk if (p.frequency > 0.0) == mode}
        for mode in (False, True)
    )
    assert static[1, 2].size == pytest.approx(0.02, rel=0.05)
    assert static[2, 1].size == pytest.approx(-0.02, rel=0.05)
    assert modes[1, 2].size == pytest.approx(0.003, rel=0.2)
    assert modes[2, 1].size == pytest.approx(-0.003, rel=0.2)
    assert modes[1, 2].frequency == pytest.approx(930.0, rel=0.03)


@pytest.mark.component
@pytest.mark.parametrize('plant', [None, 'preset:xy_scanner'])
def test_compensate_takes_and_returns_arrays(found: Any, plant: str | None) -> None:
    study = ph.compensate(found, raster(), plant)
    assert study.voltage.shape == (2000, 2)
    alone, forward, learnt = study.runs
    assert np.all(forward.rms < alone.rms)
    assert study.best is learnt or plant is None
    assert np.nanmax(learnt.cross_talk) < 0.1 * np.nanmax(alone.cross_talk)


@pytest.mark.parametrize(
    ('call', 'sentence'),
    [
        (lambda r: ph.identify(r, 'classical'), "the model 'modes'"),
        (lambda r: ph.identify(r, 'modes', hold={'gain': 1.0}), 'hold is of one axis'),
        (lambda r: ph.identify(r, 'modes', count=3), 'count is of one axis'),
        (lambda r: ph.discover(r, 'bouc_wen_mode'), 'gain or modes'),
        (lambda r: ph.discover(r, 'gain', policy={'min_z': 3.0}), 'policy is of one axis'),
    ],
)
def test_what_several_axes_do_not_have_is_refused(call: Any, sentence: str) -> None:
    u = np.random.default_rng(0).standard_normal((3, 200, 2))
    records = ph.load_axes([(each, 1e-6 * each) for each in u], fs=1000.0, periodic=True)
    with pytest.raises(ph.PiezoError, match=sentence):
        call(records)
