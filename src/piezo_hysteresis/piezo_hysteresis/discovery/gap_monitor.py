"""Online gap monitor: model and measurement of a running actuator, compared window by window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, isfinite

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.free_run import samples_late, shifted
from piezo_hysteresis.identification.initial_conditions.record_start import STEP, first_guess
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.numerics.harmonics import harmonics
from piezo_hysteresis.records import Record

# The gap is significant if it exceeds noise floor and known discrepancy by this factor in this
# number of consecutive windows.
GAP_RATIO = 1.3
CONFIRMATIONS = 2
# Harmonics are significant as well if each exceeds its known discrepancy, including noise, by the
# first factor, and their sum exceeds the second share of the total expectation.
PART_RATIO, PART = 1.5, 0.3
NOISE_DEVIATIONS = 3.0
# Share of the power that determines the family of causes; for harmonics a small share suffices.
MOST = 0.5
MIN_POWER_SHARE = 0.02
# Power of even harmonics, relative to the mean, from which both have the same cause: 1/2 for a
# square law, more for a higher even law.
WITH_EVEN = 0.1
OF_THE_MEAN = 'drift, creep, an offset or the memory of an earlier drive'
# Delay of the comparison in ticks, for interpolation between the samples of the model.
MARGIN = 5


@dataclass(frozen=True)
class GapReport:
    """Gap over one window."""

    rms: float  # rms of measured minus simulated displacement [m]
    floors: float  # rms in multiples of the noise floor
    frequency: float  # fundamental frequency of the drive in the window [Hz]; 0 at rest
    orders: list[int]  # harmonic orders; 0 is the mean
    sizes: list[float]  # rms at each order [m]
    beyond_floor: bool
    family: str  # possible causes of the gap; empty if it is not significant
    expected: float  # expected gap from known discrepancy and noise [m]
    share: float

    @property
    def words(self) -> str:
        """Size of the gap, also relative to the motion and the known discrepancy."""
        parts = [f'{100.0 * self.share:.2g} % of the motion'] if isfinite(self.share) else []
        parts += [f'{self.floors:.3g} noise floors'] if isfinite(self.floors) else []
        text = f'model error {1e6 * self.rms:.3g} µm ({", ".join(parts)})'
        if self.beyond_floor:
            return f'{text}, {self.rms / self.expected:.2g} times its known discrepancy'
        return f'{text}, within its known discrepancy'

    @property
    def advice(self) -> str:
        """Possible causes and recommended action."""
        first = ''
        if self.family == OF_THE_MEAN:  # the comparison may start in motion
            first = 'call ~/reset with the actuator at rest; where the gap comes back, '
        return f'possible causes: {self.family}; {first}record a sweep and run discover'


class GapMonitor:
    """Runs a model in parallel with the actuator, with the same code as the offline fit.

    Of a model with a schedule, the entry of the drive of a window runs; the comparison restarts
    where it changes.
    """

    def __init__(self, loaded: ModelFile, dt: float, floor: float, window: int) -> None:
        # dt [s]; floor [m]
        self._loaded = loaded
        self._dt = dt
        self._given_floor = floor
        self._window = window
        self._take(loaded)
        self.reset()

    def _take(self, own: ModelFile) -> None:
        """Compare with one set of parameters from now on."""
        self._own = own
        self._model, self._packed = own.model, own.packed
        stated = own.provenance.noise_floor or self._loaded.provenance.noise_floor
        self._floor = self._given_floor if self._given_floor > 0 else float(stated or 0.0)
        self._values = dict(own.values)
        self._known = own.discrepancy
        self._offset = own.sampling_offset
        self._late = samples_late(self._model, self._dt, self._offset)

    @property
    def floor(self) -> float:
        """Noise rms to which the gap is compared [m]; 0 if unknown."""
        return self._floor

    def warm_up(self) -> None:
        """Compile the kernels of every chain before the first tick; the state stays at rest."""
        points = self._loaded.schedule.points if self._loaded.schedule is not None else ()
        for each in (self._loaded, *(point.model for point in points)):
            each.model.respond(np.zeros(4), each.packed, self._dt)

    def reset(self) -> None:
        """Restart the comparison from the present state of the actuator."""
        self._voltage: list[float] = []
        self._measured: list[float] = []
        self._state = self._model.initial_state(self._dt)
        self._simulated_tail = np.zeros(2 * MARGIN)
        self._measured_tail = np.zeros(MARGIN)
        self._streak = 0
        self._fresh = True
        self._stroke = 0.0

    def add(self, voltage: float, displacement: float) -> GapReport | None:
        """Process one tick; return a report at the end of a window."""
        self._voltage.append(voltage)
        self._measured.append(displacement)
        if len(self._voltage) < self._window:
            return None
        u, y = np.array(self._voltage), np.array(self._measured)
        own = self._loaded.at(fundamental(u, self._dt), 0.5 * float(np.ptp(u)))
        if own is not self._own and own is not self._loaded:  # at rest the last one remains
            stroke = self._stroke
            self._take(own)
            self.reset()
            self._stroke = stroke
        unknown = 0
        if self._fresh:
            # samples that depend on the motion before the start are unknown
            self._fresh, unknown = False, MARGIN + max(ceil(-self._late), 0)
            self._begin(u, y)
        self._voltage.clear()
        self._measured.clear()
        return self._report(u, y, self._error(u, y)[unknown:])

    def _begin(self, u: FloatArray, y: FloatArray) -> None:
        """Initialize the model state, if the actuator was in motion at the start.

        At 0 V the actuator may have rested long enough, or keep the remanence of the previous
        drive.
        """
        record = Record('begins', self._dt, u, y)
        if first_guess(record) == STEP and self._explains(record):
            return
        (view,) = views_of(self._model, self._values, [record], self._offset)
        if view.begins == STEP:
            return
        begin = Prediction(self._model, self._packed, view, self._offset)
        self._state, answer = begin.initial_state()
        known = np.concatenate([np.zeros(2 * MARGIN), answer])
        self._simulated_tail = known[-2 * MARGIN :]

    def _explains(self, record: Record) -> bool:
        """Return whether the residual of the model started at rest is within the noise floor."""
        y = Prediction(self._model, self._packed, whole(record), self._offset).displacement
        return float(np.sqrt(np.mean((record.displacement - y) ** 2))) <= GAP_RATIO * self._floor

    def _error(self, u: FloatArray, y: FloatArray) -> FloatArray:
        """Return the residual `MARGIN` ticks behind, where measured and simulated values exist."""
        answer = self._model.respond(
            u, self._packed, self._dt, state=self._state, frequency=fundamental(u, self._dt)
        )
        simulated = np.concatenate([self._simulated_tail, answer])
        measured = np.concatenate([self._measured_tail, y])
        self._simulated_tail = simulated[-2 * MARGIN :]
        self._measured_tail = measured[-MARGIN:]
        read = shifted(simulated, self._late)[MARGIN:-MARGIN]
        return np.asarray(measured[: u.size] - read)

    def _report(self, u: FloatArray, y: FloatArray, error: FloatArray) -> GapReport:
        rms = float(np.sqrt(np.mean(error**2)))
        floors = rms / self._floor if self._floor > 0 else float('nan')
        frequency = fundamental(u, self._dt)
        orders, sizes = [0], [abs(float(error.mean()))]
        if frequency * self._dt * u.size >= 1.0:
            orders, phasors, _ = harmonics(error, frequency, self._dt)
            rows = np.abs(phasors) / np.where(np.arange(len(orders)) == 0, 1.0, np.sqrt(2.0))
            sizes = [float(size) for size in rows]
        self._stroke = max(self._stroke, float(np.ptp(y)))
        stroke = float(np.ptp(y)) if frequency > 0.0 else self._stroke
        expected, known = self._expected(frequency, 0.5 * float(np.ptp(u)), stroke)
        found = rms > GAP_RATIO * expected or self._stands_out(
            dict(zip(orders, sizes, strict=True)), known, expected, error.size
        )
        self._streak = self._streak + 1 if self._floor > 0 and found else 0
        beyond = self._streak >= CONFIRMATIONS
        family = family_of(orders, sizes, rms, self._floor, known) if beyond else ''
        share = rms / self._stroke if self._stroke > 0.0 else float('nan')
        return GapReport(rms, floors, frequency, orders, sizes, beyond, family, expected, share)

    def _stands_out(
        self, sizes: Mapping[int, float], known: Mapping[int, float], expected: float, count: int
    ) -> bool:
        """Return whether harmonics [m] exceed their known discrepancy in a window of `count`."""
        if not known:
            return False
        noise = 2.0 / count * (NOISE_DEVIATIONS * self._floor) ** 2
        over = (
            size**2 - (PART_RATIO * known.get(order, 0.0)) ** 2 - noise
            for order, size in sizes.items()
        )
        return sum(each for each in over if each > 0.0) > (PART * expected) ** 2

    def _expected(
        self, frequency: float, amplitude: float, stroke: float
    ) -> tuple[float, dict[int, float]]:
        """Return the expected gap from identification [m], and its harmonics."""
        if self._known is None:
            return self._floor, {}
        near = self._known.near(frequency, amplitude).harmonics
        size = self._known.expected(frequency, amplitude, stroke, self._floor)
        return size, {order: share * stroke for order, share in near.items()}


def fundamental(voltage: FloatArray, dt: float) -> float:
    """Return the strongest frequency of a window of the drive [Hz]; 0 at rest."""
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


def family_of(
    orders: list[int],
    sizes: list[float],
    rms: float,
    floor: float,
    known: Mapping[int, float] | None = None,
) -> str:
    """Return the possible causes of a gap with these harmonics, in words.

    The known discrepancy of each order is subtracted. Nearly every effect changes the fundamental;
    the other orders are more specific, even if they are small.
    """
    known = known or {}
    rest = max(rms**2 - floor**2 - sum(size**2 for size in sizes), 0.0)
    by_order = {
        order: max(size**2 - known.get(order, 0.0) ** 2, 0.0)
        for order, size in zip(orders, sizes, strict=True)
    }
    power = max(sum(by_order.values()) + rest, 1e-300)
    mean = by_order.get(0, 0.0)
    odd = sum(v for k, v in by_order.items() if k >= 3 and k % 2 == 1)
    even = sum(v for k, v in by_order.items() if k >= 2 and k % 2 == 0)
    if rest > MOST * power:
        return 'mains_hum or another disturbance'
    if mean > MOST * power and even < WITH_EVEN * mean:
        return OF_THE_MEAN
    if even > MIN_POWER_SHARE * power and even > odd:
        return 'electrostriction, sensor_nonlinearity or asymmetry'
    if odd > MIN_POWER_SHARE * power:
        return 'resonance, saturation, stiffness, friction or the shape of the hysteresis'
    return (
        'a gain that has changed, transport_delay, amplifier_lag, creep, gain_decay, '
        'rate_dependence, or electrostriction about a bias'
    )
