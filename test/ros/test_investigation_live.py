"""`investigate` on live nodes: cancelled, continued, repeated from its bags, after restarts."""

from __future__ import annotations

import signal
from math import nan
from pathlib import Path

import pytest
from investigating import TIMEOUT, Bench, write_model
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.investigation.runner import Journal, repeated
from piezo_hysteresis.records import load
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_interfaces.msg import VoltageCommand

pytestmark = pytest.mark.ros


@pytest.fixture(scope='module')
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp('model'))


@pytest.fixture
def bench(processes: LiveNodes, listener: Listener, model: Path, tmp_path: Path) -> Bench:
    (tmp_path / 'model.yaml').write_bytes(model.read_bytes())
    return Bench(processes, listener, tmp_path / 'model.yaml')


def test_limits_that_cannot_be_move_nothing_and_a_spent_budget_ends_at_rest(bench: Bench) -> None:
    commands = bench.listener.listen(VoltageCommand, 'voltage/command')
    for low, high in ((0.3, -0.3), (-0.3, nan), (-30.0, 30.0)):
        code, printed = bench.ended(bench.investigate(low=low, high=high))
        assert code == 2
        assert 'voltage' in printed
    code, printed = bench.ended(bench.investigate(budget=0.5))
    assert code == 2
    assert 'allow more seconds' in printed
    assert not (bench.folder / 'out').exists()
    assert commands == []  # nothing has moved
    spends_its_budget(bench)


def spends_its_budget(bench: Bench) -> list[int]:
    """Investigate for two seconds; return the numbers of the experiments."""
    code, printed = bench.ended(bench.investigate(budget=2.0))
    assert code == 0, printed
    assert bench.result()['stop']['reason'] == 'budget'
    assert bench.result()['seconds'] <= 2.0
    bench.rests()
    bench.safe()
    return [line['number'] for line in Journal.read(bench.folder / 'out').lines]


@pytest.mark.slow
def test_a_larger_budget_resumes(bench: Bench) -> None:
    done = spends_its_budget(bench)
    assert spends_its_budget(bench) == done
    verb = bench.investigate()
    bench.begun(len(done) + 1)
    bench.interrupted(verb)


@pytest.mark.slow
def test_it_finds_an_effect_after_cancel_and_resume_and_reduces_the_gap(bench: Bench) -> None:
    verb = bench.investigate()
    bench.begun(2)
    bench.interrupted(verb)
    done = len(Journal.read(bench.folder / 'out').lines)
    assert done >= 1

    code, printed = bench.ended(bench.investigate())
    assert code == 0, printed
    result = bench.result()
    assert list(result['effects']) == ['creep']
    assert result['stop']['reason'] == 'sure'
    assert result['after_in_floors'] < 0.5 * result['before_in_floors']
    bench.safe()
    lines = Journal.read(bench.folder / 'out').lines
    assert all(line['why'] for line in lines)
    assert len(lines) == result['experiments'] > done
    assert len(load([bench.folder / 'out' / 'bags' / '01'])) == 1

    again = repeated(bench.folder / 'out')
    assert again.differences == ()
    assert again.stop is not None
    assert again.stop.reason == 'sure'


def node(bench: Bench, name: str) -> NodeProcess:
    return next(each for each in bench.processes.nodes if each.name == name)


def end(bench: Bench, name: str) -> None:
    """End a node like a service manager does."""
    process = node(bench, name)
    process.signal(signal.SIGTERM)
    assert process.wait(60.0) == 0
    bench.processes.retire(process)


@pytest.mark.slow
def test_it_resumes_after_a_restart_of_excitation_actuator_and_feedforward(bench: Bench) -> None:
    bench.start('feedforward')
    verb = bench.investigate()
    bench.moves()
    end(bench, 'excitation')
    bench.start('excitation')
    bench.begun(2)
    bench.moves()
    end(bench, 'feedforward')
    end(bench, 'simulator')
    bench.start('simulator')
    bench.start('feedforward')
    code, printed = bench.ended(verb)
    assert code == 0, printed
    result = bench.result()
    assert list(result['effects']) == ['creep']
    assert len(Journal.read(bench.folder / 'out').lines) == result['experiments']
    bench.rests()
    bench.safe()
    for user in ('gap_monitor', 'feedforward'):
        assert '+creep' in bench.listener.get_parameter(user, 'model.name')
    assert repeated(bench.folder / 'out').differences == ()


@pytest.mark.slow
def test_a_killed_verb_leaves_no_sweep_and_the_same_command_continues(bench: Bench) -> None:
    journal = bench.folder / 'out' / 'journal.jsonl'
    verb = bench.investigate()
    bench.listener.until(
        lambda: journal.is_file() and len(journal.read_text().splitlines()) == 2, timeout=TIMEOUT
    )
    first = journal.read_text()
    bench.moves()
    verb.kill()
    verb.wait()
    code, printed = bench.ended(bench.investigate())
    assert code == 0, printed
    assert 'creep' in printed.splitlines()[-2]
    assert journal.read_text().startswith(first)
    assert repeated(bench.folder / 'out').differences == ()
    bench.rests()
    bench.safe()
