"""Responses of a run to its initial state and to the levels before it, against plain runs."""

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.fit_data import FitData, led_in, targets_of
from piezo_hysteresis.identification.initial_conditions.initial_state import (
    InitialStateRun,
    start_rows,
)
from piezo_hysteresis.identification.initial_conditions.record_start import RecordStart, path_to
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record

DT = 1e-3
STEP = 0.05  # change of a level [V]


def recorded(seconds: float = 4.0) -> Record:
    """Return a sine that shrinks, so that the largest plays keep what was before it."""
    t = np.arange(0.0, seconds, DT)
    u = (0.6 + 0.4 * np.exp(-t)) * np.sin(2 * np.pi * 2.0 * t + 0.4)
    return Record('shrinking', DT, u, 1e-5 * u)


def prepared(name: str, level: float) -> tuple[Model, FloatArray, FitData]:
    """Return a model with its default values, and a record that begins after a level."""
    model, record = named(name), recorded()
    (target,) = targets_of([record], folded=False, start='estimate')
    values = {each.name: each.default for each in model.parameters}
    return model, model.pack(values), led_in(target, record, RecordStart('estimate', (level,)))


def drive_after(target: FitData, level: float) -> FloatArray:
    """Return the drive of a target after another level."""
    start = replace(target.begins, levels=(level,))
    before = path_to(target.voltage[target.origin : target.origin + 2], start, target.dt)
    return np.concatenate([before, target.drive[target.origin :]])


@pytest.mark.parametrize(
    'name',
    [
        'prandtl_ishlinskii',
        'prandtl_ishlinskii+mode',
        'prandtl_ishlinskii+creep',
        'prandtl_ishlinskii+mode+creep',
        'bouc_wen_mode',
    ],
)
@pytest.mark.parametrize('level', [0.3, 1.4])
def test_another_level_gives_the_plain_run(name: str, level: float) -> None:
    model, packed, target = prepared(name, level)
    drive = drive_after(target, level + STEP)
    state = model.initial_state(target.dt, target.start)
    plain = model.respond(drive, packed, target.dt, state=state, frequency=target.frequency)
    run = InitialStateRun(model, packed, target)
    assert np.max(np.abs(plain - run.response)) > 0.0
    np.testing.assert_allclose(run.driven(drive), plain, rtol=0.0, atol=1e-12 * np.ptp(plain))


@pytest.mark.parametrize('name', ['prandtl_ishlinskii+mode', 'prandtl_ishlinskii+mode+creep'])
def test_rows_of_the_states_are_those_of_offset_runs(name: str) -> None:
    model, packed, target = prepared(name, 0.3)
    run = InitialStateRun(model, packed, target)
    rows, moved = start_rows(run)
    assert rows
    for row, each in zip(rows, moved, strict=True):
        run.go((each,))
        shifted = run.response.copy()
        run.go(())
        np.testing.assert_allclose(
            shifted - run.response, row, rtol=0.0, atol=1e-12 * np.ptp(run.response)
        )


def test_rows_are_those_of_the_own_parameters() -> None:
    """Responses are kept per stage: other parameters, or another length, never get them."""
    model, packed, target = prepared('prandtl_ishlinskii+mode', 0.3)
    place = model.parameter_names.index('natural_frequency')
    other = packed.copy()
    other[place] *= 1.3
    shorter = replace(
        target, voltage=target.voltage[:-500].copy(), measured=target.measured[:-500].copy()
    )
    first = start_rows(InitialStateRun(model, packed, target))[0]
    for values, part in ((other, target), (packed, shorter)):
        fresh = named('prandtl_ishlinskii+mode')
        seen = start_rows(InitialStateRun(model, values, part))[0]
        known = start_rows(InitialStateRun(fresh, values, part))[0]
        assert [each.tolist() for each in seen] == [each.tolist() for each in known]
    again = start_rows(InitialStateRun(model, packed, target))[0]
    assert [each.tolist() for each in first] == [each.tolist() for each in again]
