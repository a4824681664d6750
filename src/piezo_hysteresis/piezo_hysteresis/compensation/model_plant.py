"""An identified model instead of the actuator, for studies without hardware."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.chain import Model


class ModelPlant:
    """Answers voltages with the displacement of a model, one tick at a time.

    Parameters
    ----------
    model : Model
        Chain of blocks.
    values : mapping of str to float
        Its parameters, SI units.
    dt : float
        Sampling interval [s].
    noise : float
        Rms of white measurement noise [m].
    seed : int
        Seed of the noise.
    """

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float],
        dt: float,
        *,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._model = model
        self._packed = model.pack(values)
        self._dt = dt
        self._noise = noise
        self._seed = seed
        self._voltage = np.zeros(1)
        self.reset()

    def reset(self) -> None:
        """Return to rest and restart the noise."""
        self._state = self._model.initial_state(self._dt)
        self._random = np.random.default_rng(self._seed)

    def exchange(self, voltage: float) -> float:
        """Apply `voltage` [V] for one tick; return the displacement of the tick [m]."""
        self._voltage[0] = voltage
        response = self._model.respond(self._voltage, self._packed, self._dt, state=self._state)
        displacement = float(response[0])
        if self._noise > 0.0:
            displacement += self._noise * float(self._random.standard_normal())
        return displacement


_NUMBER = struct.Struct('<d')
_REST = _NUMBER.pack(float('nan'))
_TIMEOUT = 10.0  # for it to end [s]


class ProcessPlant:
    """Plant in a separate program that returns a displacement for each voltage.

    The program writes one line of JSON about itself, then for every double that it reads (eight
    bytes, the lowest first) the displacement [m] before that voltage [V] acts. A voltage that is
    no number means: back to rest.
    """

    def __init__(self, command: Sequence[str]) -> None:
        try:
            self._process = subprocess.Popen(
                list(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )  # fmt: skip
        except OSError as error:
            raise CompensationError(f'the plant cannot be started: {reason_of(error)}') from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._in, self._out = self._process.stdin, self._process.stdout
        try:
            self.about: Mapping[str, Any] = json.loads(self._out.readline())
        except ValueError:
            raise CompensationError(f'the plant cannot be started: {self._last()}') from None

    def exchange(self, voltage: float) -> float:
        """Apply `voltage` [V] for one tick; return the displacement before it acts [m]."""
        return float(_NUMBER.unpack(self.ask(_NUMBER.pack(voltage), _NUMBER.size))[0])

    def reset(self) -> None:
        """Return the plant to rest and restart its noise."""
        self.ask(_REST, _NUMBER.size)

    def ask(self, given: bytes, size: int) -> bytes:
        """Return an answer of `size` bytes."""
        try:
            self._in.write(given)
            self._in.flush()
        except OSError:
            raise CompensationError(f'the plant has ended: {self._last()}') from None
        answer = self._out.read(size)
        if len(answer) < size:
            raise CompensationError(f'the plant has ended: {self._last()}')
        return answer

    def _last(self) -> str:
        """Return the last line that the program printed, without the prefix of errors."""
        self._process.kill()
        _, output = self._process.communicate()
        lines = output.decode('utf-8', 'replace').strip().splitlines()
        return lines[-1].removeprefix('error: ') if lines else 'no output'

    def close(self) -> None:
        """End the program."""
        if self._process.poll() is None:
            self._in.close()
            try:
                self._process.wait(_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for stream in (self._out, self._process.stderr):
            if stream is not None:
                stream.close()


def simulated(
    preset: str, rate: float, seed: int = 0, settings: Sequence[str] = ()
) -> ProcessPlant:  # rate [Hz]
    """Return the simulated actuator of a preset, in a separate process."""
    return ProcessPlant(command_of(preset, rate, seed, settings))


def command_of(preset: str, rate: float, seed: int, settings: Sequence[str]) -> list[str]:
    """Return the command of a separate program that simulates a preset."""
    command = ['plant', '--preset', preset, '--rate', repr(rate), '--seed', str(seed)]
    for setting in settings:
        command += ['--set', setting]
    return [sys.executable, '-m', 'piezo_sim', *command]
