"""The gap of a running actuator, without ROS."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from piezo_hysteresis.discovery.gap_monitor import GapMonitor, GapReport, family_of, fundamental
from piezo_hysteresis.models import ModelFile, Provenance, named
from piezo_hysteresis.models.discrepancy import Condition, Discrepancy
from piezo_sim.plant import Plant

RATE = 1000.0
FLOOR = 2e-8
TRUE = {'A1': 1.4e-4, 'A': 6.3e-5, 'beta': 1.2, 'gamma': 0.3, 'offset': 0.0}


def run(
    effects: Mapping[str, float | bool], seconds: float = 4.0, known: Discrepancy | None = None
) -> list[GapReport]:
    model = named('classical')
    loaded = ModelFile(
        model,
        {**model.defaults(), **TRUE},
        discrepancy=known,
        provenance=Provenance(noise_floor=FLOOR),
    )
    monitor = GapMonitor(loaded, 1.0 / RATE, 0.0, 500)
    plant = Plant.from_preset('generic_bouc_wen', rate=RATE, seed=2, overrides=effects)
    voltage = np.sin(2 * np.pi * 7.0 * np.arange(round(seconds * RATE)) / RATE)
    reports = [monitor.add(u, plant.exchange(u)) for u in voltage.tolist()]
    return [report for report in reports if report is not None]


def test_a_right_model_is_on_the_floor() -> None:
    reports = run({})
    assert len(reports) == 8
    assert all(0.8 < report.floors < 1.2 for report in reports)
    assert not any(report.beyond_floor for report in reports)
    assert reports[-1].frequency == pytest.approx(7.0, abs=0.1)


def test_remanence_of_an_earlier_sweep_is_no_gap() -> None:
    model = named('classical')
    loaded = ModelFile(
        model, {**model.defaults(), **TRUE}, provenance=Provenance(noise_floor=FLOOR)
    )
    plant = Plant.from_preset('generic_bouc_wen', rate=RATE, seed=2, overrides={})
    sweep = np.sin(2 * np.pi * 5.0 * np.arange(600) / RATE)
    left = [plant.exchange(u) for u in (*sweep.tolist(), *(20 * [0.0]))][-1]
    assert left < -5e-6
    monitor = GapMonitor(loaded, 1.0 / RATE, 0.0, 500)
    after = 0.3 * np.sin(2 * np.pi * 7.0 * np.arange(2000) / RATE)
    reports = [monitor.add(u, plant.exchange(u)) for u in after.tolist()]
    floors = [report.floors for report in reports if report is not None]
    assert len(floors) == 4
    assert max(floors) < 1.3


@pytest.mark.parametrize(
    ('effect', 'word'),
    [
        ('effects.transport_delay', 'transport_delay'),
        ('effects.sensor_nonlinearity', 'sensor_nonlinearity'),
        ('effects.saturation', 'saturation'),
    ],
)
def test_a_missing_effect_is_far_off_and_its_family_named(effect: str, word: str) -> None:
    last = run({effect: True})[-1]
    assert last.floors > 10.0
    assert last.beyond_floor
    assert word in last.family


def test_what_the_model_is_known_to_miss_is_no_gap_and_more_than_that_is() -> None:
    delayed = {'effects.transport_delay': True}
    before = run(delayed)[-1]
    assert before.beyond_floor
    stroke = before.rms / before.share
    harmonics = dict(zip(before.orders, before.sizes, strict=True))
    known = Discrepancy(True, (Condition(7.0, 1.0, stroke, before.rms, FLOOR, harmonics),))
    same = run(delayed, known=known)[-1]
    assert same.floors == before.floors
    assert not same.beyond_floor
    assert same.family == ''
    assert 'within its known discrepancy' in same.words
    more = run({**delayed, 'effects.electrostriction': True}, known=known)[-1]
    assert more.beyond_floor
    assert more.family.startswith('electrostriction')
    assert f'{more.rms / before.rms:.2g} times its known discrepancy' in more.words
    assert f'{100 * more.share:.2g} % of the motion' in more.words


def test_one_window_beyond_the_floor_is_no_alarm() -> None:
    model = named('classical')
    loaded = ModelFile(model, {**model.defaults(), **TRUE})
    monitor = GapMonitor(loaded, 1.0 / RATE, FLOOR, 100)
    quiet = [monitor.add(0.0, 1e-8) for _ in range(100)]
    loud = [monitor.add(0.0, 1e-6) for _ in range(100)]
    assert quiet[-1] is not None
    assert loud[-1] is not None
    assert loud[-1].floors > 10.0
    assert not loud[-1].beyond_floor


def test_the_fundamental_of_a_drive() -> None:
    time = np.arange(1000) / RATE
    assert fundamental(np.sin(2 * np.pi * 23.4 * time), 1 / RATE) == pytest.approx(23.4, abs=0.1)
    assert fundamental(np.full(1000, 0.3), 1 / RATE) == 0.0


def test_families_follow_the_harmonics() -> None:
    assert 'drift' in family_of([0, 1, 2], [1e-6, 0.0, 0.0], 1e-6, FLOOR)
    mostly_mean = family_of([0, 1, 3], [4e-6, 3e-7, 6e-7], 4.1e-6, FLOOR)
    assert 'offset' in mostly_mean
    assert 'resonance' not in mostly_mean
    # a square law has a mean beside its second harmonic, of twice the power
    assert 'electrostriction' in family_of([0, 1, 2], [2e-6, 1e-7, 1.4e-6], 2.5e-6, FLOOR)
    assert 'resonance' in family_of([0, 1, 3], [1e-7, 1e-6, 6e-7], 1.2e-6, FLOOR)
    # what is known of the third harmonic tells nothing
    assert 'creep' in family_of([0, 1, 3], [1e-7, 1e-6, 6e-7], 1.2e-6, FLOOR, {3: 6e-7})
    assert 'hum' in family_of([0, 1, 2], [0.0, 0.0, 0.0], 1e-6, FLOOR)
