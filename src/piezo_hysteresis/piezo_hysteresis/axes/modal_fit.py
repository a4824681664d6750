"""Fit of a modal model in free run: Levenberg-Marquardt with the output matrix projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.modal_derivatives import ModalDerivatives
from piezo_hysteresis.axes.modal_model import AxesDrive, ModalLayout, ModalModel, delayed, drive_of
from piezo_hysteresis.identification.thread_pool import of_each
from piezo_hysteresis.numerics.linalg import solve_square

_RIDGE = 1e-9
_FEWER = 0.9995  # a smaller gain of the sum of squares ends the fit
_TRIALS = 7
# Weights of the distances from the start of a fit, in residuals of one sample: the records do not
# determine the scale of a shape before the elongation acts.
_LOOSE = {'log_omega': 100.0, 'log_damping': 5.0, 'shape': 10.0, 'rate_shape': 10.0}


@dataclass(eq=False)
class FitData:
    """Records as a fit needs them."""

    drives: list[AxesDrive]  # their voltages
    measured: list[FloatArray]  # displacements without their means, each of shape (n, outputs) [m]
    weights: FloatArray  # of each record [1/m], shape (records,)

    @classmethod
    def of(
        cls, records: Sequence[AxesRecord], layout: ModalLayout, weights: FloatArray
    ) -> FitData:
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

    def __init__(self, model: ModalModel, data: FitData, workers: int = 1) -> None:
        self._model, self._data, self._workers = model, data, workers
        self._count = sum(each.size for each in data.measured)

    def run(self, names: Sequence[str], turns: int, damping: float = 1e-2) -> ModalModel:
        """Fit the named parameters in up to `turns` steps; return the model."""
        names, free = self._free(names)
        point = self._evaluate(self._model.vector)
        start, places = self._model.vector[free], self._model.layout.places
        loose = np.concatenate([np.full(np.prod(places[n][1]), _LOOSE.get(n, 0.0)) for n in names])
        firm = loose**2 * point.cost / self._count
        for _ in range(turns):
            normal, slope = self._jacobian(point, names)
            away = self._model.vector[free] - start
            normal, slope = normal + np.diag(firm), slope + firm * away
            before = point.cost + float(firm @ away**2)
            for _ in range(_TRIALS):
                moved = self._model.vector.copy()
                scaled = normal + damping * np.diag(np.diag(normal) + 1e-12)
                moved[free] -= solve_square(scaled, slope).values
                trial = self._evaluate(moved)
                after = trial.cost + float(firm @ (moved[free] - start) ** 2)
                if after < before:
                    break
                damping *= 6.0
            else:
                break
            self._model = replace(self._model, vector=moved)
            point, damping = trial, max(damping / 6.0, 1e-6)
            if after > _FEWER * before:
                break
        return replace(self._model, output=point.output, deviations=None)

    def deviations(self, names: Sequence[str]) -> FloatArray:
        """Return the standard deviations of the named parameters, shape (size,); 0 of others.

        They are those of the residual; that of a parameter without influence is infinite.
        """
        names, free = self._free(names)
        point = self._evaluate(self._model.vector)
        normal, _ = self._jacobian(point, names)
        scale = np.sqrt(np.clip(np.diag(normal), 1e-300, None))
        spread = np.diag(np.linalg.pinv(normal / np.outer(scale, scale), 1e-12, hermitian=True))
        found = np.zeros(self._model.layout.size)
        found[free] = np.sqrt(np.abs(spread) * point.cost / self._count) / scale
        found[free[scale < 1e-9 * scale.max()]] = np.inf
        return found

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
        scale = np.sqrt(np.diag(gram)) + 1e-300
        gram = gram / np.outer(scale, scale) + _RIDGE * np.eye(scale.size)
        output = np.linalg.solve(gram, right / scale[:, None]) / scale[:, None]
        residual = [y - x @ output for x, y in zip(rows, target, strict=True)]
        inverse = np.linalg.inv(gram) / np.outer(scale, scale)
        return _Point(rows, output, residual, inverse)

    def _jacobian(self, point: _Point, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrix and the slope of the named parameters."""
        model = replace(self._model, output=point.output)

        def part(place: int) -> tuple[FloatArray, FloatArray, FloatArray]:
            weight = self._data.weights[place]
            signals = point.rows[place] / weight
            made = ModalDerivatives(model, self._data.drives[place], signals)
            return self._sums(weight * made.of(list(names)), point, place)

        places = range(len(self._data.drives))
        normals, slopes, crosses = zip(*of_each(part, places, self._workers), strict=True)
        normal, slope, cross = sum(normals), sum(slopes), sum(crosses)
        solved = np.einsum('fg,pgo->pfo', point.gram, cross)
        normal = normal - np.einsum('pfo,qfo->pq', cross, solved, optimize=True)
        return normal, slope

    @staticmethod
    def _sums(
        derivatives: FloatArray, point: _Point, place: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return products of the derivatives with themselves, the residual and the signals."""
        scale = np.sqrt(2.0 / point.rows[place].shape[0])
        x = np.fft.rfft(point.rows[place], axis=0)[1:] * scale
        e = np.fft.rfft(point.residual[place], axis=0)[1:] * scale
        flat = derivatives.reshape(derivatives.shape[0], -1)
        flat = np.ascontiguousarray(flat).view(np.float64)
        normal = flat @ flat.T
        slope = -np.real(np.tensordot(derivatives, e.conj(), ((1, 2), (0, 1))))
        cross = np.real(np.einsum('plo,lf->pfo', derivatives, x.conj(), optimize=True))
        return normal, slope, cross
