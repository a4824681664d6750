"""Tasks of the benchmark: drawn again by their seed, and nothing of the truth leaks."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'studies' / 'benchmark'))
draw: Any = importlib.import_module('piezo_benchmark.draw')
tasks: Any = importlib.import_module('piezo_benchmark.tasks')
worlds: Any = importlib.import_module('piezo_benchmark.worlds')
effects: Any = importlib.import_module('piezo_benchmark.effects')
measured: Any = importlib.import_module('piezo_benchmark.measured')

KINDS = ('single', 'nothing', 'outside')


@pytest.fixture(scope='module')
def clean() -> dict[str, Any]:
    """One actuator with what each kind makes of it."""
    return {kind: draw.one([5, 0, 3], 'clean', kind, 8) for kind in KINDS}


def test_a_seed_draws_the_same_again(clean: dict[str, Any]) -> None:
    task, truth = clean['single']
    again, same = draw.one([5, 0, 3], 'clean', 'single', 8)
    assert np.array_equal(task.measured, again.measured)
    assert truth.parameters == same.parameters
    other, _ = draw.one([6, 0, 3], 'clean', 'nothing', 8)
    assert not np.array_equal(task.records.voltage, other.records.voltage)


def test_what_is_visible_does_not_depend_on_what_hides(clean: dict[str, Any]) -> None:
    first = clean['single'][0]
    for task, _ in clean.values():
        assert task.scale == first.scale
        assert task.baseline.name == first.baseline.name
        assert (task.warm_up, task.level) == (first.warm_up, first.level)
        assert np.array_equal(task.records.voltage, first.records.voltage)
        assert np.array_equal(task.held_out.voltage, first.held_out.voltage)


def test_names_and_sizes_of_files_do_not_depend_on_what_hides(
    clean: dict[str, Any], tmp_path: Path
) -> None:
    seen = set()
    for kind, (task, _) in clean.items():
        tasks.save(task, tmp_path / kind, csv=True)
        files = sorted(p for p in (tmp_path / kind).rglob('*') if p.is_file())
        seen.add(tuple((p.name, p.stat().st_size) for p in files))
    assert len(seen) == 1


def test_a_task_holds_neither_seed_nor_truth(clean: dict[str, Any], tmp_path: Path) -> None:
    task, truth = clean['single']
    tasks.save(task, tmp_path)
    said = json.loads((tmp_path / f'{task.identifier}.json').read_text(encoding='utf-8'))
    assert set(said.pop('effects')) == set(effects.EFFECTS)
    text = json.dumps(said)
    assert not {'seed', 'truth', 'kind', 'single', *truth.names} & set(text.split('"'))
    with np.load(tmp_path / f'{task.identifier}.npz') as file:
        assert not [name for name in file.files if not name.startswith(('records', 'held_out'))]
        assert 'held_out_displacement_m' not in file.files
    assert task.held_out.displacement is None


@pytest.mark.parametrize('seed', [draw.PRACTICE_SEED, 1, 2])
def test_the_order_predicts_nothing(seed: int) -> None:
    cells = draw.plan()
    order = np.random.default_rng([seed, 7]).permutation(len(cells))
    kinds = [cells[k][1] for k in order]
    numbers = np.arange(len(kinds))
    for kind in set(kinds):
        here = numbers[[k == kind for k in kinds]]
        error = np.std(numbers) / np.sqrt(here.size)
        assert abs(np.mean(here) - np.mean(numbers)) < 3.5 * error
        assert abs(np.mean(here % 2) - 0.5) < 3.5 * 0.5 / np.sqrt(here.size)


def test_a_task_comes_back_from_its_files(clean: dict[str, Any], tmp_path: Path) -> None:
    task, truth = clean['outside']
    tasks.save(task, tmp_path)
    tasks.save_truths([truth], tmp_path / 'truth', 5)
    again = tasks.load(tmp_path, task.identifier)
    assert np.array_equal(task.measured, again.measured)
    run = again.baseline.run(again.records.voltage, again.scale)
    assert np.max(np.abs(run - task.records.free_run)) < 1e-6 * task.scale.metres
    (same,) = tasks.load_truths(tmp_path / 'truth')
    assert (same.outcome, same.names) == ('unknown', truth.names)


def test_kinds_have_the_right_outcome(clean: dict[str, Any]) -> None:
    assert clean['nothing'][1].outcome == 'none'
    assert clean['outside'][1].outcome == 'unknown'
    assert clean['single'][1].outcome in effects.EFFECTS
    assert clean['single'][1].group == 'clean'
    assert not np.any(clean['nothing'][1].discrepancy)


def test_a_hidden_effect_is_well_above_the_noise(clean: dict[str, Any]) -> None:
    task, truth = clean['single']
    left = task.measured - task.records.free_run
    left = (left - left.mean(0))[task.warm_up :]
    assert np.sqrt(np.mean(left**2)) > 2.0 * truth.noise


def test_measured_records_are_omitted_without_their_data(tmp_path: Path) -> None:
    assert not measured.available(None)
    assert not measured.available(tmp_path)
    found = draw.drawn(1, 16, tmp_path, ['measured'])
    assert found == ([], [])


def test_a_resolution_of_measured_records_does_not_show_that_nothing_hides(tmp_path: Path) -> None:
    """Steps of the sensor are in untouched records and would be lost in changed ones."""
    time = 5e-3 * np.arange(50000)
    volts = 5.0 * np.sin(2 * np.pi * time)
    steps = 7.6e-3 * np.round((volts + 0.5 * np.sin(2 * np.pi * time - 0.5)) / 7.6e-3)
    for names in measured.FILES.values():
        for name in names:
            (tmp_path / name).parent.mkdir(exist_ok=True)
            table = np.column_stack([time, volts, steps])
            np.savetxt(tmp_path / name, table, '%.7f', ',', header='t,u,y', comments='')
    shares = {}
    for kind in ('nothing', 'single'):
        task, _ = measured.one([1, 0, 4], kind, 4, tmp_path)
        y = task.measured[:, 0]
        shares[kind] = np.unique(np.round(y, 13)).size / y.size
    assert shares['nothing'] == pytest.approx(shares['single'], abs=0.02)
    assert shares['nothing'] > 0.95


@pytest.mark.parametrize('place', range(4))
def test_an_effect_outside_the_list_is_visible(place: int) -> None:
    task, truth = draw.one([3, 2, place], 'clean', 'outside', place)
    left = task.measured - task.records.free_run
    assert np.std((left - left.mean(0))[task.warm_up :]) > 1.5 * truth.noise


def test_bouc_wen_is_solved_exactly() -> None:
    """The law in 4000 small Euler steps per sample gives the same."""
    voltage = np.array([[0.5], [1.0], [-0.3], [0.2]])
    h = worlds.bouc_wen(voltage, np.array([1.3]), np.array([0.4]))[:, 0]
    at, now = 0.0, 0.0
    for k, target in enumerate(voltage[:, 0]):
        step = (target - at) / 4000
        for _ in range(4000):
            now += step - 1.3 * abs(step) * now - 0.4 * step * abs(now)
        at = target
        assert h[k] == pytest.approx(now, abs=2e-4)


def test_linear_pieces_have_their_step_responses() -> None:
    step, t = np.ones((400, 1)), 1e-3 * np.arange(1, 401)
    lag = worlds.low_pass(step, 0.02, 1e-3, False)[:, 0]
    assert lag == pytest.approx(1 - np.exp(-t / 0.02), abs=1e-9)
    mode = worlds.resonator(step, 30.0, 0.1, 1e-3, False)[:, 0]
    w, d = 2 * np.pi * 30.0, 0.1
    root = np.sqrt(1 - d * d)
    exact = 1 - np.exp(-d * w * t) * (np.cos(root * w * t) + d / root * np.sin(root * w * t))
    assert mode == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize('name', list(effects.EFFECTS))
def test_every_effect_changes_the_displacement_by_its_size(name: str) -> None:
    scale = worlds.Scale(10.0, 1e-5, 2e-3, 0.6)
    voltage = 10.0 * np.sin(2 * np.pi * 5.0 * worlds.times(300, 2e-3))
    values = {'gain': 1.1e-6, 'loop': 3e-7, 'beta': 0.1, 'gamma': 0.02}
    drawn = effects.EFFECTS[name].draw(np.random.default_rng(0), scale)

    def change(factor: float) -> float:
        strong = {name: effects.scaled(name, drawn, factor)}
        plain = worlds.respond('bouc_wen', values, voltage, scale, {})
        return float(np.std(worlds.respond('bouc_wen', values, voltage, scale, strong) - plain))

    assert change(1.0) > 1e-9
    assert change(1.0) > 1.5 * change(0.5)
    assert effects.strength(name, drawn) <= effects.EFFECTS[name].most(scale)
