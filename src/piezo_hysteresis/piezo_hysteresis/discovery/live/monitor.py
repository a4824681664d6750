"""The gap beside a running actuator: model and measurement compared window by window."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.errors import free_run, views_of
from piezo_hysteresis.identification.opening import state_at_start
from piezo_hysteresis.identification.reading import samples_late, shifted
from piezo_hysteresis.identification.record_start import STEP, first_guess
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.numerics.harmonics import harmonics
from piezo_hysteresis.records import Record

# Above the floor by this factor in this many windows running, the gap is real.
GAP_RATIO = 1.3
CONFIRMATIONS = 2
# Share of the power above the floor that makes a family; of harmonics little is telling.
MOST = 0.5
TELLING = 0.02
# Ticks by which the comparison lags, so that the model can be read between its samples.
MARGIN = 5


@dataclass(frozen=True)
class GapReport:
    """The gap over one window.

    Attributes
    ----------
    rms : float
        Rms of measured minus simulated [m].
    floors : float
        The same in noise floors.
    frequency : float
        Fundamental of the drive in the window [Hz]; 0 where there is none.
    orders : list of int
        Harmonic orders; 0 is the mean.
    sizes : list of float
        Rms at each order [m].
    beyond_floor : bool
        Whether the gap has stayed above the floor.
    family : str
        Effects that such a gap comes from; empty where it is on the floor.
    """

    rms: float
    floors: float
    frequency: float
    orders: list[int]
    sizes: list[float]
    beyond_floor: bool
    family: str


class GapMonitor:
    """Runs a model beside the actuator; the same code as the offline fit, sample for sample.

    Parameters
    ----------
    loaded : ModelFile
        The model.
    dt : float
        Sampling interval [s].
    floor : float
        Noise rms [m]; that of the model file where it is not positive.
    window : int
        Samples per report.
    """

    def __init__(self, loaded: ModelFile, dt: float, floor: float, window: int) -> None:
        self._model = loaded.model
        self._packed = loaded.packed
        self._dt = dt
        self._floor = floor if floor > 0 else float(loaded.provenance.noise_floor or 0.0)
        self._window = window
        self._values = dict(loaded.values)
        self._offset = fitted = loaded.sampling_offset
        self._late = samples_late(self._model, dt, fitted)
        self.reset()

    @property
    def floor(self) -> float:
        """Noise rms that the gap is compared with [m]; 0 where it is not known."""
        return self._floor

    def warm_up(self) -> None:
        """Compile the kernels of the chain before the first tick; the memory stays at rest."""
        self._model.respond(np.zeros(4), self._packed, self._dt)

    def reset(self) -> None:
        """Begin again, as the actuator is found."""
        self._voltage: list[float] = []
        self._measured: list[float] = []
        self._state = self._model.initial_state(self._dt)
        self._simulated_tail = np.zeros(2 * MARGIN)
        self._measured_tail = np.zeros(MARGIN)
        self._streak = 0
        self._fresh = True

    def add(self, voltage: float, displacement: float) -> GapReport | None:
        """Take one tick; return a report when a window is full."""
        self._voltage.append(voltage)
        self._measured.append(displacement)
        if len(self._voltage) < self._window:
            return None
        u, y = np.array(self._voltage), np.array(self._measured)
        unknown = 0
        if self._fresh:
            # what was measured before this began, and what was held then
            self._fresh, unknown = False, MARGIN + max(ceil(-self._late), 0)
            self._begin(u, y)
        self._voltage.clear()
        self._measured.clear()
        return self._report(u, self._error(u, y)[unknown:])

    def _begin(self, u: FloatArray, y: FloatArray) -> None:
        """Bring the model to where the actuator is, if it was in motion when this began.

        At 0 V it may have been at rest for ever, or hold what the drive before has left.
        """
        record = Record('begins', self._dt, u, y)
        if first_guess(record) == STEP and self._explains(record):
            return
        (view,) = views_of(self._model, self._values, [record], self._offset)
        if view.begins == STEP:
            return
        self._state, answer = state_at_start(self._model, self._packed, view, self._offset)
        known = np.concatenate([np.zeros(2 * MARGIN), answer])
        self._simulated_tail = known[-2 * MARGIN :]

    def _explains(self, record: Record) -> bool:
        """Return whether the model from rest leaves nothing beyond the floor of a record."""
        with np.errstate(over='ignore', invalid='ignore'):
            y = free_run(self._model, self._values, record, self._offset, begins=STEP)
        return float(np.sqrt(np.mean((record.displacement - y) ** 2))) <= GAP_RATIO * self._floor

    def _error(self, u: FloatArray, y: FloatArray) -> FloatArray:
        """Return measured minus simulated, `MARGIN` ticks behind, where both are known."""
        answer = self._model.respond(
            u, self._packed, self._dt, state=self._state, frequency=fundamental(u, self._dt)
        )
        simulated = np.concatenate([self._simulated_tail, answer])
        measured = np.concatenate([self._measured_tail, y])
        self._simulated_tail = simulated[-2 * MARGIN :]
        self._measured_tail = measured[-MARGIN:]
        read = shifted(simulated, self._late)[MARGIN:-MARGIN]
        return np.asarray(measured[: u.size] - read)

    def _report(self, u: FloatArray, error: FloatArray) -> GapReport:
        rms = float(np.sqrt(np.mean(error**2)))
        floors = rms / self._floor if self._floor > 0 else float('nan')
        frequency = fundamental(u, self._dt)
        orders, sizes = [0], [abs(float(error.mean()))]
        if frequency * self._dt * u.size >= 1.0:
            orders, phasors, _ = harmonics(error, frequency, self._dt)
            rows = np.abs(phasors) / np.where(np.arange(len(orders)) == 0, 1.0, np.sqrt(2.0))
            sizes = [float(size) for size in rows]
        self._streak = self._streak + 1 if floors > GAP_RATIO else 0
        beyond = self._streak >= CONFIRMATIONS
        family = family_of(orders, sizes, rms, self._floor) if beyond else ''
        return GapReport(rms, floors, frequency, orders, sizes, beyond, family)


def fundamental(voltage: FloatArray, dt: float) -> float:
    """Return the strongest frequency of a window of the drive [Hz]; 0 where it is at rest."""
    centred = voltage - voltage.mean()
    if float(np.max(np.abs(centred))) < 1e-9:
        return 0.0
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(centred.size)))
    place = int(np.argmax(spectrum))
    if not 0 < place < spectrum.size - 1:
        return 0.0
    left, top, right = np.log(np.maximum(spectrum[place - 1 : place + 2], 1e-300))
    curve = left - 2.0 * top + right
    offset = 0.5 * (left - right) / curve if curve != 0 else 0.0
    return float((place + offset) / (centred.size * dt))


def family_of(orders: list[int], sizes: list[float], rms: float, floor: float) -> str:
    """Return the effects that a gap with these harmonics comes from, in words.

    Nearly every effect moves the fundamental; the other orders say more, even when they are small.
    """
    power = max(rms**2 - floor**2, 1e-300)
    by_order = {order: size**2 / power for order, size in zip(orders, sizes, strict=True)}
    odd = sum(v for k, v in by_order.items() if k >= 3 and k % 2 == 1)
    even = sum(v for k, v in by_order.items() if k >= 2 and k % 2 == 0)
    if 1.0 - sum(by_order.values()) > MOST:
        return 'mains_hum or another disturbance'
    if even > TELLING and even > odd:
        return 'electrostriction, sensor_nonlinearity or asymmetry'
    if odd > TELLING:
        return 'resonance, saturation, stiffness, friction or the shape of the hysteresis'
    if by_order.get(0, 0.0) > MOST:
        return 'drift, offset or asymmetry'
    return 'transport_delay, amplifier_lag, creep, gain_decay or rate_dependence'
