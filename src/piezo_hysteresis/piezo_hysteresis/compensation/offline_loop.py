"""The offline closed loop with a model as plant: the same links, without ROS."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import Guided, reason_of
from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
from piezo_hysteresis.compensation.link import Limits, Link, Measured, ReferencePoint
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.numerics.harmonics import line_amplitudes
from piezo_hysteresis.waveforms.waveform import Samples


class LoopPlant(Protocol):
    """Interface of a plant: voltage in, displacement measured before it acts out."""

    def exchange(self, voltage: float) -> float:
        """Apply `voltage` [V] for one tick; return the displacement before it acts [m]."""


@dataclass(frozen=True)
class LoopResult(Guided):
    """What a closed-loop run left behind.

    Attributes
    ----------
    dt : float
        Sampling interval [s].
    reference, voltage, displacement : ndarray, shape (n,)
        Desired displacement [m], voltage commanded behind the limiter [V], measured
        displacement [m].
    phase : ndarray, shape (n,)
        Accumulated phase of the reference [rad].
    link_voltages : ndarray, shape (links, n)
        What each link passed on [V].
    counters : dict of str to dict
        Counters of each link, by place and class, and of the ``limiter``.
    """

    _INSTEAD: ClassVar = {'voltage': 'u', 'displacement': 'y', 'time': 't'}

    dt: float
    reference: FloatArray
    voltage: FloatArray
    displacement: FloatArray
    phase: FloatArray
    link_voltages: FloatArray
    counters: dict[str, dict[str, int]]

    @property
    def error(self) -> FloatArray:
        """Measured minus desired displacement [m], shape (n,); minus Tatebatake 2017 (16)."""
        return self.displacement - self.reference

    @property
    def time(self) -> FloatArray:
        """Time of each sample [s], shape (n,)."""
        return np.arange(self.reference.size, dtype=np.float64) * self.dt


@dataclass(frozen=True)
class TrackingMetrics(Guided):
    """How well a run tracked.

    Attributes
    ----------
    rms, rms_without_mean, largest : float
        Of the tracking error [m]: rms with and without its mean, largest magnitude.
    mean : float
        Of the tracking error [m].
    harmonics : dict of int to float
        Amplitude of the error by order [m].
    """

    _INSTEAD: ClassVar = {'rms': 'rmse', 'rms_without_mean': 'std', 'largest': 'max peak'}

    rms: float
    rms_without_mean: float
    largest: float
    mean: float
    harmonics: dict[int, float]


def reference_points(samples: Samples, first: int = 0) -> Iterator[ReferencePoint]:
    """Yield the points of a sampled waveform; `first` is the number of the first tick."""
    rows = zip(
        samples.value.tolist(),
        samples.velocity.tolist(),
        samples.acceleration.tolist(),
        samples.frequency.tolist(),
        samples.phase.tolist(),
        strict=True,
    )
    for k, row in enumerate(rows, start=first):
        yield ReferencePoint(k, *row)


def closed_loop(
    reference: Samples | Sequence[ReferencePoint],
    links: Sequence[Link],
    plant: LoopPlant,
    limits: Limits,
    dt: float,
    energy: EnergyLimits | None = None,
) -> LoopResult:
    """Run the chain of links on a plant, tick by tick.

    At tick k the links get the reference of tick k and the measurement of tick k-1 (None at the
    first); the voltage behind the limiter goes to the plant, which answers the displacement
    measured at tick k, before that voltage acts. Processes in lock-step do exactly the same.

    Parameters
    ----------
    reference : Samples or sequence of ReferencePoint
        Reference displacement [m] with its derivatives.
    links : sequence of Link
        The chain; the first one receives 0 V.
    plant : LoopPlant
        ``exchange(voltage) -> displacement``.
    limits : Limits
        Range and slew of the command.
    dt : float
        Sampling interval [s].
    energy : EnergyLimits, optional
        Mean power of the command; without one there is no limit.

    Raises
    ------
    CompensationError
        If the reference is empty.
    """
    points = list(reference_points(reference) if isinstance(reference, Samples) else reference)
    if not points:
        raise CompensationError('the reference is empty; give at least one sample')
    limiter = Limiter(limits, dt, energy=energy)
    n = len(points)
    voltage, displacement = np.empty(n), np.empty(n)
    shares = np.empty((len(links), n))
    measured: Measured | None = None
    for k, point in enumerate(points):
        command = 0.0
        for row, link in enumerate(links):
            command = link.step(point, command, measured)
            shares[row, k] = command
        command = limiter.apply(command)
        voltage[k] = command
        displacement[k] = plant.exchange(command)
        measured = Measured(point.sample, command, float(displacement[k]))
    counters = {f'{i}_{_name(link)}': link.counters() for i, link in enumerate(links)}
    counters['limiter'] = limiter.counters()
    return LoopResult(
        dt=dt,
        reference=np.array([point.displacement for point in points]),
        voltage=voltage,
        displacement=displacement,
        phase=np.array([point.phase for point in points]),
        link_voltages=shares,
        counters=counters,
    )


def tracking_metrics(
    result: LoopResult,
    from_seconds: float = 0.0,
    to_seconds: float = np.inf,
    orders: Sequence[int] = (1, 2, 3, 5, 7),
) -> TrackingMetrics:
    """Measure a run between two times.

    Parameters
    ----------
    result : LoopResult
        The run.
    from_seconds, to_seconds : float
        Part that counts [s].
    orders : sequence of int
        Orders of the reference's fundamental whose amplitudes are fitted by least squares.

    Raises
    ------
    CompensationError
        If nothing is left between the two times.
    """
    part = slice(round(from_seconds / result.dt), round(min(to_seconds, 1e12) / result.dt))
    error, phase = result.error[part], result.phase[part]
    if error.size == 0:
        raise CompensationError(
            f'the run of {result.time[-1]:g} s has nothing behind {from_seconds:g} s; run longer'
        )
    turns = abs(phase[-1] - phase[0]) / (2 * np.pi)
    amplitudes: dict[int, float] = {}
    if turns >= 1.0 and error.size > 4 * len(orders):
        _, phasors = line_amplitudes(error, phase, orders)
        amplitudes = {order: float(abs(e)) for order, e in zip(orders, phasors, strict=True)}
    return TrackingMetrics(
        rms=float(np.sqrt(np.mean(error**2))),
        rms_without_mean=float(np.std(error)),
        largest=float(np.max(np.abs(error))),
        mean=float(np.mean(error)),
        harmonics=amplitudes,
    )


def _name(link: Link) -> str:
    """Return the kind of a link in words for reports, such as ``harmonic_attenuation``."""
    return re.sub(
        r'(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])', '_', type(link).__name__
    ).lower()


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
