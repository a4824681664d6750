"""A few fixed worlds, examined blind by a process that gets the records alone.

The whole study with random worlds is ``studies/study.py simulated``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from piezo_hysteresis.records import write_bag
from piezo_sim.sweep import simulate

pytestmark = pytest.mark.slow

ANSWERS = json.loads((Path(__file__).parent / 'answers.json').read_text())


def plan() -> list[dict[str, Any]]:
    sines = [
        {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 3.0}
        for a, frequencies in ((1.0, (1, 3, 7, 14, 23, 40)), (0.5, (1, 7, 23, 40)))
        for f in frequencies
    ]
    return [*sines, {'kind': 'rest', 'duration': 3.0}]


@pytest.mark.parametrize('name', ANSWERS)
def test_a_blind_set(name: str, tmp_path: Path) -> None:
    answer = ANSWERS[name]
    records = simulate('generic_bouc_wen', plan(), answer['world'], answer['seed'], actuator='it')
    write_bag(tmp_path / 'set', records)
    done = subprocess.run(
        [
            *(sys.executable, '-m', 'piezo_hysteresis', 'discover', 'set'),
            *('--baseline', 'classical', '--out', 'verdict', '--workers', '2'),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    verdict = json.loads((tmp_path / 'verdict' / 'verdict.json').read_text())
    assert verdict['verdict'] == answer['verdict'], verdict['summary']
    assert {effect['name'] for effect in verdict['effects']} == set(answer['effects'])
    if answer['verdict'] == 'named':
        assert verdict['held_out']['after_in_floors'] < 1.2
        assert verdict['held_out']['before_in_floors'] > 3.0
    if answer['verdict'] == 'unknown':
        assert verdict['unexplained']['significant']
        assert len(verdict['unexplained']['description']) > 80
