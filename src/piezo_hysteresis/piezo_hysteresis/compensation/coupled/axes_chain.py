"""The chain of several axes, tick by tick: for nodes, offline runs and C code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.modal_model import ModalModel
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.compensation.coupled.decoupling import Decoupling
from piezo_hysteresis.compensation.coupled.matrix_attenuation import MatrixAttenuation
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.offline_loop import reference_points
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.waveforms.waveform import Samples


class AxesChain:
    """Decoupling feedforward and attenuation of periodic errors, before the limits.

    Without `settings` nothing is attenuated; `span` is the range of the voltage [V].
    """

    def __init__(
        self, model: ModalModel, settings: MatrixSettings | None = None, span: float = math.inf
    ) -> None:
        self.model = model
        self.decoupling = Decoupling(model)
        self.attenuation = None
        if settings is not None:
            self.attenuation = MatrixAttenuation(model, settings, span)

    def step(
        self,
        points: Sequence[ReferencePoint],
        measured: Sequence[Measured | None],
        *,
        closed: bool = True,
    ) -> list[float]:
        """Return the voltages of one tick [V] for the references of all axes.

        `measured` are the newest measurements, in lock-step those of the previous tick; they are
        used where the loop is `closed`.
        """
        voltages = self.decoupling.step(points)
        if closed and self.attenuation is not None:
            self.attenuation.step(points, voltages, measured)
        return [float(each) for each in voltages]

    def reset(self) -> None:
        """Return to rest."""
        self.decoupling.reset()
        if self.attenuation is not None:
            self.attenuation.reset()

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name."""
        own = {} if self.attenuation is None else self.attenuation.counters()
        return {**self.decoupling.counters(), **own}


def loaded(path: str | Path) -> ModalModel:
    """Return the model of a file."""
    return modal_file.load(path)


def axes_chain(
    model: ModalModel, limits: Sequence[Limits], settings: MatrixSettings | None, rate: float
) -> AxesChain:  # rate [Hz]
    """Return the chain of a loop; refuse a model of other axes or of another rate."""
    layout = model.layout
    if layout.inputs != layout.outputs or layout.inputs != len(limits):
        raise CompensationError(
            f'the model has {counted(layout.inputs, "voltage")} and '
            f'{counted(layout.outputs, "displacement")}; a loop '
            f'of {counted(len(limits), "axis")} needs as many of both'
        )
    if abs(model.dt * rate - 1.0) > 1e-6:
        raise CompensationError(
            f'the model is of {1.0 / model.dt:g} Hz, the loop runs at {rate:g} Hz; identify it '
            'at the rate of the loop: its delay is part of it'
        )
    return AxesChain(model, settings, min(each.high - each.low for each in limits))


class AxesLoopPlant(Protocol):
    """Interface of a plant of several axes: voltages in, displacements before they act out."""

    def run(self, voltages: FloatArray) -> FloatArray:
        """Return the displacements [m] for voltages [V], shape (n, axes) both."""


@dataclass(frozen=True, eq=False)
class AxesLoopResult:
    """What a closed-loop run of several axes left behind."""

    dt: float  # [s]
    reference: FloatArray  # (n, axes) [m]
    inputs: list[list[FloatArray]]  # of each axis what it was given: reference ... phase, (n,)
    voltage: FloatArray  # behind the limiters (n, axes) [V]
    displacement: FloatArray  # measured (n, axes) [m]
    counters: dict[str, int]

    @property
    def error(self) -> FloatArray:
        """Measured minus desired displacement [m], shape (n, axes)."""
        return self.displacement - self.reference


def repeated(samples: Samples, periods: int) -> Samples:
    """Return a waveform of one period, whole periods of its fundamental, so many times."""
    whole = samples.phase.size * float(samples.phase[1] - samples.phase[0])
    turn = 2.0 * math.pi * round(whole / (2.0 * math.pi))
    value, velocity, acceleration, frequency = (
        np.tile(each, periods)
        for each in (samples.value, samples.velocity, samples.acceleration, samples.frequency)
    )
    phase = np.concatenate([samples.phase + k * turn for k in range(periods)])
    return Samples(value, velocity, acceleration, frequency, phase)


def axes_loop(
    references: Sequence[Samples], chain: AxesChain, plant: AxesLoopPlant, limits: Sequence[Limits]
) -> AxesLoopResult:
    """Run the chain on a plant, tick by tick, as processes in lock-step do.

    At tick k it gets the references of tick k and the measurements of tick k-1; the voltages
    behind the limiters go to the plant, which answers the displacements before they act.
    """
    dt, axes = chain.model.dt, range(len(limits))
    limiters = [Limiter(each, dt) for each in limits]
    points = [list(reference_points(each)) for each in references]
    n = min(len(each) for each in points)
    voltage, displacement = np.empty((n, len(limits))), np.empty((n, len(limits)))
    measured: list[Measured | None] = [None for _ in axes]
    for k in range(n):
        asked = chain.step([each[k] for each in points], measured)
        for i in axes:
            voltage[k, i] = limiters[i].apply(asked[i])
        displacement[k] = plant.run(voltage[k : k + 1])[0]
        measured = [Measured(k, float(voltage[k, i]), float(displacement[k, i])) for i in axes]
    counters = chain.counters()
    for i in axes:
        counters |= {f'{name}_{i + 1}': n for name, n in limiters[i].counters().items()}
    reference = np.stack([each.value[:n] for each in references], 1)
    names = ('value', 'velocity', 'acceleration', 'frequency', 'phase')
    inputs = [[getattr(each, name)[:n] for name in names] for each in references]
    return AxesLoopResult(dt, reference, inputs, voltage, displacement, counters)
