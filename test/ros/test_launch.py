"""The launch files with the real `ros2 launch`, where it is installed."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from listening import Listener
from std_msgs.msg import Header

from piezo_hysteresis.records import read_bag
from piezo_hysteresis.ros.processes import NodeProcesses
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.msg import ActuatorState, LoopStatus

pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(
        any(importlib.util.find_spec(name) is None for name in ('ros2launch', 'launch_ros')),
        reason='ros2 launch is not installed',
    ),
]

ROS2 = [sys.executable, '-c', 'from ros2cli.cli import main; exit(main())']


def launch(
    processes: NodeProcesses, log: Path, file: str, *arguments: str
) -> subprocess.Popen[bytes]:
    with log.open('wb') as output:
        return subprocess.Popen(
            [*ROS2, 'launch', 'piezo_hysteresis', file, *arguments],
            env={**processes.environment, 'ROS_LOG_DIR': str(log.parent)},
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def end(launched: subprocess.Popen[bytes], log: Path) -> None:
    """Press Ctrl-C: everybody in the group gets it, and launch sends it once more."""
    os.killpg(launched.pid, signal.SIGINT)
    assert launched.wait(60.0) == 0, log.read_text()
    text = log.read_text()
    assert 'Traceback' not in text
    assert 'process has died' not in text


def test_stages_run_side_by_side_and_end_on_ctrl_c(
    processes: NodeProcesses, listener: Listener, tmp_path: Path
) -> None:
    log = tmp_path / 'launch.log'
    received = [listener.listen(ActuatorState, f'{stage}/actuator/state') for stage in 'xy']
    launched = launch(
        processes, log, 'stages.launch.py', 'stages:=x,y=zhou_tef', 'identification:=false'
    )
    try:
        # The reference moves both: their links are there too.
        listener.until(
            lambda: all(any(s.voltage != 0.0 for s in states) for states in received), 120
        )
        assert listener.get_parameter('x/simulator', 'preset') == 'fdk_pzba_00030'
        assert listener.get_parameter('y/simulator', 'preset') == 'zhou_tef'
    finally:
        end(launched, log)


def test_the_recorder_of_one_actuator_is_launched_and_finishes_its_bag(
    processes: NodeProcesses, listener: Listener, tmp_path: Path
) -> None:
    log = tmp_path / 'launch.log'
    publisher = listener.node.create_publisher(ActuatorState, 'stage_x/actuator/state', LOOP)
    status = listener.listen(LoopStatus, 'stage_x/recorder/status', latched=True)
    words = [f'out:={tmp_path / "my_bag"}', 'namespace:=stage_x']
    launched = launch(processes, log, 'record.launch.py', *words)
    try:
        listener.until(lambda: publisher.get_subscription_count() > 0, 120.0)
        for k in range(100):
            publisher.publish(ActuatorState(sample=k, voltage=0.01 * k, header=stamped(k)))
        listener.until(lambda: any(message.sample >= 100 for message in status))
    finally:
        end(launched, log)
    (record,) = read_bag(tmp_path / 'my_bag')
    np.testing.assert_array_equal(record.voltage, 0.01 * np.arange(100))


def stamped(sample: int) -> Header:
    return Header(stamp=Time(nanosec=sample * 1_000_000))


def test_a_scenario_that_is_not_there_is_named(processes: NodeProcesses, tmp_path: Path) -> None:
    log = tmp_path / 'launch.log'
    launched = launch(processes, log, 'loop.launch.py', 'scenario:=no_such')
    assert launched.wait(60.0) != 0
    assert 'scenario:=no_such is not there' in log.read_text()
    assert 'tracking' in log.read_text()


def test_several_axes_are_refused_with_the_verb_that_starts_them(
    processes: NodeProcesses, tmp_path: Path
) -> None:
    """The loop of one axis ran with the simulator of two, and nothing was commanded."""
    log = tmp_path / 'launch.log'
    launched = launch(processes, log, 'loop.launch.py', 'preset:=xy_scanner')
    assert launched.wait(60.0) != 0
    assert 'preset:=xy_scanner is of several axes' in log.read_text()
    assert 'piezo_hysteresis loop --preset' in log.read_text()
