"""A node that ends leaves nothing of the middleware to end beside the process."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from listening import Listener

from piezo_hysteresis.parameters.sheets import SHEETS
from piezo_hysteresis.records import Record, write_bag
from piezo_ros_common.processes import NodeProcesses

pytestmark = pytest.mark.ros

# Threads of the middleware that are left when Python has done its work. The watchdog of shared
# memory belongs to no participant.
RUNS = """
import atexit, pathlib, runpy, sys

@atexit.register
def tell():
    names = (path.read_text().strip() for path in pathlib.Path('/proc/self/task').glob('*/comm'))
    print('left:', *sorted(name for name in names if name.startswith('dds.')), flush=True)

sys.argv.pop(0)
runpy.run_path(sys.argv[0], run_name='__main__')
"""
OF_THE_PROCESS = 'dds.shm.wdog'


def test_no_participant_outlives_its_node(
    processes: NodeProcesses, listener: Listener, tmp_path: Path
) -> None:
    time = np.arange(500) * 1e-3
    write_bag(tmp_path / 'bag', [Record('r', 1e-3, np.sin(30 * time), 1e-4 * np.sin(30 * time))])
    parameters: dict[str, dict[str, object]] = {
        'recorder': {'out': tmp_path / 'recorded'},
        'player': {'bag': tmp_path / 'bag', 'loop': True},
        'dashboard': {'port': 0},
    }
    health = listener.watch_health()
    running = {}
    for name in ('simulator', *SHEETS):
        package = 'piezo_sim' if name == 'simulator' else 'piezo_hysteresis'
        path = Path(get_package_prefix(package)) / 'lib' / package / name
        given = [f'{key}:={value}' for key, value in parameters.get(name, {}).items()]
        options = [word for each in given for word in ('-p', each)]
        if name == 'control_loop':  # three nodes, with the names of those that run alone
            options += ['-r', '__ns:=/together']
        running[name] = subprocess.Popen(
            [sys.executable, '-c', RUNS, str(path), '--ros-args', *options],
            env=processes.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            text=True,
        )
    try:
        served = {'simulator', *SHEETS, 'together/feedback'} - {'control_loop'}
        listener.until(lambda: served <= set(health), 60.0)
        for process in running.values():
            process.send_signal(signal.SIGINT)
        for name, process in running.items():
            text = process.communicate(timeout=20.0)[0]
            assert process.returncode == 0, (name, text)
            left = text.rpartition('left:')[2].split()
            assert set(left) <= {OF_THE_PROCESS}, (name, text)
            assert 'left:' in text, (name, text)
    finally:
        for process in running.values():
            process.kill()
            process.wait()
