"""Programs of the suite keep linear algebra in one thread, unless the user sets it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

TOLD = 'import os; import {module}; print(os.environ["OPENBLAS_NUM_THREADS"])'


@pytest.mark.slow
@pytest.mark.parametrize(
    'module', ['piezo_hysteresis.cli.main', 'piezo_hysteresis.nodes.links.feedforward_node']
)
@pytest.mark.parametrize(('said', 'meant'), [(None, '1'), ('3', '3')])
def test_linear_algebra_works_in_the_thread_that_calls_it(
    module: str, said: str | None, meant: str
) -> None:
    environment = {k: v for k, v in os.environ.items() if k != 'OPENBLAS_NUM_THREADS'}
    if said is not None:
        environment['OPENBLAS_NUM_THREADS'] = said
    words = [sys.executable, '-c', TOLD.format(module=module)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [meant]
