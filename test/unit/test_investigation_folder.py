"""The folder of an investigation: journal and bags, going on, and repeating it from them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.errors import PiezoError, RecordError
from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, InvestigationError
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.investigation.runner import (
    InvestigationProgress,
    Journal,
    Setup,
    repeated,
    run_investigation,
)
from piezo_hysteresis.investigation.session import Rules
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, write_bag
from piezo_sim.plant import Plant
from piezo_sim.sweep import grid, simulate

PRESET, RATE = 'generic_bouc_wen', 1000.0
QUIET = {'effects.noise': True, 'sensor.noise_rms': 5e-8}


class Actuator:
    """A simulated one that records bags, and breaks down after some experiments."""

    def __init__(self, lasts: int = 100, **effects: Any) -> None:
        self.plant = Plant.from_preset(PRESET, RATE, 3, QUIET | effects)
        self.lasts, self.clock = lasts, 0.3
        self.used: list[Any] = []

    def run(self, experiment: Any, bag: Any) -> bool:
        if self.lasts == 0:
            raise PiezoError('the actuator has gone')
        self.lasts -= 1
        self.plant.run(np.zeros(300))
        voltage = experiment.voltage(RATE)
        record = Record('r', 1.0 / RATE, voltage, self.plant.run(voltage), start=self.clock)
        self.clock += 0.3 + voltage.size / RATE
        write_bag(bag, [record])
        return True

    def apply(self, model: Any) -> str:
        self.used.append(model)
        return 'the test'


@pytest.fixture(scope='module')
def setup() -> Setup:
    specs = grid('sine', [1.0, 5.0, 20.0, 50.0], [1.0, 0.5], {'duration': 2.5, 'ramp': 0.2})
    model = identify(simulate(PRESET, specs, QUIET, 1, RATE), named('classical')).model
    return Setup(model, ExperimentLimits(-1.0, 1.0, slew=700.0), Rules(budget=60.0), RATE)


@pytest.mark.slow
def test_it_resumes_after_a_breakdown_and_is_repeated_from_its_bags(
    setup: Setup, tmp_path: Path
) -> None:
    folder = tmp_path / 'out'
    with pytest.raises(PiezoError, match='gone'):
        run_investigation(folder, setup, Actuator(1, **{'effects.creep': True}))
    assert len(Journal.read(folder).lines) == 1
    told: list[InvestigationProgress] = []
    actuator = Actuator(**{'effects.creep': True})
    result = run_investigation(folder, setup, actuator, told.append)
    assert result.stop.reason == 'sure'
    assert list(result.effects) == ['creep']
    assert result.after_in_floors < 0.5 * result.before_in_floors
    assert actuator.used[0].model.name == 'classical+creep_pair'
    assert [each.stage for each in told][:2] == ['prepare', 'judge']
    assert {each.stage for each in told} == {'prepare', 'run', 'judge', 'apply'}
    lines = Journal.read(folder).lines
    assert [line['number'] for line in lines] == list(range(1, len(lines) + 1))
    assert lines[-1]['after']['names'] == ['creep']
    assert all(line['why'] and line['answer'] for line in lines)
    summary = json.loads((folder / 'investigation.json').read_text())
    assert summary['applied'] == 'the test'
    assert (folder / 'found' / 'report.html').is_file()
    again = repeated(folder)
    assert again.differences == ()
    assert list(again.lines) == lines
    assert again.stop == result.stop


def test_a_folder_of_something_else_is_refused(setup: Setup, tmp_path: Path) -> None:
    (tmp_path / 'mine').write_text('x')
    with pytest.raises(InvestigationError, match='not empty'):
        Journal.create_or_resume(tmp_path, setup)
    with pytest.raises(InvestigationError, match='give the folder that investigate wrote'):
        Journal.read(tmp_path)
    Journal.create_or_resume(tmp_path / 'new', setup).cleared(1)
    other = Setup(setup.model, ExperimentLimits(-0.5, 0.5), setup.rules, RATE)
    with pytest.raises(InvestigationError, match='other limits'):
        Journal.create_or_resume(tmp_path / 'new', other)


def test_a_damaged_journal_is_reported(setup: Setup, tmp_path: Path) -> None:
    Journal.create_or_resume(tmp_path / 'new', setup).cleared(1)
    (tmp_path / 'new' / 'journal.jsonl').write_text('{')
    with pytest.raises(InvestigationError, match='damaged'):
        Journal.read(tmp_path / 'new')


@pytest.mark.slow
def test_a_budget_is_spent_and_a_larger_one_resumes(setup: Setup, tmp_path: Path) -> None:
    told: list[InvestigationProgress] = []
    folder = tmp_path / 'out'
    actuator = Actuator(**{'effects.creep': True})

    def asked(budget: float) -> Setup:
        return replace(setup, rules=replace(setup.rules, budget=budget))

    with pytest.raises(RecordError, match='allow more seconds'):
        run_investigation(folder, asked(0.5), actuator)
    assert not folder.exists()  # so that the same words with more seconds are no other words
    spent = run_investigation(folder, asked(2.0), actuator, told.append)
    assert spent.stop.reason == 'budget'
    assert spent.seconds <= 2.0
    assert actuator.used == []  # what is not settled is used by nobody
    assert len(list((folder / 'bags').iterdir())) == spent.experiments
    assert spent.words.endswith('continues from here.')
    assert told[-1].answer == Journal.read(folder).lines[-1]['answer']
    found = run_investigation(folder, asked(60.0), actuator)
    assert found.stop.reason == 'sure'
    assert list(found.effects) == ['creep']
    lines = Journal.read(folder).lines
    assert [line['budget'] for line in lines] == [2.0] + [60.0] * (len(lines) - 1)
    again = repeated(folder)
    assert again.differences == ()
    assert list(again.lines) == lines
