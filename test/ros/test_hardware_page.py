"""The driver in docs/hardware.md runs as it stands there and closes the loop."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from listening import Listener

from piezo_interfaces.msg import ActuatorState
from piezo_ros_common.processes import NodeProcesses

pytestmark = pytest.mark.ros

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'hardware.md'


def test_the_driver_of_the_page_serves_an_excitation(
    processes: NodeProcesses, listener: Listener, tmp_path: Path
) -> None:
    code = re.search(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL)
    assert code
    (tmp_path / 'driver.py').write_text(code.group(1))
    listener.listen(ActuatorState, 'actuator/state')
    driver = subprocess.Popen(
        [sys.executable, str(tmp_path / 'driver.py')],
        env=processes.environment,
        stderr=subprocess.DEVNULL,
    )
    try:
        settings = {'mode': 'voltage', 'frequency': 5.0, 'voltage.amplitude': 3.0, 'ramp': 0.1}
        processes.start('piezo_hysteresis', 'excitation', settings)
        states = listener.heard['actuator/state']
        listener.until(lambda: any(abs(s.voltage) == 1.2 for s in states), 60.0)
        heard = len(states)
        listener.until(lambda: len(states) > heard + 300)
    finally:
        driver.send_signal(signal.SIGINT)
        driver.wait(10)
    voltage = np.array([state.voltage for state in states])
    assert np.max(np.abs(voltage)) == 1.2  # the driver's own limit
    samples = np.array([state.sample for state in states])
    assert np.all(np.diff(samples) >= 1)
    # displacement of tick k answers the voltage of tick k - 1
    next_to = np.diff(samples) == 1
    displacement = np.array([state.displacement for state in states])
    np.testing.assert_allclose(displacement[1:][next_to], 1.3e-4 * voltage[:-1][next_to])
