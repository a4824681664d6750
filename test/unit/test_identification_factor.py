"""What is summed or carried several at a time, and by several threads, is as one by one."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.identification import fit
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.models.simulation.plan import LinearStage
from piezo_hysteresis.numerics.qr import triangle
from piezo_hysteresis.records import Record, RecordInfo


@pytest.mark.parametrize(
    ('columns', 'samples'), [(1, 1), (5, 3), (6, 6), (9, 700), (23, 512), (50, 1300)]
)
def test_a_triangle_is_that_of_all_its_pieces(columns: int, samples: int) -> None:
    rows = np.random.default_rng(columns).standard_normal((columns, samples))
    if columns > 2:
        rows[1] = 0.0
    products = rows @ rows.T
    found = triangle(rows.copy())
    assert np.all(np.tril(found, -1) == 0.0)
    np.testing.assert_allclose(found.T @ found, products, atol=1e-12 * samples)


@pytest.mark.parametrize('names', [('mode', 'creep_pair'), ('transport_delay', 'mode', 'creep')])
@pytest.mark.parametrize('many', [1, 3, 4, 6])
def test_inputs_that_are_carried_together_have_the_bits_of_each(
    names: tuple[str, ...], many: int
) -> None:
    dt, model = 1e-3, Model('row', tuple(BLOCKS[name] for name in names))
    given = {'delay': 2.3e-3, 'natural_frequency': 90.0, 'creep_share': 0.2, 'creep_time': 0.05}
    packed = model.pack({k: v for k, v in given.items() if k in model.parameter_names})
    (stage,) = model.stages
    assert isinstance(stage, LinearStage)
    p = packed[stage.columns]
    signals = np.random.default_rng(many).standard_normal((many, 90))
    alone = [
        stage.respond(row, p, dt, state=stage.initial_state(dt, 0.0), frequency=0.0)
        for row in signals
    ]
    assert np.array_equal(stage.carried(signals, p, dt), np.array(alone))


def test_a_thread_pool_keeps_the_order_and_the_requested_size() -> None:
    seen = set()

    def square(value: Any) -> Any:
        seen.add(threading.current_thread().name)
        return value * value

    assert of_each(square, range(40), 3) == [value * value for value in range(40)]
    assert len(seen) <= 3
    assert of_each(square, [2], 3) == [4]


def test_a_fit_is_the_same_with_any_number_of_threads() -> None:
    model, dt = named('classical'), 1e-3
    true = model.pack({'beta': 0.03})
    records = []
    for frequency in (3.0, 5.0, 8.0):
        voltage = 60.0 * np.sin(2 * np.pi * frequency * dt * np.arange(900))
        noise = 1e-9 * np.random.default_rng(int(frequency)).standard_normal(900)
        measured = model.respond(voltage, true, dt) + noise
        info = RecordInfo(frequency=frequency)
        records.append(Record(f'{frequency:g} Hz', dt, voltage, measured, info=info))
    one, three = (fit(model, records, workers=workers) for workers in (1, 3))
    assert one.values == three.values
    assert one.cost == three.cost
