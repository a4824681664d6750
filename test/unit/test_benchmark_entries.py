"""Entries of the benchmark, its runs and its page."""

from __future__ import annotations

import importlib
import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'studies' / 'benchmark'))
draw: Any = importlib.import_module('piezo_benchmark.draw')
tasks: Any = importlib.import_module('piezo_benchmark.tasks')
run: Any = importlib.import_module('piezo_benchmark.run')
report: Any = importlib.import_module('piezo_benchmark.report')
fits: Any = importlib.import_module('piezo_benchmark.fits')
common: Any = importlib.import_module('piezo_benchmark.entries.common')
suite: Any = importlib.import_module('piezo_benchmark.entries.suite')
program: Any = importlib.import_module('piezo_benchmark.__main__')

DRIFT = 8  # place at which the first name that is tried is the drift


@pytest.fixture(scope='module')
def drawn() -> dict[str, Any]:
    return {kind: draw.one([5, 0, 3], 'clean', kind, DRIFT) for kind in ('single', 'nothing')}


def effect(name: str, probability: float, *others: tuple[str, float]) -> dict[str, Any]:
    alternatives = [{'name': n, 'probability': p} for n, p in others]
    return {
        'name': name, 'probability': probability, 'alternatives': alternatives,
        'look_alikes': [], 'parameters': {},
    }  # fmt: skip


def verdict(word: str, *effects: dict[str, Any], left: bool = False) -> dict[str, Any]:
    unexplained = {'significant': left}
    return {'verdict': word, 'effects': list(effects), 'suspects': [], 'unexplained': unexplained}


def test_what_the_suite_calls_none_or_unknown() -> None:
    assert suite.probabilities(verdict('none')) == {'none': 1.0}
    assert suite.probabilities(verdict('unknown')) == {'unknown': 1.0}
    foreign = verdict('named', effect('asymmetry', 0.9))
    assert suite.probabilities(foreign) == {'unknown': 1.0}


def test_one_name_with_an_alternative() -> None:
    said = verdict('named', effect('gain_decay', 0.7, ('drift', 0.2), ('slew_limit', 0.05)))
    found = suite.probabilities(said)
    assert found == pytest.approx({'falling_gain': 0.7, 'drift': 0.2, 'unknown': 0.05})


def test_two_names_are_a_pair() -> None:
    said = verdict('named', effect('creep', 0.9), effect('mains_hum', 0.8))
    found = suite.probabilities(said)
    assert found['creep+tone'] == pytest.approx(0.72)
    assert found['creep'] == pytest.approx(0.18)
    assert sum(found.values()) <= 1.0


def test_doubts_of_the_suite_are_other_outcomes(drawn: dict[str, Any]) -> None:
    task, _ = drawn['nothing']
    drift = effect('drift', 0.7, ('creep', 0.2))
    drift['look_alikes'] = [{'name': 'heat', 'distance': 1.0}]
    found = suite.stated(task, verdict('named', drift, left=True))
    assert found.others == {'creep': 1.0, 'unknown': 1.0}
    assert found.kind == ('single', 'residual', 'exact')
    foreign = suite.stated(task, verdict('named', drift, effect('asymmetry', 0.9)))
    assert foreign.kind[0] == 'not on the list'


def test_parameters_in_the_words_of_the_list() -> None:
    found = effect('transport_delay', 0.9)
    found['parameters'] = {'delay': {'value': 0.006, 'std': 1e-4, 'unit': 's'}}
    assert suite.parameters(verdict('named', found)) == {
        'transport_delay': {'delay': (0.006, 1e-4)}
    }


@pytest.mark.parametrize('program', ['raise SystemExit(3)', 'input(); print("{}}")'])
def test_a_failure_of_an_entry_is_its_own(
    drawn: dict[str, Any], monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    monkeypatch.setenv('PIEZO_PYTHON', shlex.join([sys.executable, '-c', program]))
    row = run.examined('suite', *drawn['nothing'])
    assert row.failed
    assert row.bits == pytest.approx(np.log2(len(tasks.outcomes())))


def named(drawn: dict[str, Any]) -> Any:
    """Return the tasks and their truths, each with an identifier of its own."""
    pairs = ([replace(x, identifier=kind) for x in pair] for kind, pair in drawn.items())
    return zip(*pairs, strict=True)


@pytest.mark.component
def test_results_are_kept_and_nothing_runs_twice(drawn: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / 'results.json'
    spoken: list[str] = []
    both, count = list(named(drawn)), len(drawn)
    for _ in range(2):
        run.run(['coin'], *both, file, 5, say=spoken.append, workers=2)
    lines = [line.split(',')[0] for line in spoken]
    assert lines == [f'coin: 0 of {count} right', 'coin: 0 of 0 right']
    found = json.loads(file.read_text(encoding='utf-8'))
    assert len(found['entries']['coin']) == count
    assert found['cost']['coin']['tasks'] == count
    with pytest.raises(ValueError, match='seed'):
        run.run(['coin'], *both, file, 6, say=spoken.append)


@pytest.mark.component
def test_the_page_states_every_entry_and_better_ones(
    drawn: dict[str, Any], tmp_path: Path
) -> None:
    file = tmp_path / 'results.json'
    run.run(['coin', 'always_none'], *named(drawn), file, 5, say=lambda line: None)
    results = run.read(file)
    results['entries'] |= {
        'suite': results['entries']['coin'],
        'pysindy': results['entries']['always_none'],
    }
    text = report.page(results, [{**results, 'examiner': 'somebody'}])
    assert '| `always_none` |' in text
    assert 'nothing 6.09 (`pysindy`' in text
    assert '| 5 |' in text
    assert 'No threshold of the suite' in text
    more = report.detail(results, 'page.md')
    assert '`drift`' in more
    assert '$' not in text + more


def test_a_fit_finds_the_numbers_of_the_baseline(drawn: dict[str, Any]) -> None:
    task, truth = drawn['nothing']
    for name, value in truth.values.items():
        off = abs(task.baseline.values[name] - value)
        assert off < 5 * task.baseline.deviations[name] + 1e-12 * abs(value)


def test_a_command_without_a_place_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(program, 'drawn', lambda *given: ([], []))
    monkeypatch.setattr(sys, 'argv', ['piezo_benchmark', 'draw', '--seed', '4'])
    with pytest.raises(SystemExit, match='where to'):
        program.main()
    assert 'measured records are not here' in capsys.readouterr().out


@pytest.mark.component
@pytest.mark.parametrize('kind', ['single', 'nothing'])
def test_the_ideal_observer_names_it(drawn: dict[str, Any], kind: str) -> None:
    row = run.examined('ideal_observer', *drawn[kind])
    assert (row.right, row.failed) == (1.0, '')
    assert row.ratio == pytest.approx(1.0, abs=0.1)


@pytest.mark.component
def test_least_squares_names_a_drift_and_predicts_as_the_control(drawn: dict[str, Any]) -> None:
    row = run.examined('least_squares_bic', *drawn['single'])
    assert (row.truth, row.right, row.failed) == ('drift', 1.0, '')
    assert row.ratio < 1.2
    assert row.parameter_error is not None
    assert row.parameter_error < 0.1


@pytest.mark.component
def test_the_known_error_of_a_baseline_is_subtracted(drawn: dict[str, Any]) -> None:
    task, truth = draw.one([5, 0, 3], 'foreign', 'nothing', 8)
    known = common.corrected(task)
    missed = [
        np.std(fits.centred(run - truth.held_out, task.warm_up))
        for run in (task.held_out.free_run, task.held_out.free_run + known.held_out)
    ]
    assert missed[1] < 0.8 * missed[0]
    assert 0.5 * missed[1] < known.error < 2.0 * missed[1]
    exact, _ = drawn['nothing']
    assert common.corrected(exact).task is exact


@pytest.mark.component
def test_a_joint_fit_names_nothing(drawn: dict[str, Any]) -> None:
    row = run.examined('joint_fit', *drawn['nothing'])
    assert row.top in ('none', 'unknown')
    assert row.failed == ''
    assert row.ratio < 1.1


@pytest.mark.component
def test_the_suite_answers_by_its_interface(
    drawn: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('PIEZO_PYTHON', sys.executable)
    row = run.examined('suite', *drawn['nothing'])
    assert row.failed == ''
    assert row.confidence > 0.5
    assert row.ratio < 1.1


@pytest.mark.component
def test_a_sealed_set_is_drawn_apart_from_its_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ['draw', '--seed', '3', '--sealed', str(tmp_path), '--level', 'clean', '--quick']
    monkeypatch.setattr(sys, 'argv', ['piezo_benchmark', *words])
    program.main()
    assert {p.name for p in (tmp_path / 'truth').iterdir()} == {'truth.json', 'truth.npz'}
    names = [p.name for p in sorted((tmp_path / 'tasks').iterdir())]
    assert len(names) == 12
    assert all(name.startswith('task-') for name in names)
    given = ['--sealed', str(tmp_path), '--entry', 'coin', '--seed', '3']
    results = tmp_path / 'results' / 'sealed_3.json'
    monkeypatch.setattr(sys, 'argv', ['x', 'run', *given, '--results', str(results)])
    program.main()
    assert len(run.read(results)['entries']['coin']) == 6
