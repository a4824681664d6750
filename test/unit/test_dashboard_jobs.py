"""Verbs that the page starts as child processes: only its own paths, their lines and outcomes."""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from piezo_hysteresis.dashboard.backend import DiscoveryOrder, InvestigationOrder
from piezo_hysteresis.dashboard.live_state import Live
from piezo_hysteresis.nodes.dashboard import jobs


@pytest.fixture
def live() -> Live:
    return Live('stage')


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Return the verbs that are started; none runs."""
    found: list[list[str]] = []
    monkeypatch.setattr(jobs, 'ActionJob', lambda *arguments: SimpleNamespace())
    monkeypatch.setattr(jobs.VerbJob, 'start', lambda job, verb, outcome: found.append(verb))
    return found


@pytest.mark.parametrize(
    ('bag', 'baseline'), [('../secret', 'classical'), ('/etc', 'classical'), ('bag', '--out=/')]
)
def test_a_foreign_page_names_no_path_and_no_option(
    bag: str, baseline: str, live: Live, started: list[Any], tmp_path: Path
) -> None:
    page: Any = None
    jobs.Jobs(page, live, tmp_path).run_discovery(DiscoveryOrder((bag,), baseline))
    assert started == []
    assert live.discovery.phase == 'failed'


def test_an_investigation_gets_the_limits_and_the_folder_of_the_page(
    live: Live, started: list[Any], tmp_path: Path
) -> None:
    page: Any = None
    one = jobs.Jobs(page, live, tmp_path)
    one.run_investigation(InvestigationOrder(-1.0, 2.0, 300.0, 60.0, 'first'))
    (verb,) = started
    assert verb[:5] == ['investigate', '--low=-1.0', '--high=2.0', '--slew=300.0', '--budget=60.0']
    assert str(tmp_path / 'investigations' / 'first') in verb
    one.run_investigation(InvestigationOrder(0.0, 0.0, 0.0, 0.0, '../../first'))
    assert (len(started), live.investigation.phase) == (1, 'failed')


@pytest.mark.component
def test_a_verb_that_fails_says_why(live: Live) -> None:
    job = jobs.VerbJob(
        live, lambda: live.discovery, lambda found: setattr(live, 'discovery', found)
    )
    job.start(['discovr'], lambda: pytest.fail('it has no outcome'))
    assert live.discovery.busy
    end = time.monotonic() + 60.0
    while live.discovery.busy and time.monotonic() < end:
        job.watch()
    assert live.discovery.phase == 'failed'
    assert live.discovery.text.startswith('there is no verb discovr')


def test_the_journal_gives_the_beliefs_before_the_first_experiment_and_after_each(
    tmp_path: Path,
) -> None:
    journal = tmp_path / 'journal.jsonl'
    assert jobs.states_of(journal) == []
    line = {
        'number': 1, 'experiment': 'sine 33 Hz', 'why': 'has a chance', 'answer': 'creep',
        'before': {'chances': {'none': 0.5}}, 'after': {'chances': {'creep': 0.9}}, 'spent': 1.6,
    }  # fmt: skip
    journal.write_text(f'{json.dumps({"investigation": 1})}\n{json.dumps(line)}\n')
    first, second = jobs.states_of(journal)
    assert (first.number, first.chances, first.seconds) == (0, (('none', 0.5),), 0.0)
    assert (second.answer, second.chances, second.seconds) == ('creep', (('creep', 0.9),), 1.6)
