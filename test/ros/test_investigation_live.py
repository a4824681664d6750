"""The action ``investigate`` on live nodes: cancelled, gone on with, repeated from its bags."""

from __future__ import annotations

import subprocess
import sys
from math import nan
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from investigating import TIMEOUT, Bench, write_model
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.investigation.runner import Journal, repeated
from piezo_hysteresis.records import load
from piezo_interfaces.msg import VoltageCommand

pytestmark = pytest.mark.ros


@pytest.mark.slow
def test_it_finds_an_effect_after_cancel_and_resume_and_reduces_the_gap(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    bench = Bench(processes, listener, write_model(tmp_path))
    feedback: list[Any] = []
    handle = bench.ask(feedback)
    listener.until(lambda: any(f.number == 2 for f in feedback), timeout=TIMEOUT)
    handle.cancel_goal_async()
    broken_off = bench.ended(handle)
    assert broken_off.status == GoalStatus.STATUS_CANCELED
    assert 'at rest' in broken_off.result.message
    bench.rests()
    done = len(Journal.read(tmp_path / 'out').lines)
    assert done >= 1

    result = bench.ended(bench.ask(feedback)).result
    assert result.success, result.message
    assert list(result.effects) == ['creep']
    assert result.stop == 'sure'
    assert result.after_in_floors < 0.5 * result.before_in_floors
    bench.safe()
    assert all(f.why for f in feedback if f.stage == 'run')
    lines = Journal.read(tmp_path / 'out').lines
    assert len(lines) == result.experiments > done
    assert len(load([tmp_path / 'out' / 'bags' / '01'])) == 1

    again = repeated(tmp_path / 'out')
    assert again.differences == ()
    assert again.stop is not None
    assert again.stop.reason == 'sure'


@pytest.fixture
def bench(processes: LiveNodes, listener: Listener, tmp_path: Path) -> Bench:
    return Bench(processes, listener, write_model(tmp_path))


def test_limits_that_cannot_be_move_nothing_and_a_spent_budget_ends_at_rest(bench: Bench) -> None:
    listener = bench.listener
    commands = listener.listen(VoltageCommand, 'voltage/command')
    for wrong in ((0.3, -0.3), (-0.3, nan), (0.0, -0.3), (-30.0, 30.0)):
        refused = bench.ended(bench.ask([], low=wrong[0], high=wrong[1]))
        assert refused.status == GoalStatus.STATUS_ABORTED
        assert 'the voltage limits' in refused.result.message
    verb = [sys.executable, '-m', 'piezo_hysteresis', 'investigate', '--low=-0.3']
    told = subprocess.run(verb, env=bench.processes.environment, capture_output=True, text=True)
    assert told.returncode == 2
    assert 'highest voltage is not given' in told.stderr
    refused = bench.ended(bench.ask([], budget=0.5))
    assert refused.status == GoalStatus.STATUS_ABORTED
    assert 'allow more seconds' in refused.result.message
    assert not (bench.folder / 'out').exists()
    assert commands == []  # nothing has moved
    spends_its_budget(bench)


def spends_its_budget(bench: Bench) -> list[int]:
    """Investigate for two seconds; return the numbers of the experiments."""
    feedback: list[Any] = []
    spent = bench.ended(bench.ask(feedback, budget=2.0)).result
    assert spent.success, spent.message
    assert spent.stop == 'budget'
    assert spent.seconds <= 2.0
    assert {f.stage for f in feedback} == {'prepare', 'run', 'judge'}
    assert feedback[-1].answer
    bench.rests()
    bench.safe()
    return [line['number'] for line in Journal.read(bench.folder / 'out').lines]


@pytest.mark.slow
def test_a_larger_budget_resumes(bench: Bench) -> None:
    done = spends_its_budget(bench)
    again = bench.ended(bench.ask([], budget=2.0)).result
    assert (again.stop, again.experiments) == ('budget', len(done))
    feedback: list[Any] = []
    handle = bench.ask(feedback)
    bench.listener.until(lambda: any(f.stage == 'run' for f in feedback), timeout=TIMEOUT)
    assert next(f.number for f in feedback if f.stage == 'run') == len(done) + 1
    handle.cancel_goal_async()
    assert bench.ended(handle).status == GoalStatus.STATUS_CANCELED
    bench.rests()
