"""A time limit: no further step is started, and untested candidates are reported."""

import argparse
import itertools
import math
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli.discover import configure, options_of
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.selection.baseline import fitted_baselines
from piezo_hysteresis.discovery.selection.candidate_fit import Added, ModelSpec
from piezo_hysteresis.discovery.selection.elimination import without_unfinished
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, RecordInfo

DT = 1e-3


def records() -> list[Record]:
    """Return sines of an actuator that acts late, which its baseline does not."""
    model = named('classical')
    found = []
    for k, frequency in enumerate((1.0, 3.0, 9.0, 20.0)):
        u = np.sin(2 * np.pi * frequency * DT * np.arange(6000))
        late = np.concatenate([np.zeros(4), u[:-4]])
        y = model.respond(late, model.pack(model.defaults()), DT)
        y = y + np.random.default_rng(k).normal(0, 0.01 * np.std(y), u.size)
        info = RecordInfo(frequency=frequency)
        found.append(Record(f'{frequency:g} Hz', DT, u, y, info=info))
    return found


def test_without_a_limit_nothing_is_skipped() -> None:
    end = Deadline()
    assert not end.passed
    assert not end.skips('anything')
    assert list(end.untried) == []


def test_what_is_skipped_is_noted_once() -> None:
    end = Deadline(1e-9)
    assert end.passed
    assert all(end.skips(each) for each in ('creep', 'drift', 'creep'))
    assert list(end.untried) == ['creep', 'drift']


def test_the_elimination_has_time_after_the_search() -> None:
    end = Deadline(100.0, began=time.monotonic() - 80.0)
    assert end.skips('creep')
    later = end.with_reserve()
    assert not later.skips('elimination')
    assert list(later.untried) == ['creep']
    assert Deadline(100.0, began=time.monotonic() - 101.0).with_reserve().passed


@pytest.mark.parametrize('seconds', [0.0, -1.0, math.nan])
def test_no_time_at_all_is_refused(seconds: float) -> None:
    with pytest.raises(IdentificationError, match='above 0 s'):
        Deadline(seconds)


@pytest.mark.parametrize(('words', 'seconds'), [([], 180.0), (['--time-limit', '0'], 0.0)])
def test_the_verb_has_a_limit_unless_it_gets_another(words: list[str], seconds: float) -> None:
    parser = argparse.ArgumentParser()
    configure(parser)
    given = parser.parse_args(['a.csv', '--baseline', 'classical', '--out', 'found', *words])
    assert options_of(given)['time_limit'] == seconds


@pytest.mark.component
def test_a_search_without_time_reports_what_is_untested() -> None:
    verdict = discover(records(), named('classical'), time_limit=1e-6).verdict
    assert verdict.verdict == 'unknown'
    assert 'transport_delay' in verdict.not_tried
    assert 'no effect that was tried explains it' in verdict.summary
    assert 'The time limit ended the search; not tried: ' in verdict.summary
    assert verdict.to_dict()['not_tried'] == list(verdict.not_tried)


@pytest.mark.slow
def test_a_search_with_time_enough_is_the_same_as_one_without_a_limit() -> None:
    with_limit = discover(records(), named('classical'), time_limit=1e6).verdict
    assert [effect.name for effect in with_limit.effects] == ['transport_delay']
    assert with_limit.not_tried == ()
    assert 'time limit' not in with_limit.summary


@pytest.mark.slow
@pytest.mark.parametrize('steps', [375, 560, 620])
def test_wherever_the_limit_cuts_no_wrong_or_unlikely_effect_is_listed(
    steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = itertools.count()

    def passed(end: Deadline) -> bool:
        return next(asked) > (1.0 - end.reserved) * steps

    monkeypatch.setattr(Deadline, 'passed', property(passed))
    found = discover([record.section(0, 2500) for record in records()], named('classical'))
    assert found.verdict.not_tried
    assert {effect.name for effect in found.verdict.effects} <= {'transport_delay'}
    assert all(effect.probability >= 0.005 for effect in found.verdict.effects)
    ends = {q.name: (q.low, q.high) for q in found.final.model.parameters}
    for added in found.final.added:
        values = [(found.final.values[name], ends[name]) for name in added.names.values()]
        assert all(low < value < high for value, (low, high) in values)


def test_a_baseline_without_time_is_fitted_from_its_first_start_only() -> None:
    end = Deadline(1e-9)
    model = named('classical')
    given = ModelFile(model, {**model.defaults(), 'offset': 0.0})
    fitted_baselines(split(annotated(records())), given, RecordAssumptions(), deadline=end)
    assert 'a further start of the baseline' in end.untried
    assert 'the baseline on the slowest records' in end.untried


@pytest.mark.parametrize(('p_value', 'stays'), [(1e-4, True), (0.2, False), (1.0, False)])
def test_an_effect_of_no_significance_is_not_listed_by_a_search_that_was_cut(
    p_value: float, stays: bool
) -> None:
    """One was, with probability .73 and p 1, beside a mode whose fit had not ended."""
    model = named('linear_mode')
    start: Any = ModelSpec(model, model.defaults())
    added = Added('friction', 'output', {})
    final: Any = replace(start, added=(added,))
    won = SimpleNamespace(
        probabilities=lambda: {'friction': 0.73},
        gain=SimpleNamespace(p_value=p_value),
        lost_clearly=lambda policy: False,
    )
    step: Any = SimpleNamespace(fit=SimpleNamespace(effect='friction'), round=won)
    evaluator: Any = SimpleNamespace(fit=lambda spec, enough: spec, policy=POLICY)
    kept, found = without_unfinished(evaluator, start, [step], final)
    assert (kept, found) == (([step], final) if stays else ([], start))
