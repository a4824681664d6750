"""Runs of the simulated actuators of the papers: open-loop records and tracking.

No parameters of an actuator are used: every model is identified from its records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Limits, Link, Measured, ReferencePoint
from piezo_hysteresis.compensation.offline_loop import LoopResult, closed_loop
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Waveform
from piezo_sim.plant import Plant

Links = Callable[[], Sequence[Link]]


class Straight:
    """No compensation: displacement over one gain, about a bias."""

    def __init__(self, gain: float, bias: float = 0.0, middle: float = 0.0) -> None:
        self._gain, self._bias, self._middle = gain, bias, middle

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return the voltage of a linear gain."""
        return received + self._bias + (point.displacement - self._middle) / self._gain

    def reset(self) -> None:
        """Do nothing; a gain has no memory."""

    def counters(self) -> dict[str, int]:
        """Return no counters; a gain has no errors."""
        return {}


def plant(name: str, seed: int = 1, overrides: Mapping[str, float | bool] | None = None) -> Plant:
    """Return a simulated actuator at the rate of its preset."""
    return Plant.from_preset(name, seed=seed, overrides=dict(overrides or {}))


def run(
    waveform: Waveform, links: Links, actuator: Plant, limits: Limits, dt: float
) -> LoopResult:
    """Run a reference through fresh links on an actuator."""
    time = np.arange(round(waveform.duration / dt), dtype=np.float64) * dt
    return closed_loop(waveform.sample(time), links(), actuator, limits, dt)


def record(name: str, waveform: Waveform, dt: float, info: RecordInfo, seed: int = 1) -> Record:
    """Return an open-loop record of the actuator `name`."""
    time = np.arange(round(waveform.duration / dt), dtype=np.float64) * dt
    voltage = waveform.sample(time).value
    displacement = plant(name, seed).run(voltage)
    return Record(f'{info.frequency:g} Hz', dt, voltage, displacement, info=info)


def rms(error: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(error**2)))
