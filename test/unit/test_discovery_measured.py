"""Discovery on records that we did not simulate; skipped where they are not there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.selection.candidate_fit import evaluated_on
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.models import named
from piezo_hysteresis.records import load

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[3] / 'shared' / 'data'
MEASURED = DATA / 'piezo_150v_1hz' / 'piezo_150V_1Hz.csv'
BENCHMARK = DATA / 'boucwen_benchmark' / 'train_multisine.csv'
SWEEP = DATA / 'boucwen_benchmark' / 'test_sinesweep.csv'


@pytest.mark.skipif(not BENCHMARK.exists(), reason=f'{BENCHMARK.name} is not there')
def test_a_linear_mode_lacks_hysteresis_of_the_restoring_force() -> None:
    found = discover(load([BENCHMARK]), named('linear_mode'), name='linear_mode', workers=2)
    verdict = found.verdict
    assert verdict.verdict == 'named', verdict.summary
    (effect,) = verdict.effects
    assert effect.name == 'hysteresis'
    assert effect.variant.startswith('restoring_force')
    assert 'of the restoring force' in verdict.summary
    for name, true in (('z_alpha', 5e4), ('z_beta', 800.0), ('z_gamma', -1100.0)):
        number = effect.parameters[name]
        assert number.std is not None
        assert abs(number.value - true) < 5 * number.std
    assert verdict.held_out.before_in_floors > 20
    assert verdict.held_out.after_in_floors < 1.1
    # a sweep from rest that nothing was fitted to, noise-free, its resonance 0.6 mm
    (record,) = load([SWEEP])
    before, after = (
        evaluated_on(trial, [whole(record)]).rms for trial in (found.baselines.joint, found.final)
    )
    assert after < 0.05 * before


@pytest.mark.skipif(not MEASURED.exists(), reason=f'{MEASURED.name} is not there')
def test_a_measured_stack_has_a_smaller_remaining_gap() -> None:
    (record,) = load([MEASURED])
    # 500 samples a period show what 5000 do, and take a thirteenth of the time
    u, y = (np.ascontiguousarray(x[::10]) for x in (record.voltage, record.displacement))
    record = replace(record, dt=10 * record.dt, voltage=u, displacement=y)
    verdict = discover([record], named('classical'), name='classical', workers=2).verdict
    held = verdict.held_out
    # sensor noise is 0.049 um rms (SOURCES.md)
    assert verdict.noise_floor_rms_m == pytest.approx(0.049e-6, rel=0.1)
    assert held.before_in_floors > 3.0
    assert held.after_in_floors < 0.5 * held.before_in_floors
    assert verdict.free_run_stable
    text = verdict.summary + verdict.unexplained.description
    assert f'{held.before_in_floors:.3g} to {held.after_in_floors:.3g}' in text
    if verdict.unexplained.significant:
        assert 'µm rms' in verdict.unexplained.description
