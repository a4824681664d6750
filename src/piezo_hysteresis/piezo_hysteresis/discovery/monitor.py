"""The gap beside a running actuator: model and measurement compared window by window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.locate import harmonics
from piezo_hysteresis.discovery.trial import answers_at_once
from piezo_hysteresis.models import ModelFile

# Above the floor by this factor in this many windows running, the gap is real.
BEYOND = 1.3
PATIENCE = 2
# Share of the power above the floor that makes a family.
MOST = 0.5


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
        # A tick holds the displacement before its voltage acts; a chain that answers at once is
        # one tick ahead of that.
        self._late = answers_at_once(loaded.model, loaded.values, dt)
        self._last = 0.0
        self._voltage: list[float] = []
        self._measured: list[float] = []
        self._state = self._model.initial_state(dt)
        self._streak = 0

    @property
    def floor(self) -> float:
        """Noise rms that the gap is compared with [m]; 0 where it is not known."""
        return self._floor

    def warm_up(self) -> None:
        """Compile the kernels of the chain before the first tick; the memory stays at rest."""
        self._model.respond(np.zeros(4), self._packed, self._dt)

    def reset(self) -> None:
        """Begin again at rest."""
        self._voltage.clear()
        self._measured.clear()
        self._state = self._model.initial_state(self._dt)
        self._last = 0.0
        self._streak = 0

    def add(self, voltage: float, displacement: float) -> GapReport | None:
        """Take one tick; return a report when a window is full."""
        self._voltage.append(voltage)
        self._measured.append(displacement)
        if len(self._voltage) < self._window:
            return None
        u, y = np.array(self._voltage), np.array(self._measured)
        self._voltage.clear()
        self._measured.clear()
        return self._report(u, y - self._simulated(u))

    def _simulated(self, u: FloatArray) -> FloatArray:
        frequency = fundamental(u, self._dt)
        answer = self._model.respond(
            u, self._packed, self._dt, state=self._state, frequency=frequency
        )
        if not self._late:
            return answer
        shifted = np.concatenate([[self._last], answer[:-1]])
        self._last = float(answer[-1])
        return shifted

    def _report(self, u: FloatArray, error: FloatArray) -> GapReport:
        rms = float(np.sqrt(np.mean(error**2)))
        floors = rms / self._floor if self._floor > 0 else float('nan')
        frequency = fundamental(u, self._dt)
        orders, sizes = [0], [abs(float(error.mean()))]
        if frequency * self._dt * u.size >= 1.0:
            orders, phasors, _ = harmonics(error, frequency, self._dt)
            rows = np.abs(phasors) / np.where(np.arange(len(orders)) == 0, 1.0, np.sqrt(2.0))
            sizes = [float(size) for size in rows]
        self._streak = self._streak + 1 if floors > BEYOND else 0
        beyond = self._streak >= PATIENCE
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
    """Return the effects that a gap with these harmonics comes from, in words."""
    power = max(rms**2 - floor**2, 1e-300)
    by_order = {order: size**2 / power for order, size in zip(orders, sizes, strict=True)}
    odd = sum(v for k, v in by_order.items() if k >= 3 and k % 2 == 1)
    even = sum(v for k, v in by_order.items() if k >= 2 and k % 2 == 0)
    found = {
        'drift, offset or asymmetry': by_order.get(0, 0.0),
        'transport_delay, amplifier_lag, creep, gain_decay or rate_dependence': by_order.get(
            1, 0.0
        ),
        'electrostriction or sensor_nonlinearity': even,
        'resonance, saturation, stiffness, friction or the shape of the hysteresis': odd,
    }
    found['mains_hum or another disturbance'] = 1.0 - sum(found.values())
    family, share = max(found.items(), key=lambda each: each[1])
    return family if share >= MOST else f'mostly {family}'
