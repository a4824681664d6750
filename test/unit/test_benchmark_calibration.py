"""Calibration of entries: one rule for all, set on tasks of other seeds."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'studies' / 'benchmark'))
calibrated: Any = importlib.import_module('piezo_benchmark.entries.calibrated')
entries: Any = importlib.import_module('piezo_benchmark.entries')
draw: Any = importlib.import_module('piezo_benchmark.draw')
report: Any = importlib.import_module('piezo_benchmark.report')
scores: Any = importlib.import_module('piezo_benchmark.scores')
program: Any = importlib.import_module('piezo_benchmark.__main__')

METHODS = [name for name in entries.NAMES if name in entries.CALIBRATED]


@pytest.fixture
def task() -> Any:
    return draw.one([5, 0, 3], 'clean', 'nothing', 8)[0]


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty file of calibration that replaces the one of the package."""
    monkeypatch.setattr(calibrated, 'FILE', tmp_path / 'calibration.json')
    calibrated.weights_of.cache_clear()
    return tmp_path / 'calibration.json'


def test_components_are_distributions(task: Any) -> None:
    statement = calibrated.Statement(('pair',), {'creep+tone': 0.9, 'creep': 0.05}, {'mode': 2.0})
    found = calibrated.components(task, statement)
    assert tuple(found) == calibrated.COMPONENTS
    assert all(sum(part.values()) == pytest.approx(1.0) for part in found.values())
    assert 0.9 < found['stated']['creep+tone'] < 0.91
    assert found['half'] == pytest.approx({'creep': 0.5 / 0.95, 'tone': 0.45 / 0.95})
    assert found['partner']['creep+drift'] > found['partner']['drift+tone'] > 0.0
    assert 'creep+tone' not in calibrated.components(
        task, calibrated.Statement(('single',), {'mode': 1.0})
    )['partner']  # fmt: skip


def test_a_method_that_is_right_nine_times_in_ten_gets_nine_tenths(task: Any, file: Path) -> None:
    truths = ['creep'] * 90 + ['none'] * 10
    said = calibrated.Statement(('single', 'noise'), {'creep': 1.0})
    calibrated.write('mine', [7], [calibrated.chances_row(task, said, t) for t in truths])
    found = scores.distribution(calibrated.answered('mine', task, said))
    assert found['creep'] == pytest.approx(0.9, abs=0.04)
    assert found['none'] == pytest.approx(0.1, abs=0.04)
    assert json.loads(file.read_text(encoding='utf-8'))['mine']['seeds'] == [7]


def test_a_kind_without_tasks_has_the_weights_of_the_wider_one(task: Any, file: Path) -> None:
    said = calibrated.Statement(('single', 'noise'), {'creep': 1.0})
    calibrated.write('mine', [7], [calibrated.chances_row(task, said, 'creep')] * 30)
    other = calibrated.Statement(('single', 'residual'), {'tone': 1.0})
    assert calibrated.answered('mine', task, other).probabilities['tone'] > 0.6
    assert file.exists()


def test_weights_are_those_of_the_largest_likelihood() -> None:
    random = np.random.default_rng(3)
    chances = random.uniform(0.0, 1.0, (200, 3)) ** 3
    prior = np.ones(3)
    best = calibrated.likeliest(chances, prior)

    def cost(weights: Any) -> float:
        return float(-np.sum(np.log(chances @ weights)) - prior @ np.log(weights))

    for _ in range(30):
        near = np.abs(best + 0.02 * random.standard_normal(3))
        assert cost(near / near.sum()) > cost(best)


def test_no_entry_is_calibrated_on_the_practice_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    found = calibrated.read()
    assert set(found) == set(entries.CALIBRATED)
    assert all(draw.PRACTICE_SEED not in part['seeds'] for part in found.values())
    words = ['x', 'calibrate', '--seed', str(draw.PRACTICE_SEED)]
    monkeypatch.setattr(sys, 'argv', words)
    with pytest.raises(SystemExit, match='practice'):
        program.main()


@pytest.mark.component
def test_no_method_is_better_than_the_ideal_observer() -> None:
    """On the results of the page, for all levels."""
    results = json.loads(
        (ROOT / 'studies/benchmark/results/practice.json').read_text(encoding='utf-8')
    )
    found = {name: scores.summary(rows) for name, rows in report.rows_of(results).items()}
    for group, numbers in found['ideal_observer'].items():
        for name in METHODS:
            assert numbers['bits'][0] < found[name][group]['bits'][0], (group, name)
