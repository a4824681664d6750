"""Nodes that the fault campaign does not kill: they die while the others run, and come back."""

from __future__ import annotations

import signal
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.records import Record, write_bag
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_interfaces.msg import ActuatorState

pytestmark = pytest.mark.ros

SLEW = 20.0
RATE = 200.0


class Loop:
    """A loop in real time with its controllers in one process, and what else there is."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.processes, self.listener, self.folder = processes, listener, folder
        self.health = listener.watch_health()
        self.states = listener.listen(ActuatorState, 'actuator/state')
        rate = {'rate': RATE}
        ramp = {'ramp': 5.0}  # no command_slew: the links tell theirs
        processes.start('piezo_sim', 'simulator', {**rate, **ramp, 'command_timeout': 0.5})
        self.links = self.start_links()
        self.moves()

    def start_links(self) -> NodeProcess:
        """Start the controllers; each of the nodes inside gets the same settings."""
        own = {'rate': RATE, 'limits.slew': SLEW, 'watchdog': 0.5}
        drive = {'mode': 'reference', 'frequency': 1.0, 'reference.amplitude': 5e-5}
        drive['deadline'] = 3600.0
        reference = {f'excitation:{name}': value for name, value in drive.items()}
        return self.processes.start('piezo_hysteresis', 'control_loop', {**own, **reference})

    def kill(self, node: NodeProcess) -> None:
        node.signal(signal.SIGKILL)
        self.processes.retire(node)

    def moves(self) -> None:
        """Wait until the voltage follows the reference again, up and down."""
        count = len(self.states)

        def tracks() -> bool:
            voltages = [state.voltage for state in self.states[count:]]
            return bool(voltages) and max(voltages) > 0.3 and min(voltages) < -0.3

        self.listener.until(tracks)

    def safe(self) -> None:
        """Check every change of the applied voltage so far."""
        samples = np.array([state.sample for state in self.states])
        voltage = np.array([state.voltage for state in self.states])
        steps = np.abs(np.diff(voltage)) / np.diff(samples)
        assert steps.max() <= SLEW / RATE * (1 + 1e-9)
        assert np.all(np.diff(samples) > 0)


@pytest.fixture(scope='module')
def loop(
    shared_processes: LiveNodes,
    shared_listener: Listener,
    tmp_path_factory: pytest.TempPathFactory,
) -> Loop:
    folder = tmp_path_factory.mktemp('restarts')
    time = np.arange(20_000) * 1e-3
    write_bag(folder / 'bag', [Record('r', 1e-3, np.sin(9 * time), 1e-4 * np.sin(9 * time))])
    return Loop(shared_processes, shared_listener, folder)


def test_controllers_in_one_process_die_and_come_back(loop: Loop) -> None:
    loop.kill(loop.links)
    loop.listener.says(loop.health, 'simulator', DiagnosticStatus.ERROR, 'no commands')
    loop.listener.until(lambda: loop.states[-1].voltage == 0.0)
    loop.links = loop.start_links()
    loop.moves()
    loop.safe()


def test_commands_that_come_late_move_nothing_faster_than_the_slew_of_the_links(
    loop: Loop,
) -> None:
    before = len(loop.states)
    for _ in range(8):
        loop.links.signal(signal.SIGSTOP)
        loop.listener.serve(0.09)  # shorter than any watchdog
        loop.links.signal(signal.SIGCONT)
        loop.listener.serve(0.12)
    voltage = np.array([state.voltage for state in loop.states[before:]])
    # held meanwhile, so that what comes after would be a jump
    assert np.count_nonzero(np.diff(voltage) == 0.0) > 8 * 10
    loop.moves()
    loop.safe()


def test_voltages_of_the_excitation_keep_the_slew_of_the_links(loop: Loop) -> None:
    """The excitation has no limit of its own here; its sine is five times as fast as theirs."""
    count = len(loop.states)

    def limited() -> bool:
        steps = np.abs(np.diff([state.voltage for state in loop.states[count:]]))
        return bool(np.count_nonzero(steps > 0.999 * SLEW / RATE) > 100)

    for name, value in {'voltage.amplitude': 0.8, 'frequency': 20.0, 'mode': 'voltage'}.items():
        assert loop.listener.set_one('excitation', name, value) == ''
    loop.listener.until(limited)
    for name, value in {'mode': 'reference', 'frequency': 1.0}.items():
        assert loop.listener.set_one('excitation', name, value) == ''
    loop.moves()
    loop.safe()


def test_a_player_dies_and_the_next_one_plays_to_the_end(loop: Loop) -> None:
    names = ('actuator/state', 'record/marker')
    remap = {f'/piezo/{name}': name for name in names}
    settings = {'bag': str(loop.folder / 'bag'), 'lock_step': True, 'wait': 60.0}
    receiver = loop.processes.start('piezo_hysteresis', 'identification', namespace='apart')
    first = loop.processes.start(
        'piezo_hysteresis', 'player', settings, namespace='apart', remap=remap
    )
    loop.listener.says(loop.health, 'apart/player', DiagnosticStatus.OK, 'plays')
    loop.kill(first)
    second = loop.processes.start(
        'piezo_hysteresis', 'player', settings, namespace='apart', remap=remap
    )
    assert loop.processes.wait_for(second, 120.0) == 0
    assert 'played 20000 samples' in second.tail()
    assert receiver.returncode is None
    loop.processes.retire(second)
    loop.processes.retire(receiver)


def test_a_dashboard_dies_and_serves_again_at_the_same_place(loop: Loop) -> None:
    def start(port: int) -> tuple[NodeProcess, str]:
        settings = {'port': port, 'folder': str(loop.folder)}
        node = loop.processes.start('piezo_hysteresis', 'dashboard', settings)
        loop.listener.until(lambda: 'http://' in node.log.read_text())
        return node, node.log.read_text().partition('open ')[2].split()[0]

    def answers(url: str) -> None:
        with urllib.request.urlopen(url, timeout=60) as page:
            assert page.status == 200

    first, url = start(0)
    loop.kill(first)
    second, again = start(int(url.rstrip('/').rpartition(':')[2]))
    assert again == url
    answers(url)
    loop.processes.retire(second)


def test_nothing_of_all_this_moved_the_actuator(loop: Loop) -> None:
    loop.moves()
    loop.safe()
