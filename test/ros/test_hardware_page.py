"""The driver in docs/hardware.md runs as it stands there and closes the loop."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes
from rclpy.action import ActionClient

from piezo_hysteresis.common.stamps import nanoseconds_of
from piezo_hysteresis.ros.qos import LOOP
from piezo_interfaces.action import RunSweep
from piezo_interfaces.msg import ActuatorState, RecordMarker, VoltageCommand

pytestmark = pytest.mark.ros

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'hardware.md'
LATE = 2000  # ticks by which commands may be late on a busy machine
RATE, SLEW, RAMP = 1000.0, 200.0, 1.0  # of it [Hz]; at most, and without commands [V/s]


def run_a_sweep(listener: Listener) -> list[RecordMarker]:
    """Run one record of 3000 ticks; return its markers."""
    markers = listener.listen(RecordMarker, 'record/marker')
    listener.matched('record/marker')
    client = ActionClient(listener.node, RunSweep, 'run_sweep')
    listener.until(client.server_is_ready)
    listener.found_by('excitation')
    assert listener.set_one('excitation', 'marker_listeners', 1) == ''
    goal = RunSweep.Goal(frequencies=[5.0], amplitudes=[0.5], seconds=3.0)
    accepted = client.send_goal_async(goal)
    listener.until(accepted.done)
    finished = accepted.result().get_result_async()
    listener.until(finished.done)
    assert finished.result().result.success, finished.result().result.message
    listener.until(lambda: len(markers) == 2)
    client.destroy()
    return markers


def start_driver(
    page: Path, folder: Path, processes: LiveNodes, listener: Listener
) -> subprocess.Popen[bytes]:
    """Run the first Python block of a page as it stands there."""
    code = re.search(r'```python\n(.*?)```', page.read_text(), re.DOTALL)
    assert code
    (folder / 'driver.py').write_text(code.group(1))
    listener.listen(ActuatorState, 'actuator/state')
    words = [sys.executable, str(folder / 'driver.py')]
    return subprocess.Popen(words, env=processes.environment, stderr=subprocess.DEVNULL)


def test_a_driver_refuses_what_is_no_number_and_turns_every_jump_into_a_ramp(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    driver = start_driver(PAGE, tmp_path, processes, listener)
    try:
        refuses_and_ramps(listener, SLEW / RATE, RAMP / RATE)
    finally:
        driver.send_signal(signal.SIGINT)
        driver.wait(10)


def refuses_and_ramps(listener: Listener, step: float, ramp: float) -> None:
    """Command a jump, then what is no number, then nothing."""
    states = listener.received['actuator/state']
    publisher = listener.node.create_publisher(VoltageCommand, 'voltage/command', LOOP)
    listener.until(lambda: states and publisher.get_subscription_count() > 0)
    ticks = 0

    def command(voltage: float, often: int, ready: Callable[[], bool] = bool) -> None:
        first = ticks

        def again() -> bool:
            nonlocal ticks
            ticks += 1
            publisher.publish(VoltageCommand(sample=ticks, voltage=voltage))
            return ticks > first + often or ready()

        listener.until(again)

    command(1.0, 10_000, lambda: states[-1].voltage == 1.0)
    begin = len(states)
    for wrong in (math.nan, math.inf, -math.inf):
        command(wrong, 20)
    listener.until(lambda: states[-1].voltage == 0.0)
    samples = np.array([state.sample for state in states])
    voltage = np.array([state.voltage for state in states])
    assert np.all(np.isfinite(voltage))
    change = np.diff(voltage) / np.diff(samples)
    assert np.max(np.abs(change)) <= step * (1.0 + 1e-9)
    assert -ramp * (1.0 + 1e-9) <= change[begin:].min() < 0.0
    assert change[begin:].max() <= 0.0


def test_the_driver_of_the_page_serves_an_excitation(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    driver = start_driver(PAGE, tmp_path, processes, listener)
    try:
        settings = {'mode': 'voltage', 'frequency': 5.0, 'voltage.amplitude': 3.0, 'ramp': 0.1}
        states = listener.received['actuator/state']
        processes.start('piezo_hysteresis', 'excitation', settings)
        listener.until(lambda: any(abs(s.voltage) == 1.2 for s in states), 60.0)
        received = len(states)
        listener.until(lambda: len(states) > received + 300)
        assert listener.set_one('excitation', 'mode', 'idle') == ''
        # Silence takes the driver to rest as well, before commands that are late.
        listener.until(lambda: not any(state.voltage for state in states[-LATE:]))
        markers = run_a_sweep(listener)
    finally:
        driver.send_signal(signal.SIGINT)
        driver.wait(10)
    # Markers are told in the time of the driver, whatever clock it stamps with.
    start, end = (nanoseconds_of(marker.header.stamp) for marker in markers)
    marked = [s for s in states if start <= nanoseconds_of(s.header.stamp) < end]
    assert markers[0].frequency == 5.0
    # in ticks of the driver, of which a busy listener loses some; edges lie between ticks
    assert (end - start) * 1e-6 == pytest.approx(3000.0, abs=5.0)
    assert max(abs(state.voltage) for state in marked[LATE:-5]) == pytest.approx(0.5, rel=1e-3)
    voltage = np.array([state.voltage for state in states])
    assert np.max(np.abs(voltage)) == 1.2  # the driver's own limit
    samples = np.array([state.sample for state in states])
    assert np.all(np.diff(samples) >= 1)
    assert np.max(np.abs(np.diff(voltage)) / np.diff(samples)) <= SLEW / RATE * (1.0 + 1e-9)
    # displacement of tick k answers the voltage of tick k - 1
    next_to = np.diff(samples) == 1
    displacement = np.array([state.displacement for state in states])
    np.testing.assert_allclose(displacement[1:][next_to], 1.3e-4 * voltage[:-1][next_to])


AMPLIFIER = 'of the amplifier to `voltage` in V."""\n'


@pytest.mark.parametrize(
    ('page', 'own', 'high'),
    [
        ('LOW, HIGH, SAFE = -1.2, 1.2, 0.0', 'LOW, HIGH, SAFE = -1, 1, 0', 1.0),
        ('return 1.3e-4 * voltage', 'return __import__("numpy").float32(1.3e-4 * voltage)', 1.2),
    ],
)
def test_the_driver_takes_any_type_of_number(
    page: str, own: str, high: float, processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    """Integers as limits and a sensor in float32; the amplifier is at SAFE after Ctrl-C."""
    text = PAGE.read_text()
    assert page in text
    log = f"    open({str(tmp_path / 'amplifier')!r}, 'w').write(str(voltage))\n"
    text = text.replace(page, own).replace(AMPLIFIER, AMPLIFIER + log)
    (tmp_path / 'page.md').write_text(text)
    driver = start_driver(tmp_path / 'page.md', tmp_path, processes, listener)
    states = listener.received['actuator/state']
    commands = listener.node.create_publisher(VoltageCommand, 'voltage/command', LOOP)

    def arrived() -> bool:
        commands.publish(VoltageCommand(voltage=5.0))
        assert driver.poll() is None
        return bool(states) and states[-1].voltage == high

    listener.until(arrived)
    listener.until(lambda: states[-1].displacement == pytest.approx(1.3e-4 * high, rel=1e-6))
    driver.send_signal(signal.SIGINT)
    assert driver.wait(30.0) == 0
    assert float((tmp_path / 'amplifier').read_text()) == 0.0


def test_the_driver_in_lock_step_answers_every_command(
    processes: LiveNodes, listener: Listener, tmp_path: Path
) -> None:
    """The second block of the page, inserted where that says."""
    driver, lock_step = re.findall(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL)
    assert driver.count('# Ctrl-C') == driver.count('driver = Driver()') == 1
    driver = driver.replace('# Ctrl-C', f'{lock_step}\n\n# Ctrl-C')
    driver = driver.replace('driver = Driver()', 'driver = LockStepDriver()')
    (tmp_path / 'page.md').write_text(f'```python\n{driver}```')
    process = start_driver(tmp_path / 'page.md', tmp_path, processes, listener)
    states = listener.received['actuator/state']
    try:
        settings = {'rate': RATE, 'mode': 'voltage', 'frequency': 5.0, 'voltage.amplitude': 0.8}
        processes.start('piezo_hysteresis', 'excitation', settings)
        listener.until(lambda: len(states) > 1400, 60.0)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(10)
    samples = np.array([state.sample for state in states])
    assert np.all(np.diff(samples) == 1)
    expected = 0.8 * np.sin(2.0 * np.pi * 5.0 * samples / RATE)
    voltage = np.array([state.voltage for state in states])
    np.testing.assert_allclose(voltage[samples > 1100], expected[samples > 1100], atol=1e-9)
