"""What live tests of `investigate` share: an actuator that creeps and a model that does not."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.models import named
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_interfaces.msg import ActuatorState
from piezo_sim.sweep import grid, simulate

PRESET = 'generic_bouc_wen'
RATE, REACH, SLEW = 1000.0, 1.0, 700.0
TIMEOUT = 240.0
# A loop in lock-step that makes no tick for so long stands [s].
STILL = 2.0
LIMITS = {'low': -REACH, 'high': REACH, 'slew': SLEW, 'budget': 60.0}


def write_model(folder: Path) -> Path:
    """Identify the actuator as it was; return the file."""
    specs = grid('sine', [1.0, 5.0, 20.0, 50.0], [1.0, 0.5], {'duration': 2.5, 'ramp': 0.2})
    records = simulate(PRESET, specs, {}, 1)
    identify(records, named('classical')).model.save(folder / 'model.yaml')
    return folder / 'model.yaml'


class Bench:
    """A loop in lock-step; every state of the actuator is kept."""

    def __init__(self, processes: LiveNodes, listener: Listener, model: Path) -> None:
        self.processes, self.listener, self.model = processes, listener, model
        self.folder = model.parent
        self.states: list[ActuatorState] = listener.listen(ActuatorState, 'actuator/state')
        self.start('simulator')
        self.start('gap_monitor')
        self.start('excitation')
        self.output = self.folder / 'output.txt'

    def start(self, name: str) -> NodeProcess:
        """Start a node with the settings that it has here."""
        model: dict[str, object] = {'model_file': str(self.model)}
        world = {'clock': 'lock_step', 'preset': PRESET, 'effects.creep': True, 'wait_for': 2}
        settings: dict[str, dict[str, object]] = {
            'simulator': world,
            'gap_monitor': model,
            'feedforward': model,
            'excitation': {'actuator': PRESET, 'folder': str(self.folder)},
        }
        return self.processes.start(package_of(name), name, settings[name])

    def investigate(self, **limits: float) -> subprocess.Popen[str]:
        """Start the verb; return its process."""
        options = [f'--{name}={value!r}' for name, value in {**LIMITS, **limits}.items()]
        verb = [sys.executable, '-m', 'piezo_hysteresis', 'investigate', '--out', 'out']
        with self.output.open('w') as file:
            self.verb = subprocess.Popen(
                [*verb, '--model', str(self.model), *options],
                env=self.processes.environment, stdout=file, stderr=file, text=True,
            )  # fmt: skip
        return self.verb

    def ended(self, verb: subprocess.Popen[str]) -> tuple[int, str]:
        """Return the exit code of a verb, and what it printed."""
        self.listener.until(lambda: verb.poll() is not None, timeout=TIMEOUT)
        return int(verb.returncode), self.output.read_text()

    def interrupted(self, verb: subprocess.Popen[str]) -> None:
        """Interrupt a verb as Ctrl-C does; check that it leaves the actuator at rest."""
        verb.send_signal(signal.SIGINT)
        code, printed = self.ended(verb)
        assert code != 0
        assert 'at rest' in printed
        self.rests()

    def begun(self, number: int) -> None:
        """Wait until an experiment has begun."""
        self.listener.until(
            lambda: f'\n{number}. ' in f'\n{self.output.read_text()}', timeout=TIMEOUT
        )

    def result(self) -> dict[str, Any]:
        """Return the summary of the investigation."""
        return dict(json.loads((self.folder / 'out' / 'investigation.json').read_text()))

    def moves(self) -> None:
        """Wait until the actuator is driven far from rest."""
        count = len(self.states)

        def driven() -> bool:
            assert self.verb.poll() is None, self.output.read_text()
            return any(abs(state.voltage) > 0.5 * REACH for state in self.states[count:])

        self.listener.until(driven, timeout=TIMEOUT)

    def rests(self) -> None:
        """Wait until the actuator is at rest and no node drives it."""
        seen = [(len(self.states), time.monotonic())]

        def still() -> bool:
            if seen[-1][0] != len(self.states):
                seen.append((len(self.states), time.monotonic()))
            return time.monotonic() - seen[-1][1] > STILL

        self.listener.until(still)
        assert abs(self.states[-1].voltage) < 1e-3

    def safe(self) -> None:
        """Check that no voltage and no change of it ever was beyond the limits."""
        sample = np.array([state.sample for state in self.states], dtype=np.int64)
        voltage = np.array([state.voltage for state in self.states])
        assert np.abs(voltage).max() <= REACH + 1e-9
        follows = np.diff(sample) == 1  # an actuator that was started anew counts anew, from 0 V
        assert np.count_nonzero(~follows) <= np.count_nonzero(sample == 0)
        change = np.abs(np.diff(voltage))[follows] * RATE
        assert change.max() <= SLEW * (1.0 + 1e-9)
