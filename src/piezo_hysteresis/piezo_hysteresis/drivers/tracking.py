"""Tracking by a wave in the controller, learnt from run to run (iterative learning control).

The inverse of a model gives the first wave. Each run is measured, the harmonics of its error are
divided by the sensitivity of the model to those of the voltage, and the wave is corrected.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.offline_loop import (
    LoopResult,
    ModelPlant,
    TrackingMetrics,
    closed_loop,
    tracking_metrics,
)
from piezo_hysteresis.drivers.controller import Controller
from piezo_hysteresis.drivers.driver_sweep import REST, whole
from piezo_hysteresis.drivers.wires import DriverError
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.numerics.smooth import smooth_ramp
from piezo_hysteresis.runtime.sweep_plan import RETURN
from piezo_hysteresis.waveforms import Sine

#: Highest harmonic of the reference that is learnt.
HIGHEST = 12
_WINDOW = 0.4  # share of the reference, at its end, for evaluation and learning
_RAMP = 0.3  # share of the reference in which the amplitude rises by default
_STEP = 1e-3  # of the voltage, by which the model is differentiated
_WEAKEST = 1e-3  # of the strongest: sensitivities below it are not used
_ENOUGH = 1.05  # times the noise: learning stops
# Correlation with the model below which a sensor is reversed, share of its motion that is none.
_REVERSED, _STILL = -0.5, 0.05
_LEAST_GAIN = 0.98  # a round that leaves more than this share of the error is the last


@dataclass(frozen=True)
class LearntRun:
    """One run of the controller."""

    name: str  # source of the wave
    result: LoopResult  # every sample of the reference; displacement relative to the initial rest
    metrics: TrackingMetrics  # of the error within the window
    noise: float  # rms of the sensor at rest [m]

    @property
    def rms(self) -> float:
        """Rms of the error within the window [m]."""
        return self.metrics.rms


class Learning:
    """Learns the wave for one periodic reference."""

    def __init__(self, controller: Controller, loaded: ModelFile, reference: Sine) -> None:
        # reference [m]
        duration, frequency = reference.duration, reference.frequency
        if not (isfinite(duration) and _WINDOW * duration * frequency >= 1.0):
            raise DriverError(
                'the reference needs an end, and at least 2.5 periods: give it a duration'
            )
        self._controller = controller
        self.divider = controller.divider_for(duration + 2.0 * (REST + RETURN))
        rate = controller.identity.rate / self.divider
        if frequency >= 0.1 * rate:
            raise DriverError(f'{frequency:g} Hz is too fast for {rate:g} Hz: a tenth at most')
        self.dt = 1.0 / rate
        shaped = reference if reference.ramp else replace(reference, ramp=_RAMP * duration)
        time = np.asarray(np.arange(round(duration * rate)) * self.dt, np.float64)
        self.samples = shaped.sample(time)
        self._envelope = smooth_ramp(time, shaped.ramp)[0]
        periods = int(_WINDOW * duration * frequency)
        self.window = slice(time.size - round(periods / (frequency * self.dt)), time.size)
        loaded = loaded.at(frequency)
        self._model, self._packed = loaded.model, loaded.packed
        self._values = loaded.values
        self._zero: float | None = None
        orders = range(1, min(HIGHEST, int(0.1 * rate / frequency)) + 1)
        rows = [np.ones(time.size)]
        for order in orders:
            rows += [np.cos(order * self.samples.phase), np.sin(order * self.samples.phase)]
        self._basis = np.array(rows)

    @property
    def from_seconds(self) -> float:
        """Start of the evaluated window [s]."""
        return self.window.start * self.dt

    def runs(self, rounds: int = 8) -> Iterator[LearntRun]:
        """Yield a run without compensation, one with the inverse, and those that learn.

        A correction that makes it worse is taken back and halved.
        """
        inverse = self._inverse()
        share = float(np.ptp(inverse)) / float(np.ptp(self.samples.value))
        plain = self._measured('no compensation', share * self.samples.value)
        yield plain
        self._check_sensor(plain.result)
        best = self._measured('feedforward', inverse)
        yield best
        step = 1.0
        for k in range(1, rounds + 1):
            if best.rms <= _ENOUGH * best.noise:
                return
            wave = best.result.voltage + step * self._correction(best.result)
            run = self._measured(f'learnt {k}', wave)
            yield run
            if run.rms < best.rms:
                is_done = run.rms > _LEAST_GAIN * best.rms
                best = run
                if is_done:
                    return
            else:
                step *= 0.5

    def _check_sensor(self, result: LoopResult) -> None:
        """Raise DriverError if the displacement does not follow the voltage: nothing is learnt."""
        expected = self._simulated(result.voltage)[self.window]
        found = result.displacement[self.window]
        predicted, measured = expected - expected.mean(), found - found.mean()
        sizes = float(np.std(predicted)), float(np.std(measured))
        if sizes[1] <= _STILL * sizes[0]:
            raise DriverError(
                'the displacement does not follow the voltage: nothing is learnt; check the '
                'sensor and its unit'
            )
        if float(np.mean(predicted * measured)) < _REVERSED * sizes[0] * sizes[1]:
            raise DriverError(
                'the displacement moves against the voltage, other than the model: nothing is '
                'learnt; correct the sign at the sensor or amplifier'
            )

    def _inverse(self) -> FloatArray:
        """Return the voltage with which the model follows the reference."""
        limits = self._controller.limits
        fastest = (limits.high - limits.low) / self.dt
        within = Limits(limits.low, limits.high, min(limits.slew, fastest))
        link = inverse_for(self._model, self._values, self.dt, limits=within, start=0.0)
        plant = ModelPlant(self._model, self._values, self.dt)
        return closed_loop(self.samples, [link], plant, within, self.dt).voltage

    def _measured(self, name: str, voltages: FloatArray) -> LearntRun:
        first, wave = whole(voltages, 1.0 / self.dt)
        measured = self._controller.play(wave, self.divider)
        rest = measured.displacement[: round(REST / self.dt)]
        own = slice(first, first + voltages.size)
        if self._zero is None:  # what stays of later runs is their own
            self._zero = float(rest.mean())
        moved = measured.displacement[own] - self._zero
        result = LoopResult(
            dt=self.dt,
            reference=self.samples.value,
            voltage=voltages,
            displacement=moved,
            phase=self.samples.phase,
            link_voltages=voltages[None],
            counters={'limiter': {}},
        )
        metrics = tracking_metrics(result, self.from_seconds)
        return LearntRun(name, result, metrics, float(rest.std()))

    def _correction(self, result: LoopResult) -> FloatArray:
        """Return the voltage that takes the harmonics of the error away, by the model [V]."""
        envelope, rows = self._envelope, self._basis
        step = _STEP * float(np.max(np.abs(result.voltage)))
        usual = self._simulated(result.voltage)
        columns = [
            self._harmonics(self._simulated(result.voltage + step * envelope * row) - usual)
            for row in rows
        ]
        sensitivity = np.array(columns).T / step
        missed = self._harmonics(result.error)
        amounts = solve_least_squares(sensitivity, missed, _WEAKEST).values
        return np.asarray(-envelope * (amounts @ rows))

    def _simulated(self, voltages: FloatArray) -> FloatArray:
        return self._model.respond(voltages, self._packed, self.dt)

    def _harmonics(self, signal: FloatArray) -> FloatArray:
        rows = self._basis[:, self.window]
        return solve_least_squares(rows.T, signal[self.window]).values
