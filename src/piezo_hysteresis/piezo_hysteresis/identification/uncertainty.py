"""Identifiability: covariance, correlated parameters, and the record that separates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import enumerated
from piezo_hysteresis.numerics.harmonics import autocorrelation
from piezo_hysteresis.numerics.linalg import column_norms, right_singular
from piezo_hysteresis.numerics.qr import inner

_Item = TypeVar('_Item')

#: Scaled condition number beyond which single parameters are not determined.
CONDITION_LIMIT = 1e6
# Share of the largest singular value that is below the accuracy of finite differences.
_ROUNDING = 1e-9
#: Correlation beyond which two parameters count as not distinguished.
CORRELATION_LIMIT = 0.995


@dataclass(frozen=True)
class Covariance:
    """Linearised uncertainty of p parameters."""

    std: FloatArray  # standard deviations, shape (p,)
    correlation: FloatArray  # correlation matrix, shape (p, p)
    condition: float  # condition number of the column-scaled Jacobian
    directions: tuple[tuple[tuple[str, float], ...], ...]  # for each undetermined direction


def covariance(factor: FloatArray, variance: float, names: Sequence[str]) -> Covariance:
    """Return the uncertainty from R of the Jacobian and the variance of one residual."""
    # factor (p, p)
    p = len(names)
    if p == 0:
        return Covariance(np.empty(0), np.empty((0, 0)), 1.0, ())
    norms = column_norms(factor)
    dead = norms <= 0.0
    found = right_singular(factor / np.where(dead, 1.0, norms))
    if found is None:
        lost_all = tuple(((name, 1.0),) for name in names)
        return Covariance(np.full(p, np.inf), np.eye(p), float('inf'), lost_all)
    singular, rows = found
    largest = float(singular[0])
    condition = largest / float(singular[-1]) if singular[-1] > 0 else float('inf')
    weak = singular < largest / CONDITION_LIMIT
    # a weak direction leaves every parameter with a part in it undetermined
    inverse = 1.0 / np.maximum(singular, largest * _ROUNDING) if largest > 0.0 else singular
    shape = (rows.T * inverse**2) @ rows
    spread = np.sqrt(np.maximum(np.diag(shape), 1e-300))
    correlation = shape / np.outer(spread, spread)
    np.fill_diagonal(correlation, 1.0)
    std = np.sqrt(max(variance, 0.0)) * spread / np.where(dead, 1.0, norms)
    lost = dead | np.any(np.abs(rows[weak]) > 0.1, axis=0)
    directions = tuple(
        tuple((names[j], float(row[j])) for j in np.argsort(-np.abs(row)) if abs(row[j]) > 0.1)
        for row in rows[weak]
    )
    return Covariance(np.where(lost, np.inf, std), correlation, condition, directions)


def inflation(residuals: Sequence[FloatArray]) -> float:
    """Return the factor by which serial correlation of residuals inflates the variance of a mean.

    It is one for white noise. For a model error, which is correlated and contains less information
    than samples, it is the integrated autocorrelation time in samples.
    """
    weight = total = 0.0
    for e in residuals:
        power = inner(e, e)
        if e.size < 8 or power <= 0.0:
            continue
        rho = autocorrelation(e)[: e.size // 2] / power
        end = int(np.argmax(rho <= 0.05)) or rho.size
        total += power * (1.0 + 2.0 * float(rho[1:end].sum()))
        weight += power
    return max(total / weight, 1.0) if weight > 0 else 1.0


def cramer_rao(factor: FloatArray, noise: float) -> FloatArray:  # factor (p, p); noise [m]
    """Return the smallest standard deviations that white noise of rms `noise` [m] allows."""
    return covariance(factor, noise**2, [str(j) for j in range(factor.shape[1])]).std


def digits(value: float, std: float) -> str:
    """Return `value` with the digits that `std` supports, as ``1.234e-04 +- 5e-07``."""
    if not np.isfinite(std):
        return 'not determined'
    if std <= 0.0 or value == 0.0:
        return f'{value:.6g}'
    place = int(np.floor(np.log10(std)))
    if abs(value) < std:
        return f'0 within {_to_place(std, place - 1)}'
    place = max(place, int(np.floor(np.log10(abs(value)))) - 8)
    return f'{_to_place(value, place)} ± {_to_place(std, place)}'


def _to_place(value: float, place: int) -> str:
    """Return a number rounded to 10^place, as a plain decimal if that is not longer."""
    if -7 < place < 5 and abs(value) < 1e6:
        return f'{round(value, -place):.{max(-place, 0)}f}'
    size = int(np.floor(np.log10(abs(value)))) if value else place
    return f'{value:.{max(size - place, 0)}e}'


_HELP = {
    frozenset({'A1', 'A'}): (
        'add records with smaller and larger amplitudes, or a slower return after a reversal: '
        'only the shape of the loop separates them'
    ),
    frozenset({'A0', 'offset'}): (
        'add a start from rest or a step in amplitude, or fix one of the two'
    ),
    frozenset({'A', 'beta'}): 'add records with a larger amplitude, in which the loop saturates',
    frozenset({'A1', 'beta'}): 'add records with a larger amplitude, in which the loop saturates',
    frozenset({'beta', 'gamma'}): 'add records with at least two amplitudes',
    frozenset({'natural_frequency', 'damping_ratio'}): (
        'add a record whose drive or one of its odd harmonics falls on the resonance, or a step'
    ),
    frozenset({'sampling_offset', 'natural_frequency'}): (
        'add records at several frequencies, one of them near the resonance'
    ),
    frozenset({'sampling_offset', 'damping_ratio'}): (
        'add records at several frequencies, one of them near the resonance'
    ),
}
_DEFAULT_HELP = 'add records at other frequencies and amplitudes, or fix one of them'


def warnings_of(result: Covariance, names: Sequence[str], values: FloatArray) -> tuple[str, ...]:
    """Return sentences on undetermined parameters, and the recommended records."""
    remarks: list[str] = []
    lost = {name for direction in result.directions for name, _ in direction}
    position = {name: k for k, name in enumerate(names)}
    for joined in _joined([{name for name, _ in each} for each in result.directions]):
        group = sorted(joined, key=position.__getitem__)
        if len(group) == 1:
            remarks.append(
                f'{group[0]} has no influence on these records: fix it, or record what excites it.'
            )
        else:
            remarks.append(
                f'{enumerated(group)} cannot be distinguished from these records: '
                f'{help_for(group)}.'
            )
    remarks += [
        f'{enumerated(group)} can hardly be distinguished from these records (correlation beyond '
        f'{CORRELATION_LIMIT}): {help_for(group)}.'
        for group in _confounded(result, names, values)
        if not set(group) <= lost
    ]
    small = [
        name
        for name, value, std in zip(names, values, result.std, strict=True)
        if np.isfinite(std) and std > abs(value) > 0 and name != 'sampling_offset'
    ]
    if small:
        which = (
            'is smaller than its uncertainty'
            if len(small) == 1
            else ('are smaller than their uncertainties')
        )
        them = 'it' if len(small) == 1 else 'them'
        remarks.append(f'{enumerated(small)} {which}: these records do not determine {them}.')
    return tuple(remarks)


def _confounded(result: Covariance, names: Sequence[str], values: FloatArray) -> list[list[str]]:
    """Return groups of correlated parameters with too few significant digits."""
    pairs: list[set[int]] = []
    for i in range(len(names)):
        for j in range(i):
            strong = abs(result.correlation[i, j]) > CORRELATION_LIMIT
            known = np.isfinite(result.std[i]) and np.isfinite(result.std[j])
            loose = max(_relative(values[k], result.std[k]) for k in (i, j)) > 0.02
            if strong and known and loose:
                pairs.append({i, j})
    return [[names[k] for k in sorted(group)] for group in _joined(pairs)]


def _joined(sets: Sequence[set[_Item]]) -> list[set[_Item]]:
    """Return the unions of all sets that share an item, directly or through others."""
    groups: list[set[_Item]] = []
    for each in sets:
        linked = [g for g in groups if g & each]
        groups = [g for g in groups if not g & each]
        groups.append(each.union(*linked))
    return groups


def _relative(value: float, std: float) -> float:
    return float(std / abs(value)) if value else float('inf')


def help_for(names: Sequence[str]) -> str:
    """Return the recommended records that determine parameters."""
    for pair, advice in _HELP.items():
        if pair <= set(names):
            return advice
    return _DEFAULT_HELP
