"""The offline closed loop: the same links, one tick after another, without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import Guided
from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
from piezo_hysteresis.compensation.link import Limits, Link, Measured, ReferencePoint
from piezo_hysteresis.errors import CompensationError
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
