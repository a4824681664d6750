"""The client libraries of the makers drive our simulated controllers as they drive real ones."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from test_drivers_gcs import RATE, served, serving

CLIENTS = Path(__file__).parents[1] / 'clients'
PYTHON = CLIENTS.parents[1] / '.venv-clients/bin/python'

pytestmark = pytest.mark.skipif(
    not PYTHON.with_name('pip').exists(),
    reason='the clients of the makers are not installed: run "make clients" (Python 3.12)',
)


def responses_of(script: str, address: str) -> dict[str, Any]:
    """Return the responses that a client got from a controller."""
    words = [str(PYTHON), '-I', str(CLIENTS / script), address]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_pipython_of_pi_drives_the_simulated_controller() -> None:
    with serving(speed=1.0) as server:
        low, high = (1e6 * end for end in server.controller.travel)  # computed before it is asked
        found = responses_of('gcs_client.py', str(server.server_address[1]))
    assert found['axes'] == ['1']
    assert found['range'] == [-5.0, 5.0]
    assert found['period'] == found['sample_time'] == 1.0 / RATE
    assert found['records'] is True
    assert found['generators'] == 1
    assert found['travel'] == pytest.approx([low, high])
    assert 'Current Position' in found['options']
    assert found['unit'] == 'UM'
    assert found['recorded'] == [{'1': ['1', 2]}, {'2': ['1', 7]}]
    assert found['off'] < 5e-9
    assert found['position'] == pytest.approx(20.0, abs=0.005 * (high - low))


@pytest.mark.parametrize('kind', ['nv200', 'nv200_telnet'])
def test_nv200_of_piezosystem_jena_drives_the_simulated_amplifier(kind: str) -> None:
    with served(kind, speed=1.0) as (address, controller):
        low, high = (1e6 * end for end in controller.travel)
        found = responses_of('nv200_client.py', address.removeprefix('nv200://'))
    assert found['range'] == [-5.0, 5.0]
    assert found['unit'] == 'um'
    assert found['has_sensor'] is True
    assert found['is_closed'] is False
    assert found['settings'] > 5
    assert found['voltage'] == 1.5
    assert found['off'] < 1e-6
    assert found['position'] == pytest.approx(20.0, abs=0.005 * (high - low))
