"""SROS 2 in earnest, where it is installed: a keystore, and nodes that must have an enclave."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.common import topics
from piezo_hysteresis.parameters.sheets import SHEETS
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import Reference

pytestmark = pytest.mark.ros

NO_SECURITY = "doesn't have the security libraries"


@pytest.fixture
def secured(started_processes: NodeProcesses, tmp_path: Path) -> NodeProcesses:
    """Make processes keep to a keystore with an enclave for the feedforward alone."""
    if importlib.util.find_spec('sros2') is None:
        pytest.skip('sros2 is not installed: no keystore can be made')
    keystore, enclave = str(tmp_path / 'keystore'), '/piezo/feedforward'
    for words in (['create_keystore', keystore], ['create_enclave', keystore, enclave]):
        subprocess.run(
            [
                sys.executable,
                '-c',
                'from ros2cli.cli import main; exit(main())',
                'security',
                *words,
            ],
            env={**os.environ, 'ROS_DOMAIN_ID': str(started_processes.domain)},
            check=True,
            capture_output=True,
            timeout=120,
        )
    started_processes.environment.update(
        ROS_SECURITY_KEYSTORE=keystore, ROS_SECURITY_ENABLE='true', ROS_SECURITY_STRATEGY='Enforce'
    )
    return started_processes


def test_a_node_keeps_to_its_enclave_or_does_not_start(secured: NodeProcesses) -> None:
    stranger = secured.start('piezo_sim', 'simulator', namespace='piezo')
    assert stranger.wait(60.0) == 2
    assert 'security' in stranger.log.read_text().lower()
    assert 'Traceback' not in stranger.log.read_text()
    secured.retire(stranger)

    secured.environment['ROS_SECURITY_ENCLAVE_OVERRIDE'] = '/piezo/feedforward'
    known = secured.start('piezo_hysteresis', 'feedforward', namespace='piezo')
    try:
        code: int | None = known.wait(15.0)
    except Exception:
        code = None
    text = known.log.read_text()
    assert 'Traceback' not in text
    if NO_SECURITY in text:
        assert code == 2
        secured.retire(known)
        pytest.skip('this middleware was built without security: the node refused to start')
    assert code is None, text


def test_a_feedforward_that_waits_for_its_reference_keeps_to_its_sheet(
    processes: LiveNodes, listener: Listener
) -> None:
    """It hears the actuator only then, so that a loop at work does not show it."""
    processes.start('piezo_hysteresis', 'feedforward')
    references = listener.node.create_publisher(Reference, topics.REFERENCE, LOOP)
    listener.until(references.get_subscription_count)
    references.publish(Reference(sample=0))

    def received() -> set[str]:
        return {
            name.strip('/')
            for name, _ in listener.node.get_subscriber_names_and_types_by_node('feedforward', '/')
        }

    def watches() -> bool:
        return 'feedforward' in listener.node.get_node_names() and topics.STATE in received()

    listener.until(watches)
    assert received() - {'clock', 'parameter_events'} <= set(SHEETS['feedforward'].subscribes)
