"""Correlation of the estimated parameters of a model, in a readable form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.plain import mapping, number
from piezo_hysteresis.numerics.linalg import symmetric_eigen

# Digits that are written; the rounding is corrected when a file is read.
_DIGITS = 9


@dataclass(frozen=True)
class Correlation:
    """Correlation of values that were estimated together.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    matrix : ndarray, shape (p, p)
        Symmetric, ones on the diagonal, no eigenvalue below zero.

    Raises
    ------
    ModelError
        If the matrix has another size or is no correlation.
    """

    names: tuple[str, ...]
    matrix: FloatArray

    def __post_init__(self) -> None:
        p = len(self.names)
        matrix = np.asarray(self.matrix, dtype=np.float64)
        if len(set(self.names)) != p or matrix.shape != (p, p):
            raise ModelError(
                f'the correlation of {p} values must have {p} rows and columns, one per name'
            )
        if not (np.all(np.isfinite(matrix)) and np.all(np.abs(matrix) <= 1.0 + 1e-6)):
            raise ModelError('a correlation must lie within -1 .. 1; remove it or identify again')
        object.__setattr__(self, 'matrix', _nearest(matrix))

    @classmethod
    def among(
        cls, names: Sequence[str], matrix: FloatArray, kept: Sequence[str]
    ) -> Correlation | None:
        """Return the correlation of the names in `kept`, None if unknown."""
        at = [k for k, name in enumerate(names) if name in set(kept)]
        part = np.asarray(matrix, dtype=np.float64)[np.ix_(at, at)]
        if not at or not np.all(np.isfinite(part)):
            return None
        return cls(tuple(names[k] for k in at), np.clip(part, -1.0, 1.0))

    def covariance(self, deviations: Mapping[str, float]) -> FloatArray:
        """Return the covariance for these standard deviations, shape (p, p), in SI units."""
        spread = np.array([deviations[name] for name in self.names])
        return np.asarray(self.matrix * np.outer(spread, spread))

    def to_dict(self) -> dict[str, Any]:
        """Return each name with its correlations with the names before it."""
        return {
            name: [round(float(value), _DIGITS) for value in self.matrix[k, :k]]
            for k, name in enumerate(self.names)
        }

    @classmethod
    def parse(cls, content: object) -> Correlation:
        """Read the output of `to_dict`.

        Raises
        ------
        ModelError
            If the length of a row is wrong, or a value is no correlation.
        """
        rows = mapping(content, 'correlation')
        p = len(rows)
        matrix = np.eye(p)
        for k, (name, row) in enumerate(rows.items()):
            if not isinstance(row, list) or len(row) != k:
                raise ModelError(
                    f'correlation {name} must list {k} numbers, one for each name before it'
                )
            values = [number(value, f'correlation {name}') for value in row]
            matrix[k, :k] = matrix[:k, k] = values
        return cls(tuple(rows), matrix)


def _nearest(matrix: FloatArray) -> FloatArray:
    """Return the matrix with its smallest eigenvalues corrected for rounding."""
    matrix = 0.5 * (matrix + matrix.T)
    found = symmetric_eigen(matrix)
    if found is not None and found[0].size and found[0][0] < 0.0:
        values, vectors = found
        matrix = (vectors * np.maximum(values, 0.0)) @ vectors.T
        spread = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        matrix = matrix / np.outer(spread, spread)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)
