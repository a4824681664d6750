"""Modal model of several coupled axes: hysteresis of the voltage, common modes, elongation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.signal import resample, resample_poly

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.blocks._plays import play
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.jit import jit, jit_sums

if TYPE_CHECKING:
    from piezo_hysteresis.axes.axes_tracking import AxesInverse


@jit
def play_bank(x: FloatArray, widths: FloatArray, out: FloatArray, turns: int) -> None:
    """Follow plays of half width `widths` from rest, (n,) to (n, plays); the last turn counts."""
    state = np.zeros(widths.size)
    for _ in range(turns):
        for n in range(x.size):
            for j in range(widths.size):
                state[j] = play(x[n], state[j], widths[j])
                out[n, j] = state[j]


def discretised(omega: FloatArray, damping: FloatArray, dt: float) -> FloatArray:
    """Return the exact steps of all modes."""
    # omega [rad/s] (...); damping (...); dt [s] -> (..., 12)
    m = np.zeros((*omega.shape, 6, 6))
    m[..., 0, 1] = m[..., 1, 2] = m[..., 0, 3] = omega
    m[..., 1, 0], m[..., 1, 1] = -omega, -2.0 * damping * omega
    m[..., 2, 4] = m[..., 3, 5] = 1.0 / dt
    x = expm(m * dt)
    rows = [
        (x[..., i, 0], x[..., i, 1], x[..., i, 2] - x[..., i, 4], x[..., i, 4],
         x[..., i, 3] - x[..., i, 5], x[..., i, 5])
        for i in (0, 1)
    ]  # fmt: skip
    return np.ascontiguousarray(np.stack([*rows[0], *rows[1]], -1))


@jit_sums
def follow(
    drive: FloatArray,  # [V] (n, axes)
    steps: FloatArray,  # (blocks, 12, modes)
    block: int,
    omega: FloatArray,  # [rad/s] (blocks, modes)
    shape: FloatArray,  # (axes, modes)
    rate_shape: FloatArray,  # (axes, modes)
    weights: FloatArray,  # (plays, axes)
    widths: FloatArray,  # [V] (plays,)
    square: FloatArray,  # [1/V] (axes,)
    cube: FloatArray,  # [1/V^2] (axes,)
    settle: int,
    every: int,
    state: FloatArray,  # (2 modes + axes + plays axes,)
    q_out: FloatArray,  # [V] (n / every, modes)
    d_out: FloatArray,  # [V/s] (n / every, modes)
    w_out: FloatArray,  # [V] (n / every, axes)
    e_out: FloatArray,  # [V] (n / every, axes)
) -> None:
    """Follow all modes over `settle` ticks of the end of the drive, then over the whole drive."""
    ticks, axes = drive.shape
    modes, plays = shape.shape[1], widths.size
    q, d = state[:modes], state[modes : 2 * modes]
    w = state[2 * modes : 2 * modes + axes]
    p = state[2 * modes + axes :].reshape((plays, axes))
    g0, h0, g, h = np.zeros(modes), np.zeros(modes), np.zeros(modes), np.zeros(modes)
    e, dw = np.zeros(axes), np.zeros(axes)
    before = (ticks - settle - 1) % ticks
    if settle > 0:
        for i in range(axes):
            v = drive[before, i] + w[i]
            for k in range(modes):
                g0[k] += shape[i, k] * v
                h0[k] += rate_shape[i, k] * v
    for n in range(ticks - settle, 2 * ticks):
        t = n % ticks
        a = steps[t // block]
        g[:] = 0.0
        h[:] = 0.0
        for i in range(axes):  # predictor: the feedback of the tick before
            v = drive[t, i] + w[i]
            for k in range(modes):
                g[k] += shape[i, k] * v
                h[k] += rate_shape[i, k] * v
        for k in range(modes):
            x = (a[0, k] * q[k] + a[1, k] * d[k] + a[2, k] * g0[k] + a[3, k] * g[k]
                 + a[4, k] * h0[k] + a[5, k] * h[k])  # fmt: skip
            d[k] = (a[6, k] * q[k] + a[7, k] * d[k] + a[8, k] * g0[k] + a[9, k] * g[k]
                    + a[10, k] * h0[k] + a[11, k] * h[k])  # fmt: skip
            q[k] = x
        for i in range(axes):
            total = 0.0
            for k in range(modes):
                total += shape[i, k] * q[k]
            e[i] = total
            fed = square[i] * total * total + cube[i] * total * total * total
            for j in range(plays):
                p[j, i] = play(total, p[j, i], widths[j])
                fed += weights[j, i] * p[j, i]
            dw[i], w[i] = fed - w[i], fed
        for i in range(axes):  # corrector: its change over the tick
            for k in range(modes):
                more, faster = shape[i, k] * dw[i], rate_shape[i, k] * dw[i]
                q[k] += a[3, k] * more + a[5, k] * faster
                d[k] += a[9, k] * more + a[11, k] * faster
                g[k] += more
                h[k] += faster
        for k in range(modes):
            g0[k], h0[k] = g[k], h[k]
        if n >= ticks and t % every == 0:
            out = t // every
            for k in range(modes):
                q_out[out, k] = q[k]
                d_out[out, k] = omega[t // block, k] * (d[k] + h[k])
            for i in range(axes):
                w_out[out, i], e_out[out, i] = w[i], e[i]


#: Ticks of the simulation for one sample: plays make harmonics above half the sampling rate.
OVERSAMPLING = 2
# The plays of the voltage are found at this many more points before the mean over a tick.
_FINER = 4
# A level lasts at least this long [s].
LEVEL_TIME = 0.1
#: Factor that makes rates of kilohertz as large as coordinates [s].
RATE_UNIT = 1e-4


@dataclass(frozen=True)
class ModalLayout:
    """What a modal model has.

    Attributes
    ----------
    inputs, outputs, modes : int
        Numbers of axes with a voltage, of measured displacements, and of modes.
    voltage_plays : tuple of float
        Half widths of the plays of the voltage [V].
    powers : tuple of int
        Powers of the voltage.
    elongation_plays : tuple of float
        Half widths of the plays of the elongation [V].
    products : bool
        Whether products of elongations move the outputs.
    joints : int
        Number of joints, which modes stretch as they do the axes, and which no voltage drives.
    """

    inputs: int
    outputs: int
    modes: int
    voltage_plays: tuple[float, ...] = ()
    powers: tuple[int, ...] = ()
    elongation_plays: tuple[float, ...] = ()
    products: bool = False
    joints: int = 0

    @property
    def parts(self) -> int:
        """Number of axes and joints."""
        return self.inputs + self.joints

    @property
    def memories(self) -> int:
        """Number of signals made of the voltage of one axis."""
        return len(self.voltage_plays) + len(self.powers)

    @property
    def signal_names(self) -> list[str]:
        """What the displacement is a sum of, see `ModalModel.signals`."""
        axes = [f'axis {i + 1}' for i in range(self.inputs)]
        names = [f'mode {k + 1}' for k in range(self.modes)]
        names += [f'rate of mode {k + 1}' for k in range(self.modes)]
        names += [f'voltage of {axis}' for axis in axes]
        stretched = axes + [f'joint {j + 1}' for j in range(self.joints)]
        names += [f'feedback of {each}' for each in stretched[self.inputs :]]
        if self.products:
            names += [
                f'elongations of {stretched[i]} and {stretched[j]}'
                for i in range(self.parts)
                for j in range(i + 1)
            ]
        memories = [f'play of {width:.4g} V' for width in self.voltage_plays]
        memories += [f'power {power}' for power in self.powers]
        return names + [f'{memory} of {axis}' for memory in memories for axis in axes]

    @cached_property
    def places(self) -> dict[str, tuple[slice, tuple[int, ...]]]:
        """Where each parameter stands in the vector, and its shape."""
        k, i, parts = self.modes, self.inputs, self.parts
        shapes: dict[str, tuple[int, ...]] = {
            'log_omega': (k,),
            'log_damping': (k,),
            'shape': (parts, k),
            'rate_shape': (parts, k),
            'delay': (1,),
            'softening': (2, k),
            'level_damping': (2, k),
            'level_power': (1,),
            'voltage_weights': (self.memories, i),
            'elongation_weights': (len(self.elongation_plays), parts),
            'square': (parts,),
            'cube': (parts,),
        }
        places, at = {}, 0
        for name, shape in shapes.items():
            size = int(np.prod(shape))
            places[name] = (slice(at, at + size), shape)
            at += size
        return places

    @property
    def size(self) -> int:
        """Number of parameters without the output matrix."""
        return int(max(place.stop for place, _ in self.places.values()))

    def named(self, vector: FloatArray) -> dict[str, FloatArray]:
        """Return the parameters of a vector by name."""
        return {name: vector[at].reshape(shape) for name, (at, shape) in self.places.items()}

    def zeros(self) -> FloatArray:
        """Return a vector without effects, shape (size,)."""
        vector = np.zeros(self.size)
        vector[self.places['level_power'][0]] = 0.5
        return vector

    def carried(self, vector: FloatArray, before: ModalLayout) -> FloatArray:
        """Return the vector of an earlier layout with the effects of this one at zero."""
        new, old = self.zeros(), before.named(vector)
        found = self.named(new)
        for name, values in old.items():
            if name == 'voltage_weights':
                _carry(found[name], values, _memories(self), _memories(before))
            elif name == 'elongation_weights':
                _carry(found[name], values, self.elongation_plays, before.elongation_plays)
            else:  # modes and joints are added behind the others
                found[name][tuple(slice(size) for size in values.shape)] = values
        return new


def _memories(layout: ModalLayout) -> tuple[float, ...]:
    return (*layout.voltage_plays, *(-float(power) for power in layout.powers))


def _carry(
    to: FloatArray, values: FloatArray, now: Sequence[float], before: Sequence[float]
) -> None:
    for row, key in zip(values, before, strict=True):
        if key in now:
            to[now.index(key), : row.size] = row


@dataclass(frozen=True, eq=False)
class AxesDrive:
    """A record as the model is driven by it.

    Attributes
    ----------
    record : AxesRecord
        One period, or a record from rest.
    layout : ModalLayout
        Of the models that follow it.
    """

    record: AxesRecord
    layout: ModalLayout

    @property
    def periodic(self) -> bool:
        """Whether the record is one period of a steady state."""
        return self.record.periods == 1

    @cached_property
    def _made(self) -> tuple[FloatArray, FloatArray]:
        """Voltage at the ticks of the simulation, and its plays and powers."""
        layout, factor = self.layout, OVERSAMPLING * _FINER
        x = _finer(self.record.voltage, factor, periodic=self.periodic)
        widths = np.asarray(layout.voltage_plays)
        memory = np.empty((layout.memories, x.shape[0] // _FINER, layout.inputs))
        for i in range(layout.inputs):
            column = np.ascontiguousarray(x[:, i])
            bank = np.empty((x.shape[0], widths.size))
            play_bank(column, widths, bank, 2 if self.periodic else 1)
            signals = [*bank.T, *(column**power for power in layout.powers)]
            for j, signal in enumerate(signals):
                memory[j, :, i] = _coarser(signal, _FINER, periodic=self.periodic)
        return np.ascontiguousarray(x[::_FINER]), memory

    @property
    def fine(self) -> FloatArray:
        """Voltage at the ticks of the simulation, shape (ticks, inputs) [V]."""
        return self._made[0]

    @property
    def memory(self) -> FloatArray:
        """Plays and powers of the voltage, shape (memories, ticks, inputs)."""
        return self._made[1]

    @cached_property
    def level(self) -> FloatArray:
        """Root of the mean square of the voltage by block [V], shape (blocks,)."""
        square = np.mean(self.record.voltage**2, 1)
        if self.periodic:
            return np.array([np.sqrt(np.mean(square))])
        held = np.exp(-1.0 / (LEVEL_TIME * self.record.rate))
        level, levels = float(square[0]), []
        for n in range(0, square.size, self.block):
            levels.append(level)
            part = square[n : n + self.block]
            level += (1.0 - held**part.size) * (float(part.mean()) - level)
        return np.asarray(np.sqrt(levels))

    @property
    def block(self) -> int:
        """Samples that share one level."""
        samples = self.record.voltage.shape[0]
        return samples if self.periodic else max(1, round(0.1 * LEVEL_TIME * self.record.rate))


def drive_of(record: AxesRecord, layout: ModalLayout) -> AxesDrive:
    """Return a record as models of a layout are driven by it; whole periods are averaged."""
    return _drive_of(
        record, replace(layout, modes=0, elongation_plays=(), products=False, joints=0)
    )


@lru_cache(maxsize=48)
def _drive_of(record: AxesRecord, layout: ModalLayout) -> AxesDrive:
    return AxesDrive(record.mean_period() if record.periods else record, layout)


def _finer(x: FloatArray, factor: int, *, periodic: bool) -> FloatArray:
    """Return the band-limited signal at `factor` times the rate."""
    if periodic:
        return np.asarray(resample(x, x.shape[0] * factor, axis=0))
    return np.asarray(resample_poly(x, factor, 1, axis=0, padtype='line'))


def _coarser(x: FloatArray, factor: int, *, periodic: bool) -> FloatArray:
    if not periodic:
        return x[::factor]
    spectrum = np.fft.rfft(x)[: x.size // factor // 2 + 1]
    spectrum[-1] = 0.0
    return np.fft.irfft(spectrum, x.size // factor) / factor


@dataclass(frozen=True, eq=False)
class ModalModel:
    """A model of several coupled axes.

    Attributes
    ----------
    layout : ModalLayout
        What it has.
    vector : ndarray, shape (layout.size,)
        Its parameters.
    output : ndarray, shape (features, outputs)
        Displacement for each signal of the model [m/V, ...].
    full_level : float
        Level at which softening is stated [V].
    dt : float
        Interval of the records that it was identified on [s].
    deviations : ndarray, shape (layout.size,), or None
        Standard deviations of the parameters.
    """

    layout: ModalLayout
    vector: FloatArray
    output: FloatArray
    full_level: float
    dt: float
    deviations: FloatArray | None = None

    def save(self, path: str | Path) -> None:
        """Write the model as YAML, see `axes.modal_file.save`."""
        from piezo_hysteresis.axes.modal_file import save

        save(self, path)

    @staticmethod
    def load(path: str | Path) -> ModalModel:
        """Return the model of a file, see `axes.modal_file.load`."""
        from piezo_hysteresis.axes.modal_file import load

        return load(path)

    def inverse(self, reference: FloatArray, highest: float | None = None) -> AxesInverse:
        """Return voltages for a period of references, see `axes.axes_tracking.inverse`."""
        from piezo_hysteresis.axes.axes_tracking import inverse

        return inverse(self, reference, highest)

    @property
    def parameters(self) -> dict[str, FloatArray]:
        """Parameters by name, as in `ModalLayout.places`."""
        return self.layout.named(self.vector)

    def grown(self, level: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the two powers of levels and their slopes by the power, shape (levels, 2)."""
        part, power = level / self.full_level, self.parameters['level_power'][0]
        grown = np.stack([part**power, part ** (2.0 * power)], 1)
        return grown, np.log(np.maximum(part, 1e-12))[:, None] * grown * np.array([1.0, 2.0])

    def modes_at(self, level: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return angular frequencies [rad/s] and damping ratios, shape (levels, modes)."""
        found, (grown, _) = self.parameters, self.grown(level)
        omega = np.exp(found['log_omega']) * (1.0 - grown @ found['softening'])
        return omega, np.exp(found['log_damping'] + grown @ found['level_damping'])

    def forced(self, drive: AxesDrive) -> FloatArray:
        """Return the voltage with its plays and powers, 0 of joints, shape (ticks, parts) [V]."""
        weights = self.parameters['voltage_weights']
        forced = np.pad(drive.fine, ((0, 0), (0, self.layout.joints)))
        if weights.size:
            forced[:, : self.layout.inputs] += np.einsum('ji,jti->ti', weights, drive.memory)
        return forced

    def followed(self, drive: AxesDrive, every: int) -> tuple[FloatArray, ...]:
        """Return forced voltages, steps of the modes, and what `follow` writes every few ticks."""
        layout, found = self.layout, self.parameters
        omega, damping = self.modes_at(drive.level)
        steps = discretised(omega, damping, self.dt / OVERSAMPLING).transpose(0, 2, 1)
        steps, forced = np.ascontiguousarray(steps), self.forced(drive)
        (ticks, parts), modes = forced.shape, layout.modes
        size = 2 * modes + parts + len(layout.elongation_plays) * parts
        settle = ticks if drive.periodic else 0
        n = ticks // every
        q, d = np.empty((n, modes)), np.empty((n, modes))
        w, e = np.empty((n, parts)), np.empty((n, parts))
        follow(
            forced, steps, drive.block * OVERSAMPLING, omega, found['shape'], found['rate_shape'],
            found['elongation_weights'], np.asarray(layout.elongation_plays), found['square'],
            found['cube'], settle, every, np.zeros(size), q, d, w, e,
        )  # fmt: skip
        return forced, steps, q, d, w, e

    def signals(self, drive: AxesDrive) -> FloatArray:
        """Return what the displacement is a sum of, shape (n, features).

        Coordinates, rates, voltages with feedback, products of elongations, memories; in steady
        state for a period, from rest else.
        """
        layout = self.layout
        forced, _, q, d, w, e = self.followed(drive, OVERSAMPLING)
        n = q.shape[0]
        columns = [q, d * RATE_UNIT, forced[::OVERSAMPLING] + w]
        if layout.products:
            columns += [(e[:, i] * e[:, : i + 1].T).T for i in range(layout.parts)]
        if layout.memories:
            memory = drive.memory[:, ::OVERSAMPLING].transpose(1, 0, 2)
            columns.append(memory.reshape(n, -1))
        return np.concatenate(columns, 1)

    def simulate(self, voltage: AxesRecord | ArrayLike) -> FloatArray:
        """Return the displacement in free run.

        Parameters
        ----------
        voltage : AxesRecord, or array_like, shape (n, inputs)
            Voltages [V] at the interval of the model. A record of whole periods is followed in its
            steady state; any other, and an array, starts at rest.

        Returns
        -------
        ndarray, shape (n, outputs)
            Displacements [m].

        Raises
        ------
        ModelError
            If the voltages are not finite numbers of that shape.
        """
        record = voltage if isinstance(voltage, AxesRecord) else self._at_rest(voltage)
        drive = drive_of(record, self.layout)
        y = self.displacement(drive, self.signals(drive))
        return np.tile(y, (record.periods, 1)) if record.periods else y

    def _at_rest(self, voltage: ArrayLike) -> AxesRecord:
        given = np.asarray(voltage, float)
        inputs = self.layout.inputs
        if given.ndim != 2 or given.shape[1] != inputs or not np.isfinite(given).all():
            raise ModelError(
                f'the voltages must be finite numbers of shape (samples, {inputs}), got '
                f'{given.shape}'
            )
        unknown = np.zeros((len(given), self.layout.outputs))
        return AxesRecord('voltage', self.dt, given, unknown)

    def displacement(self, drive: AxesDrive, signals: FloatArray) -> FloatArray:
        """Return the displacement for the signals of a drive, shape (n, outputs) [m]."""
        if drive.periodic:
            signals = signals - signals.mean(0)
        return delayed(signals @ self.output, float(self.parameters['delay'][0]) / self.dt)


def delayed(x: FloatArray, samples: float) -> FloatArray:
    """Return columns that come `samples` later, by their spectrum; negative: earlier."""
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(x.shape[0]) * samples)
    return np.fft.irfft(np.fft.rfft(x, axis=0) * turn[:, None], x.shape[0], axis=0)
