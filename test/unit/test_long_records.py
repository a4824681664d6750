"""A long record is fitted in blocks: the same numbers, and a memory that knows no parameters."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET, Objective
from piezo_hysteresis.identification.sensitivities import (
    SensitivityRun,
    StateOffset,
    sensitivities,
)
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.models.simulation.plan import free_states
from piezo_hysteresis.numerics.qr import triangle
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.signals import amplitude_spectrum

DT = 1e-3
CHAINS = (
    ('prandtl_ishlinskii', 'offset'),
    ('prandtl_ishlinskii', 'mode', 'creep_pair'),
    ('transport_delay', 'prandtl_ishlinskii', 'creep'),
    ('bouc_wen', 'mode', 'sensor_lag'),
    ('amplifier_lag', 'bouc_wen', 'mode'),
    ('slew_limit', 'bouc_wen', 'mode'),
    ('transport_delay', 'bouc_wen_exact', 'nonlinear_mode', 'sensor_lag'),
    ('prandtl_ishlinskii', 'mode', 'stiffness', 'resonance'),
)


def drive(count: int) -> np.ndarray:
    time = np.arange(count) * DT
    return np.asarray(np.sin(2 * np.pi * 7.0 * time) + 0.3 * np.sin(2 * np.pi * 31.0 * time))


@pytest.mark.component
@pytest.mark.parametrize('names', CHAINS, ids=' '.join)
def test_blocks_continue_each_other_with_the_bits_of_one(names: tuple[str, ...]) -> None:
    model = Model('chain', tuple(named_block(name) for name in names))
    p = model.pack({**model.defaults(), **({'delay': 2.3e-3} if 'delay' in names else {})})
    u, origin = drive(600), 250
    offsets = [
        StateOffset(k, place, 0.01)
        for k, stage in enumerate(model.stages)
        for place in free_states(stage, DT)
    ]
    y, rows = sensitivities(model, p, model.free_names, u, DT, origin=origin, offsets=offsets)
    run = SensitivityRun(model, p, model.free_names, DT, origin=origin, offsets=offsets)
    parts = [run.advance(u[first : first + 125]) for first in range(0, u.size, 125)]
    size = np.abs(rows).max(axis=1, keepdims=True) + 1e-300
    np.testing.assert_allclose(np.concatenate([part[0] for part in parts]), y, rtol=1e-12)
    found = np.concatenate([part[1] for part in parts], axis=1)
    np.testing.assert_allclose(found / size, rows / size, atol=1e-12)


def objective(count: int, start: str = 'step') -> tuple[Objective, np.ndarray]:
    """Return the cost of a chain on a record without periods, at a point near its values."""
    model = named('prandtl_ishlinskii')
    u = drive(count) * np.linspace(0.3, 1.0, count)
    y = model.respond(u, model.pack({}), DT) + 1e-9 * np.random.default_rng(0).normal(size=count)
    record = Record('long', DT, u, y)
    free = (*model.free_names, SAMPLING_OFFSET)
    values = {**model.defaults(), SAMPLING_OFFSET: 3e-4}
    made = Objective(model, [whole(record)], free, values)
    return made, np.array([values[name] for name in free])


def test_normal_equations_in_blocks_are_those_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, x = objective(3000)
    target = made.targets[0]
    y, rows = made.jacobian(target, x)
    dense = np.vstack([rows, y - target.measured])
    monkeypatch.setattr('piezo_hysteresis.identification.free_run.BLOCK', 700)
    factor, right, cost = made.linearise(x)
    scale = np.linalg.norm(rows, axis=1)
    gram = factor.T @ factor / np.outer(scale, scale)
    np.testing.assert_allclose(gram, rows @ rows.T / np.outer(scale, scale), atol=1e-12)
    gradient = rows @ dense[-1] / scale
    np.testing.assert_allclose(factor.T @ right / scale, gradient, rtol=1e-9)
    assert cost == pytest.approx(0.5 * float(dense[-1] @ dense[-1]), rel=1e-12)
    np.testing.assert_allclose(made.jacobian(target, x)[1] / scale[:, None], rows / scale[:, None],
                               atol=1e-13)  # fmt: skip


def peak(count: int) -> int:
    made, x = objective(count)
    tracemalloc.start()
    made.linearise(x)
    top = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return top


@pytest.mark.component
def test_memory_of_a_linearisation_is_a_few_arrays_for_any_number_of_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('piezo_hysteresis.identification.free_run.BLOCK', 2048)
    peak(1000)
    # a derivative by each of 12 unknowns would be 100 bytes, and there were three copies
    assert (peak(90_000) - peak(30_000)) / 60_000 < 8 * 4


def test_the_remainder_of_a_dependent_column_leaves_no_infinite_factor() -> None:
    """From piece to piece it shrinks, at last to numbers whose squares have no reciprocal."""
    rows = np.array([np.full(600, 1e-160), np.ones(600), np.arange(600.0)])
    factor = triangle(rows.copy())
    np.testing.assert_allclose(factor.T @ factor, rows @ rows.T, rtol=1e-12, atol=1e-100)


def test_a_target_keeps_no_second_copy_of_its_voltage() -> None:
    target = whole(Record(name='sine', voltage=drive(100_000), displacement=drive(100_000), dt=DT))
    tracemalloc.start()
    try:
        assert target.drive.size == target.voltage.size + 2
        kept = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert kept < 0.1 * target.voltage.nbytes


def test_a_spectrum_needs_less_than_four_copies_of_a_signal() -> None:
    signal = drive(200_000)
    amplitude_spectrum(signal[:1000], DT)
    tracemalloc.start()
    try:
        amplitude_spectrum(signal, DT)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * signal.nbytes
