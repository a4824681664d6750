"""Scores of the benchmark: lazy and wrong answers get what they deserve."""

from __future__ import annotations

import importlib
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'studies' / 'benchmark'))
scores: Any = importlib.import_module('piezo_benchmark.scores')
tasks: Any = importlib.import_module('piezo_benchmark.tasks')
draw: Any = importlib.import_module('piezo_benchmark.draw')
effects: Any = importlib.import_module('piezo_benchmark.effects')

OUTCOMES = tasks.outcomes()


def entry(name: str) -> Any:
    return importlib.import_module(f'piezo_benchmark.entries.{name}')


def bits(answer: Any, truth: str) -> float:
    return -math.log2(scores.distribution(answer)[truth])


def tiny(level: str = 'clean') -> Any:
    """Return a task without content, for entries that do not look at it."""
    records = tasks.Records(('a',), np.zeros((9, 1)), np.zeros((9, 1)), np.zeros((9, 1)))
    worlds: Any = importlib.import_module('piezo_benchmark.worlds')
    scale = worlds.Scale(1.0, 1e-5, 1e-3, 9e-3)
    base = tasks.Baseline('bouc_wen', '', {}, {})
    return tasks.Task('task-0000', level, scale, 1, base, records, records)


def truth_of(kind: str, names: tuple[str, ...]) -> Any:
    zero = np.zeros((9, 1))
    held_out = np.sin(np.arange(9.0))[:, None]
    given = {name: {'drift': 0.1} for name in names}
    return tasks.Truth(
        'task-0000', 'clean', kind, names, given, held_out, 0.1, zero, 0.1, zero, {}
    )


def frequencies() -> dict[str, float]:
    """Return how often each outcome is drawn at the clean level."""
    counts = {kind: n for (level, kind), n in draw.COUNTS.items() if level == 'clean'}
    total = sum(counts.values())
    names = list(effects.EFFECTS)
    found = {name: counts['single'] / total / len(names) for name in names}
    found |= {'none': counts['nothing'] / total, 'unknown': counts['outside'] / total}
    pairs = [name for name in OUTCOMES if '+' in name]
    return found | {pair: counts['pair'] / total / len(pairs) for pair in pairs}


def expected(answer: Any) -> float:
    said = scores.distribution(answer)
    return sum(-p * math.log2(said[name]) for name, p in frequencies().items())


def test_there_are_two_hundred_practice_tasks() -> None:
    assert sum(draw.COUNTS.values()) == 200


def test_probabilities_sum_to_one_and_none_is_zero() -> None:
    found = scores.distribution(tasks.Answer({'creep': 0.7, 'drift+creep': 0.2}))
    assert sum(found.values()) == pytest.approx(1.0)
    assert min(found.values()) > 0
    assert found['creep+drift'] > 0.19


def test_more_than_one_in_all_is_scaled_down() -> None:
    found = scores.distribution(tasks.Answer({'creep': 3.0, 'drift': 1.0}))
    assert sum(found.values()) == pytest.approx(1.0)
    assert found['creep'] == pytest.approx(3 * found['drift'], rel=0.01)


@pytest.mark.parametrize('bad', [{'backslash': 1.0}, {'creep': -0.1}, {'creep': math.nan}])
def test_what_is_no_probability_of_an_outcome_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r'outcome|probability'):
        scores.distribution(tasks.Answer(bad))


def test_a_class_is_scored_by_its_size() -> None:
    two = tasks.Answer({}, [(frozenset({'creep', 'drift'}), 1.0)])
    four = tasks.Answer({}, [(frozenset({'creep', 'drift', 'tone', 'mode'}), 1.0)])
    assert bits(two, 'creep') == pytest.approx(1.0, abs=0.05)
    assert bits(four, 'creep') == pytest.approx(2.0, abs=0.05)


def test_a_coin_gets_the_logarithm_of_the_outcomes() -> None:
    answer = entry('coin').answer(tiny())
    assert {round(bits(answer, name), 9) for name in OUTCOMES} == {
        round(math.log2(len(OUTCOMES)), 9)
    }


def test_a_coin_is_right_as_often_as_chance() -> None:
    row = scores.scored(tiny(), truth_of('single', ('drift',)), entry('coin').answer(tiny()), 0.0)
    assert row.right == pytest.approx(1 / len(OUTCOMES))


def test_always_none_wins_only_where_nothing_hides() -> None:
    answer = entry('always_none').answer(tiny())
    assert bits(answer, 'none') < 0.1
    assert bits(answer, 'creep') > math.log2(len(OUTCOMES))
    row = scores.scored(tiny(), truth_of('single', ('drift',)), answer, 0.0)
    assert (row.right, row.false_alarm) == (0.0, 0.0)


def test_the_most_frequent_name_is_the_best_lazy_answer() -> None:
    best = expected(entry('most_frequent').answer(tiny()))
    names = ('none', 'unknown', 'creep')
    lazy = [tasks.Answer({name: p}) for name in names for p in (0.2, 0.5, 0.98)]
    assert all(expected(answer) > best for answer in [*lazy, tasks.Answer({})])


def test_the_score_is_proper_but_for_its_floor() -> None:
    random = np.random.default_rng(0)
    honest = frequencies()
    best = expected(tasks.Answer(honest))
    for _ in range(20):
        moved = {name: p * math.exp(random.normal(0, 0.7)) for name, p in honest.items()}
        total = sum(moved.values())
        assert expected(tasks.Answer({n: p / total for n, p in moved.items()})) > best


def test_a_random_name_gives_false_alarms() -> None:
    random = np.random.default_rng(1)
    names = list(effects.EFFECTS)
    rows = [
        scores.scored(
            tiny(), truth_of('nothing', ()), tasks.Answer({str(random.choice(names)): 0.9}), 0.0
        )
        for _ in range(5)
    ]
    assert all(row.false_alarm == 1.0 and row.bits > 9.0 for row in rows)


def test_half_of_a_pair_is_no_false_alarm_and_not_right() -> None:
    row = scores.scored(
        tiny(), truth_of('pair', ('drift', 'creep')), tasks.Answer({'drift': 0.9}), 0.0
    )
    assert (row.right, row.false_alarm, row.group) == (0.0, 0.0, 'pair')


def test_without_a_prediction_the_baseline_counts() -> None:
    truth = truth_of('nothing', ())
    own = scores.scored(tiny(), truth, tasks.Answer({}), 0.0)
    zeros = scores.scored(tiny(), truth, tasks.Answer({}, prediction=np.zeros((9, 1))), 0.0)
    exact = tasks.Answer({}, prediction=truth.held_out + 5.0)
    assert own.ratio == zeros.ratio > 1.0
    assert scores.scored(tiny(), truth, exact, 0.0).ratio == pytest.approx(0.0, abs=1e-9)


def test_parameters_count_where_the_name_is_right() -> None:
    said = {'drift': {'drift': (0.12, 0.02)}, 'creep': {'share': (1.0, 0.1)}}
    row = scores.scored(
        tiny(), truth_of('single', ('drift',)), tasks.Answer({}, parameters=said), 0.0
    )
    assert row.parameter_error == pytest.approx(0.2)
    assert row.covered == 1.0


def test_calibration_of_an_answer_that_is_right_nine_times_in_ten() -> None:
    truths = [truth_of('single', ('drift',))] * 9 + [truth_of('nothing', ())]
    rows = [scores.scored(tiny(), t, tasks.Answer({'drift': 0.905}), 0.0) for t in truths]
    (part,) = scores.calibration(rows)
    assert part['right'] == pytest.approx(0.9)
    assert part['said'] == pytest.approx(0.9, abs=0.02)


def test_each_group_has_its_numbers_and_there_is_no_total() -> None:
    truths = [truth_of('single', ('drift',)), truth_of('nothing', ())]
    rows = [scores.scored(tiny(), t, tasks.Answer({'drift': 0.9}), 1.0) for t in truths]
    found = scores.summary(rows)
    assert set(found) == {'clean', 'nothing'}
    value, low, high = found['clean']['bits']
    assert low <= value <= high
