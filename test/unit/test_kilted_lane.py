"""The lane of ROS 2 Kilted in `.ci/kilted`: skipped with one line where it cannot run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bench.quick import ROOT


def lane(**environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(ROOT / '.ci' / 'kilted')],
        env={**os.environ, **environment}, capture_output=True, text=True, check=False,
        timeout=60.0,
    )  # fmt: skip


def test_another_python_skips_the_lane(tmp_path: Path) -> None:
    other = tmp_path / 'python3.13'
    other.write_text('#!/bin/sh\nexit 1\n')
    other.chmod(0o755)
    done = lane(PYTHON=str(other))
    assert done.returncode == 0, done.stderr
    assert done.stdout == f'kilted: skipped: {other} is not Python 3.11 or 3.12 with venv\n'


@pytest.mark.component
def test_without_the_wheels_the_lane_is_skipped(tmp_path: Path) -> None:
    done = lane(
        PYTHON=sys.executable, PIP_NO_INDEX='1', PIP_CONFIG_FILE=os.devnull,
        PIP_FIND_LINKS=str(tmp_path),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('kilted: skipped: there is no wheel of ros-rclpy')
    assert done.stdout.count('\n') == 1


def test_the_lane_is_a_job_of_the_workflow() -> None:
    workflow = ROOT / '.github' / 'workflows' / 'ci.yml'
    assert 'run: .ci/kilted' in workflow.read_text(encoding='utf-8')
