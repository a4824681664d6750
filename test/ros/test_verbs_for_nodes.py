"""The verbs that run nodes and speak to them, where there is no ros2 command."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest
import yaml
from live_nodes import LiveNodes
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from piezo_hysteresis.cli.main import main

pytestmark = pytest.mark.ros


@pytest.fixture(scope='module')
def excitation() -> Any:
    with LiveNodes() as processes:
        processes.start('piezo_hysteresis', 'excitation', namespace='stage')
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv('ROS_DOMAIN_ID', str(processes.domain))
            patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
            yield '/stage/excitation'


def said(capsys: Any, *words: Any) -> Any:
    """Run a verb; return its exit code and everything it said."""
    code = main(['param', *words, '--timeout', '60'])
    printed = capsys.readouterr()
    return code, printed.err if code else printed.out


def test_parameters_are_listed_read_set_and_refused(
    excitation: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, text = said(capsys, 'set', excitation, 'frequency', '14')
    assert (code, text.strip()) == (0, f'{excitation} frequency is 14')
    assert said(capsys, 'get', excitation, 'frequency') == (0, '14.0\n')
    code, text = said(capsys, 'set', excitation, 'waveform_options', '{seed: 3}')
    assert code == 2
    assert "no setting 'seed'" in text  # it has read the mapping as one
    code, text = said(capsys, 'list')
    assert excitation in text.splitlines()
    code, text = said(capsys, 'list', excitation)
    assert 'frequency: 14.0' in text.splitlines()
    assert yaml.safe_load(text)['mode'] == 'idle'
    file = tmp_path / 'params.yaml'
    values = {'frequency': 3.0, 'reference': {'amplitude': 1.0e-5}}
    file.write_text(yaml.safe_dump({'/**/excitation': {'ros__parameters': values}}))
    assert said(capsys, 'load', excitation, str(file))[0] == 0
    assert said(capsys, 'get', excitation, 'reference.amplitude') == (0, '1.0e-05\n')


def test_a_request_whose_answer_is_lost_is_repeated(
    excitation: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lost: list[Future] = []

    class Lossy(AsyncParameterClient):
        def set_parameters(self, *given: Any, **named: Any) -> Future:
            if not lost:
                lost.append(Future())
                return lost[0]
            return super().set_parameters(*given, **named)

    monkeypatch.setattr('piezo_hysteresis.nodes.parameter_client.AsyncParameterClient', Lossy)
    assert main(['param', 'set', excitation, 'frequency', '15', '--timeout', '10']) == 0
    capsys.readouterr()
    assert len(lost) == 1
    assert said(capsys, 'get', excitation, 'frequency') == (0, '15.0\n')


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        (('set', '/nobody', 'frequency', '1', '--timeout', '1'), 'there is no node /nobody'),
        (('get', '/stage/excitation', 'volume'), 'has no parameter volume'),
        (('set', '/stage/excitation', 'frequency', '1e9'), 'frequency'),
        (('set', '/stage/excitation', 'frequency'), 'write `param set /NODE NAME VALUE`'),
        (('load', '/stage/excitation', 'nothing.yaml'), 'cannot be read'),
    ],
)
def test_what_cannot_be_is_one_line(
    excitation: str, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], reason: str
) -> None:
    assert main(['param', *words]) == 2
    lines = capsys.readouterr().err.splitlines()
    (line,) = (each for each in lines if each.startswith('error: '))
    assert reason in line


def test_a_node_is_run_by_its_name() -> None:
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_hysteresis', 'node', 'attenuation', '--help'],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert 'orders' in done.stdout


def test_the_loop_serves_its_page_and_ends_whole(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_hysteresis', 'loop', '--port', str(port), '--folder',
         str(tmp_path)],
        stdout=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, 'ROS_DOMAIN_ID': '67'},
    )  # fmt: skip
    assert process.stdout is not None
    try:
        assert f'open http://localhost:{port}/' in process.stdout.readline()
        page = urllib.request.urlopen(f'http://127.0.0.1:{port}/', timeout=30).read().decode()
        assert re.search('<title>', page)
        children = _children(process.pid)
        assert len(children) == 4
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    end = time.monotonic() + 10.0
    while any(map(_lives, children)):
        assert time.monotonic() < end, 'a node outlives the loop'
        time.sleep(0.1)


def _children(pid: int) -> list[Any]:
    text = subprocess.run(['ps', '--ppid', str(pid), '-o', 'pid='], capture_output=True, text=True)
    return [int(word) for word in text.stdout.split()]


def _lives(pid: Any) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_sweep_and_the_life_cycle_are_called_from_the_command_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with LiveNodes() as processes:
        processes.start('piezo_sim', 'simulator', {'clock': 'lock_step'})
        processes.start('piezo_hysteresis', 'excitation', {'folder': str(tmp_path)})
        processes.start('piezo_hysteresis', 'attenuation')
        monkeypatch.setenv('ROS_DOMAIN_ID', str(processes.domain))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

        def called(*words: str) -> tuple[int, str, str]:
            code = main(['call', *words, '--timeout', '60'])
            printed = capsys.readouterr()
            return code, printed.out, printed.err

        sweep = '{frequencies: [20, 50], amplitudes: [1], seconds: 0.2, bag: swept}'
        code, text, _ = called('/run_sweep', sweep)
        assert code == 0
        assert yaml.safe_load(text)['names'] == ['sine_20Hz_1V', 'sine_50Hz_1V']
        assert (tmp_path / 'swept').is_dir()
        code, text, _ = called('/run_sweep', '{frequencies: [5], amplitudes: [100], seconds: 1}')
        assert code == 1
        assert 'ask for a smaller amplitude' in yaml.safe_load(text)['message']
        code, _, error = called('/run_sweep', '{frequencies: [5], amplitude: [1]}')
        assert (code, 'did you mean amplitudes' in error) == (2, True)
        code, _, error = called('/run_sweep', '{frequencies: 5}')
        assert (code, 'frequencies is sequence<double>, not 5' in error) == (2, True)
        assert called('/attenuation/change_state', '{transition: {label: deactivate}}')[0] == 0
        state = yaml.safe_load(called('/attenuation/get_state')[1])
        assert state['current_state']['label'] == 'inactive'
