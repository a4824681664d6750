"""The last deadline of a process holds also where Python is locked."""

from __future__ import annotations

import subprocess
import sys

import pytest

HANGS = """
import ctypes
from piezo_hysteresis.ros.running import EndsWithin
with EndsWithin(0.3, {code}):
    ctypes.PyDLL(None).sleep(60)  # holds the lock of Python
"""
ENDS = """
import time
from piezo_hysteresis.ros.running import EndsWithin
with EndsWithin(0.3, 3):
    pass
time.sleep(0.6)
print('ended by itself')
"""


@pytest.mark.parametrize('code', [0, 2])
def test_a_process_that_hangs_ends_with_its_exit_code(code: int) -> None:
    ended = subprocess.run([sys.executable, '-c', HANGS.format(code=code)], timeout=30)
    assert ended.returncode == code


def test_nothing_happens_to_one_that_is_done_before() -> None:
    ended = subprocess.run(
        [sys.executable, '-c', ENDS], timeout=30, capture_output=True, text=True
    )
    assert ended.returncode == 0
    assert 'ended by itself' in ended.stdout
