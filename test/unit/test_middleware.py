"""The set-up of the middleware that comes with the nodes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import pytest

from piezo_hysteresis.ros.running import PROFILES, prepare, profiles

SPACE = 'http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles'

NODE = """
from piezo_hysteresis.ros.running import prepare
prepare()
import rclpy
rclpy.init()
rclpy.create_node('probe').destroy_node()
rclpy.shutdown()
"""


def test_a_file_of_the_user_stays_in_force(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PROFILES, raising=False)
    prepare()
    assert os.environ[PROFILES] == profiles()
    monkeypatch.setenv(PROFILES, 'mine.xml')
    prepare()
    assert os.environ[PROFILES] == 'mine.xml'


def test_fast_dds_3_gets_its_own_profiles(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    usual = Path(profiles('fastdds.xml')).read_text(encoding='utf-8')
    assert Path(profiles()).name == 'fastdds.xml'
    (tmp_path / 'lib').mkdir()
    (tmp_path / 'lib' / 'libfastdds.so.3.2').touch()
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    own = Path(profiles()).read_text(encoding='utf-8')
    assert own[own.index('<dds>') :] == usual[usual.index('<dds>') :].replace(
        'heartbeatPeriod>', 'heartbeat_period>'
    )


def _says(file: str) -> str:
    environment = {
        **os.environ,
        PROFILES: file,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_DOMAIN_ID': '101',
    }
    done = subprocess.run(
        [sys.executable, '-c', NODE], env=environment, capture_output=True, text=True, timeout=60.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.component
def test_the_middleware_understands_every_word_of_it(tmp_path: Path) -> None:
    assert 'XML' not in _says(profiles())
    assert 'XML' not in _says(profiles('fastdds_udp.xml'))
    wrong = tmp_path / 'wrong.xml'
    text = ElementTree.tostring(ElementTree.parse(profiles()).getroot(), encoding='unicode')
    wrong.write_text(text.replace('heartbeatPeriod', 'heartbeatPeriods'))
    assert 'XML' in _says(str(wrong))


def test_the_profiles_over_udp_differ_only_in_the_transport() -> None:
    trees = [ElementTree.parse(profiles(name)) for name in ('fastdds.xml', 'fastdds_udp.xml')]
    words = [Counter(ElementTree.tostring(e).strip() for e in t.iter(f'{{{SPACE}}}{name}'))
             for t in trees for name in ('builtin', 'times')]  # fmt: skip
    assert words[:2] == words[2:]
    assert all(words)
