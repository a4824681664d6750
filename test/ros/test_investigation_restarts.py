"""An investigation continues after nodes are ended and restarted."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from investigating import LIMITS, TIMEOUT, Bench, write_model
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.investigation.runner import Journal, repeated
from piezo_hysteresis.ros.processes import NodeProcess

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope='module')
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp('model'))


@pytest.fixture
def bench(processes: LiveNodes, listener: Listener, model: Path, tmp_path: Path) -> Bench:
    (tmp_path / 'model.yaml').write_bytes(model.read_bytes())
    return Bench(processes, listener, tmp_path / 'model.yaml')


def node(bench: Bench, name: str) -> NodeProcess:
    return next(each for each in bench.processes.nodes if each.name == name)


def end(bench: Bench, name: str) -> None:
    """End a node like a service manager does."""
    process = node(bench, name)
    process.signal(signal.SIGTERM)
    assert process.wait(60.0) == 0
    bench.processes.retire(process)


def test_it_resumes_after_a_restart_of_excitation_actuator_and_feedforward(
    bench: Bench, tmp_path: Path
) -> None:
    bench.start('feedforward')
    feedback: list[Any] = []
    handle = bench.ask(feedback)
    bench.moves()
    end(bench, 'excitation')
    bench.start('excitation')
    bench.listener.until(lambda: any(f.number == 2 for f in feedback), timeout=TIMEOUT)
    bench.moves()
    end(bench, 'feedforward')
    end(bench, 'simulator')
    bench.start('simulator')
    bench.start('feedforward')
    result = bench.ended(handle).result
    assert result.success, result.message
    assert list(result.effects) == ['creep']
    assert len(Journal.read(tmp_path / 'out').lines) == result.experiments
    bench.rests()
    bench.safe()
    for user in ('gap_monitor', 'feedforward'):
        assert bench.listener.get_parameter(user, 'model.name').endswith('creep')
    assert repeated(tmp_path / 'out').differences == ()


def test_the_verb_resumes_after_a_restart_of_the_discovery_node(
    bench: Bench, tmp_path: Path
) -> None:
    words = [f'--{name}={value:g}' for name, value in LIMITS.items()]
    command = [sys.executable, '-m', 'piezo_hysteresis', 'investigate', '--out', 'out', *words]
    with subprocess.Popen(
        command, env=bench.processes.environment, stdout=subprocess.PIPE, text=True
    ) as verb:
        journal = tmp_path / 'out' / 'journal.jsonl'
        bench.listener.until(
            lambda: journal.is_file() and len(journal.read_text().splitlines()) == 2,
            timeout=TIMEOUT,
        )
        first = journal.read_text()
        bench.moves()
        end(bench, 'discovery')
        bench.rests()  # nobody waits for its sweep any more
        bench.start('discovery')
        bench.listener.until(lambda: verb.poll() is not None, timeout=TIMEOUT)
        assert verb.stdout is not None
        told = verb.stdout.read()
    assert verb.returncode == 0, told
    assert 'creep' in told.splitlines()[-2]
    assert journal.read_text().startswith(first)
    assert repeated(tmp_path / 'out').differences == ()
    bench.safe()
