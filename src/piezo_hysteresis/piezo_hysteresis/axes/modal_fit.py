"""Fit of a modal model in free run: Levenberg-Marquardt with the output matrix projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray, IntArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.modal_gradient import gradient
from piezo_hysteresis.axes.modal_model import (
    RATE_UNIT,
    AxesDrive,
    ModalLayout,
    ModalModel,
    delayed,
    drive_of,
    play_bank,
)
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.numerics.linalg import solve_square


@dataclass(eq=False)
class _Lines:
    """Spectra of one record and transfer functions of the model, by line."""

    s: ComplexArray  # (lines,)
    drive: ComplexArray  # voltage with feedback, (lines, inputs)
    elongation: ComplexArray  # (lines, inputs)
    q: ComplexArray  # (lines, modes)
    omega: FloatArray  # (modes,)
    damping: FloatArray  # (modes,)
    inverse: ComplexArray  # 1 / denominator, (lines, modes)
    reading: ComplexArray  # displacement for a coordinate with feedback, (modes, lines, outputs)
    through: ComplexArray  # displacement for a voltage, (lines, inputs, outputs)
    compliance: ComplexArray  # elongation for a voltage, (lines, inputs, inputs)
    fed: ComplexArray  # displacement for an elongation by the feedback, (lines, inputs, outputs)


def _lines(x: FloatArray) -> ComplexArray:
    """Return the lines above 0 Hz of columns, of unit power."""
    return np.asarray(np.fft.rfft(x, axis=0)[1:] * np.sqrt(2.0 / x.shape[0]))


class ModalDerivatives:
    """Derivatives of one record."""

    def __init__(self, model: ModalModel, drive: AxesDrive, signals: FloatArray) -> None:
        # signals (n, features)
        self._model, self._drive = model, drive
        self._found = model.parameters
        layout = model.layout
        modes, parts = layout.modes, layout.parts
        q, total = signals[:, :modes], signals[:, 2 * modes : 2 * modes + parts]
        self._e = q @ self._found['shape'].T
        self._samples = signals.shape[0]
        omega, damping = model.modes_at(drive.level)
        self._at = self._transfers(q, total, omega.mean(0), damping.mean(0))

    def _transfers(
        self, q: FloatArray, total: FloatArray, omega: FloatArray, damping: FloatArray
    ) -> _Lines:
        modes, parts = self._model.layout.modes, self._model.layout.parts
        s = 2j * np.pi * np.fft.rfftfreq(self._samples, self._model.dt)[1:]
        inverse = 1.0 / (s[:, None] ** 2 + 2.0 * damping * omega * s[:, None] + omega**2)
        output = self._model.output
        reading = output[:modes] + RATE_UNIT * s[:, None, None] * output[modes : 2 * modes]
        shape, rate_shape = self._found['shape'].T, self._found['rate_shape'].T  # (modes, inputs)
        by_rate = (omega * (s[:, None] + 2.0 * damping * omega) * inverse)[:, :, None]
        driven = (omega**2 * inverse)[:, :, None] * shape + by_rate * rate_shape
        through = np.einsum('lki,lko->lio', driven, reading, optimize=True)
        through = through + output[2 * modes : 2 * modes + parts]
        compliance = np.einsum('ki,lkj->lij', shape, driven, optimize=True)
        drive, elongation = _lines(total), _lines(self._e)
        gain = self._gain(elongation, _lines(self._feedback()))
        closed = np.eye(parts) - compliance * gain
        loop = gain[:, None] * np.linalg.inv(closed)
        fed = np.einsum('lij,lio->ljo', loop, through, optimize=True)
        reading = reading + np.einsum('kj,ljo->lko', shape, fed, optimize=True)
        return _Lines(
            np.asarray(s), drive, elongation, _lines(q), omega, damping,
            np.asarray(inverse), np.ascontiguousarray(reading.transpose(1, 0, 2)), through,
            compliance, fed,
        )  # fmt: skip

    def _plays(self) -> FloatArray:
        """Return the plays of the elongation, shape (plays, n, inputs)."""
        widths = np.asarray(self._model.layout.elongation_plays)
        found = np.empty((widths.size, *self._e.shape))
        for i in range(self._e.shape[1]):
            bank = np.empty((self._samples, widths.size))
            turns = 2 if self._drive.periodic else 1
            play_bank(np.ascontiguousarray(self._e[:, i]), widths, bank, turns)
            found[:, :, i] = bank.T
        return found

    def _feedback(self) -> FloatArray:
        """Return the voltage that the elongation feeds back, shape (n, inputs) [V]."""
        fed = self._found['square'] * self._e**2 + self._found['cube'] * self._e**3
        weights = self._found['elongation_weights']
        return np.asarray(fed + np.einsum('ji,jni->ni', weights, self._plays()))

    @staticmethod
    def _gain(elongation: ComplexArray, feedback: ComplexArray) -> ComplexArray:
        """Return the linear gain from the elongation to the feedback, shape (inputs,)."""
        power = np.sum(np.abs(elongation) ** 2, 0) + 1e-300
        return np.asarray(np.sum(feedback * elongation.conj(), 0) / power)

    def _closed(self) -> ComplexArray:
        """Return the displacement for a voltage with the feedback, (lines, inputs, outputs)."""
        at = self._at
        return np.asarray(
            at.through + np.einsum('lki,lko->lio', at.compliance, at.fed, optimize=True)
        )

    def response(self) -> ComplexArray:
        """Return the displacement for a voltage at this level, (lines, outputs, inputs)."""
        at, fine = self._at, self._drive.fine
        step = fine.shape[0] // self._samples
        u = fine[::step] - fine[::step].mean(0)
        power = np.sum(u**2, 0)
        inputs = self._model.layout.inputs
        forced = self._model.forced(self._drive)[::step, :inputs]
        ratio = np.sum(forced * u, 0) / np.where(power > 0.0, power, 1.0)
        gain = np.where(power > 0.0, ratio, 1.0)
        late = np.exp(-at.s * self._found['delay'][0])[:, None, None]
        return np.asarray((late * self._closed()[:, :inputs] * gain[:, None]).transpose(0, 2, 1))

    # --- derivatives ---------------------------------------------------------------------------

    def of(self, names: list[str]) -> ComplexArray:
        """Return the derivatives by the named parameters, shape (parameters, lines, outputs)."""
        made = {
            'log_omega': self._omega, 'log_damping': self._damping, 'shape': self._shape,
            'rate_shape': self._rate_shape, 'delay': self._delay, 'softening': self._softening,
            'level_damping': self._level_damping, 'level_power': self._level_power,
            'voltage_weights': self._voltage_weights,
            'elongation_weights': self._elongation_weights, 'square': self._square,
            'cube': self._cube,
        }  # fmt: skip
        return np.concatenate([made[name]() for name in names])

    def _moved(self, modes: IntArray, change: ComplexArray) -> ComplexArray:
        """Return the displacement for changes of single coordinates, (parameters, lines, outputs).

        `modes` are the modes of the parameters, `change` those of their coordinates, (lines,
        parameters).
        """
        return np.ascontiguousarray(change.T)[:, :, None] * self._at.reading[modes]

    def _by_omega(self) -> ComplexArray:
        """Return the change of each coordinate by its own angular frequency, (lines, modes)."""
        at, shape, rate_shape = self._at, self._found['shape'], self._found['rate_shape']
        g, h = at.drive @ shape, at.drive @ rate_shape
        s = at.s[:, None]
        upper = 2.0 * at.omega * g + (s + 4.0 * at.damping * at.omega) * h
        return np.asarray((upper - at.q * (2.0 * at.damping * s + 2.0 * at.omega)) * at.inverse)

    def _by_damping(self) -> ComplexArray:
        """Return the change of each coordinate by its own damping ratio, (lines, modes)."""
        at, h = self._at, self._at.drive @ self._found['rate_shape']
        upper = 2.0 * at.omega**2 * h - at.q * 2.0 * at.omega * at.s[:, None]
        return np.asarray(upper * at.inverse)

    def _each(self, change: ComplexArray) -> ComplexArray:
        return self._moved(np.arange(self._model.layout.modes), change)

    def _omega(self) -> ComplexArray:
        return self._each(self._by_omega() * self._at.omega)

    def _damping(self) -> ComplexArray:
        return self._each(self._by_damping() * self._at.damping)

    def _grown(self) -> tuple[FloatArray, FloatArray]:
        """Return the two powers of the level, and their slopes by the power."""
        grown, slopes = self._model.grown(self._drive.level.mean(keepdims=True))
        return grown[0], slopes[0]

    def _softening(self) -> ComplexArray:
        omega = np.exp(self._found['log_omega'])
        moved = self._each(-self._by_omega() * omega)
        return np.concatenate([grown * moved for grown in self._grown()[0]])

    def _level_damping(self) -> ComplexArray:
        moved = self._damping()
        return np.concatenate([grown * moved for grown in self._grown()[0]])

    def _level_power(self) -> ComplexArray:
        slope = self._grown()[1]
        omega = -np.exp(self._found['log_omega']) * (slope @ self._found['softening'])
        damping = self._at.damping * (slope @ self._found['level_damping'])
        change = self._by_omega() * omega + self._by_damping() * damping
        return np.asarray(np.sum(self._each(change), 0, keepdims=True))

    def _shape(self) -> ComplexArray:
        at, parts, modes = self._at, self._model.layout.parts, self._model.layout.modes
        which = np.tile(np.arange(modes), parts)
        axis = np.repeat(np.arange(parts), modes)
        moved = self._moved(which, (at.omega**2 * at.inverse)[:, which] * at.drive[:, axis])
        fed, q = at.fed.transpose(1, 0, 2), at.q.T[:, :, None]
        for i in range(parts):  # the elongation changes directly as well
            moved[i * modes : (i + 1) * modes] += q * fed[i]
        return moved

    def _rate_shape(self) -> ComplexArray:
        at, parts, modes = self._at, self._model.layout.parts, self._model.layout.modes
        which = np.tile(np.arange(modes), parts)
        axis = np.repeat(np.arange(parts), modes)
        by_rate = at.omega * (at.s[:, None] + 2.0 * at.damping * at.omega) * at.inverse
        return self._moved(which, by_rate[:, which] * at.drive[:, axis])

    def _delay(self) -> ComplexArray:
        """Return the derivative by the delay, by which the measurement is taken earlier."""
        early = np.exp(self._at.s * self._found['delay'][0])[:, None]
        y = _lines(self._drive.record.displacement)
        return np.asarray((-self._at.s[:, None] * early * y)[None])

    def _forced(self, signals: FloatArray) -> ComplexArray:
        """Return the displacement for voltages (m, n, inputs), each of which acts alone."""
        at = self._at
        count, _, inputs = signals.shape
        whole = self._closed()
        rows = [
            _lines(signals[j][:, i : i + 1]) * whole[:, i]
            for j in range(count)
            for i in range(inputs)
        ]
        return np.array(rows).reshape(-1, at.s.size, self._model.layout.outputs)

    def _voltage_weights(self) -> ComplexArray:
        step = self._drive.memory.shape[1] // self._samples
        return self._forced(self._drive.memory[:, ::step])

    def _elongation_weights(self) -> ComplexArray:
        return self._forced(self._plays())

    def _square(self) -> ComplexArray:
        return self._forced(self._e[None] ** 2)

    def _cube(self) -> ComplexArray:
        return self._forced(self._e[None] ** 3)


_RIDGE = 1e-9
_FRESH = 2  # turns whose curvature is found anew
_FEWER, _WINDOW = 0.9995, 5  # a smaller gain of the sum of squares in these turns ends the fit
_TRIALS = 7
# Weights of the distances from the start of a fit, in residuals of one sample: the records do not
# determine the scale of a shape before the elongation acts, nor the weight of a play that hardly
# moves.
_LOOSE = {
    'log_omega': 100.0, 'log_damping': 5.0, 'shape': 10.0, 'rate_shape': 10.0,
    'voltage_weights': 10.0, 'elongation_weights': 10.0, 'square': 10.0, 'cube': 10.0,
}  # fmt: skip


@dataclass(eq=False)
class ModalFitData:
    """Records as a fit needs them."""

    drives: list[AxesDrive]  # their voltages
    measured: list[FloatArray]  # displacements without their means, each of shape (n, outputs) [m]
    weights: FloatArray  # of each record [1/m], shape (records,)

    @classmethod
    def of(
        cls, records: Sequence[AxesRecord], layout: ModalLayout, weights: FloatArray
    ) -> ModalFitData:
        """Return the data of records; whole periods are averaged."""
        drives = [drive_of(each, layout) for each in records]
        measured = [each.record.displacement for each in drives]
        return cls(drives, [each - each.mean(0) for each in measured], weights)


@dataclass(eq=False)
class _Point:
    """The fit at one vector."""

    rows: list[FloatArray]
    output: FloatArray
    residual: list[FloatArray]
    gram: FloatArray

    @property
    def cost(self) -> float:
        return float(sum(np.sum(each**2) for each in self.residual))


class ModalFit:
    """Fits the parameters of a modal model."""

    def __init__(self, model: ModalModel, data: ModalFitData, workers: int = 1) -> None:
        self._model, self._data, self._workers = model, data, workers
        self._count = sum(each.size for each in data.measured)

    def run(self, names: Sequence[str], turns: int, damping: float = 1e-2) -> ModalModel:
        """Fit the named parameters in up to `turns` steps; return the model.

        The curvature is approximate in the first turns, and then follows the exact slopes (BFGS).
        """
        names, free = self._free(names)
        point = self._evaluate(self._model.vector)
        start, places = self._model.vector[free], self._model.layout.places
        loose = np.concatenate([np.full(np.prod(places[n][1]), _LOOSE.get(n, 0.0)) for n in names])
        firm = loose**2 * point.cost / self._count
        costs, away = [point.cost], np.zeros(free.size)
        slope = self._slope(point)[free] if turns else away
        for turn in range(turns):
            if turn < _FRESH:
                normal = self._normal(point, names) + np.diag(firm)
            for _ in range(_TRIALS):
                moved = self._model.vector.copy()
                scaled = normal + damping * np.diag(np.diag(normal) + 1e-12)
                step = -solve_square(scaled, slope).values
                moved[free] += step
                away = moved[free] - start
                if self._oscillates(moved):
                    trial = self._evaluate(moved)
                    cost = trial.cost + float(firm @ away**2)
                    if cost < costs[-1]:
                        break
                damping *= 6.0
            else:
                break
            self._model = replace(self._model, vector=moved)
            point, damping, before = trial, max(damping / 6.0, 1e-6), slope
            slope = self._slope(point)[free] + firm * away
            normal = _bent(normal, step, slope - before)
            costs.append(cost)
            if cost > _FEWER * costs[-_WINDOW:][0] and len(costs) > _WINDOW:
                break
        return replace(self._model, output=point.output, deviations=None)

    def deviations(self, names: Sequence[str]) -> FloatArray:
        """Return the standard deviations of the named parameters, shape (size,); 0 of others.

        They are those of the residual; that of a parameter without influence is infinite.
        """
        names, free = self._free(names)
        point = self._evaluate(self._model.vector)
        normal = self._normal(point, names)
        scale = np.sqrt(np.clip(np.diag(normal), 1e-300, None))
        spread = np.diag(np.linalg.pinv(normal / np.outer(scale, scale), 1e-12, hermitian=True))
        found = np.zeros(self._model.layout.size)
        found[free] = np.sqrt(np.abs(spread) * point.cost / self._count) / scale
        found[free[scale < 1e-9 * scale.max()]] = np.inf
        return found

    def _oscillates(self, vector: FloatArray) -> bool:
        """Return whether every mode is one at every level: a long step can leave none."""
        levels = np.concatenate([each.level for each in self._data.drives])
        with np.errstate(over='ignore'):
            omega, damping = replace(self._model, vector=vector).modes_at(levels)
        return bool(((omega > 0.0) & (damping < 1.0)).all())

    def _free(self, names: Sequence[str]) -> tuple[list[str], IntArray]:
        """Return the names that have parameters in this layout, and their places."""
        places = self._model.layout.places
        names = [name for name in names if places[name][0].stop > places[name][0].start]
        return names, np.concatenate([np.r_[places[name][0]] for name in names])

    def _rows(self, model: ModalModel, place: int) -> tuple[FloatArray, FloatArray]:
        """Return weighted signals and the weighted earlier measurement."""
        signals = model.signals(self._data.drives[place])
        weight = self._data.weights[place]
        early = float(model.parameters['delay'][0]) / model.dt
        target = delayed(self._data.measured[place], -early)
        return weight * (signals - signals.mean(0)), weight * target

    def _evaluate(self, vector: FloatArray) -> _Point:
        model = replace(self._model, vector=vector)
        places = range(len(self._data.drives))
        found = of_each(lambda place: self._rows(model, place), places, self._workers)
        rows, target = (list(each) for each in zip(*found, strict=True))
        gram = sum(each.T @ each for each in rows)
        right = sum(x.T @ y for x, y in zip(rows, target, strict=True))
        scale = np.sqrt(np.diag(gram))
        scale = np.where(scale > 0.0, scale, 1.0)  # a play wider than the voltage never moves
        gram = gram / np.outer(scale, scale) + _RIDGE * np.eye(scale.size)
        output = np.linalg.solve(gram, right / scale[:, None]) / scale[:, None]
        residual = [y - x @ output for x, y in zip(rows, target, strict=True)]
        inverse = np.linalg.inv(gram) / np.outer(scale, scale)
        return _Point(rows, output, residual, inverse)

    def _normal(self, point: _Point, names: Sequence[str]) -> FloatArray:
        """Return the normal matrix of the named parameters, with feedback taken as a gain."""
        model = replace(self._model, output=point.output)

        def part(place: int) -> tuple[FloatArray, FloatArray]:
            weight, drive = self._data.weights[place], self._data.drives[place]
            made = ModalDerivatives(model, drive, point.rows[place] / weight)
            return self._sums(weight * made.of(list(names)), _lines(point.rows[place]))

        places = range(len(self._data.drives))
        normals, crosses = zip(*of_each(part, places, self._workers), strict=True)
        normal, cross = sum(normals), sum(crosses)
        solved = np.einsum('fg,pgo->pfo', point.gram, cross)
        return np.asarray(normal - np.einsum('pfo,qfo->pq', cross, solved, optimize=True))

    def _slope(self, point: _Point) -> FloatArray:
        """Return half the exact slope of the cost by all parameters, shape (size,)."""
        model = replace(self._model, output=point.output)

        def part(place: int) -> FloatArray:
            residual, drive = point.residual[place], self._data.drives[place]
            by_signals = -self._data.weights[place] * residual @ model.output.T
            slope = gradient(model, drive, by_signals)
            early = residual + point.rows[place] @ model.output  # what was measured
            turn = 2j * np.pi * np.fft.rfftfreq(early.shape[0], model.dt)[:, None]
            rate = np.fft.irfft(turn * np.fft.rfft(early, axis=0), early.shape[0], axis=0)
            slope[model.layout.places['delay'][0]] = np.sum(residual * rate)
            return slope

        return np.asarray(sum(of_each(part, range(len(self._data.drives)), self._workers)))

    @staticmethod
    def _sums(derivatives: ComplexArray, x: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Return products of the derivatives with themselves and with the signals."""
        flat = np.ascontiguousarray(derivatives.reshape(derivatives.shape[0], -1)).view(float)
        normal = np.asarray(flat @ flat.T, float)
        cross = np.real(np.einsum('plo,lf->pfo', derivatives, x.conj(), optimize=True))
        return normal, cross


def _bent(normal: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """Return the curvature with the change of the slope over a step (BFGS, damped by Powell)."""
    along = normal @ step
    expected, seen = float(step @ along), float(step @ change)
    if not expected > 0.0:
        return normal
    if seen < 0.2 * expected:
        part = 0.8 * expected / (expected - seen)
        change, seen = part * change + (1.0 - part) * along, 0.2 * expected
    return np.asarray(normal - np.outer(along, along) / expected + np.outer(change, change) / seen)
