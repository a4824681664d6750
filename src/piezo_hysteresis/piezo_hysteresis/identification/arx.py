"""Transfer function in s from records by ARX least squares, as in Xiao 2014.

``A(s) y = B(s) u + c`` is regressed on signals filtered by ``s^i / D(s)``. This is as well
conditioned at 10 kHz as at 100 Hz; in z the poles of a slow actuator cluster at 1. The equation
error depends on D, and noise biases the poles. D is therefore A of the previous iteration
(Steiglitz and McBride), which minimises the free-run error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import counted, reason_of
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.jit import jit
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.records import Record

#: Voltage [V] and displacement [m] of one record, from rest.
Pair = tuple[FloatArray, FloatArray]

_ROUNDS = 30
_STILL = 1e-9
# Corner frequencies of the initial filters, as shares of the sampling rate in rad/s.
_CORNERS = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)


@dataclass(frozen=True)
class TransferFunction:
    """Numerator and denominator in s, from the voltage [V] to the displacement [m]."""

    numerator: tuple[float, ...]  # coefficients
    denominator: tuple[float, ...]  # the highest power first; the denominator begins with 1
    rate: float  # sampling rate of the fitted records [Hz]
    nrmse_percent: float  # free-run error relative to the standard deviation of the displacement

    @property
    def gain(self) -> float:
        """Static gain [m/V]."""
        return self.numerator[-1] / self.denominator[-1]

    def save(self, path: str | Path) -> None:
        """Write the transfer function as YAML."""
        content = {
            'numerator': list(self.numerator),
            'denominator': list(self.denominator),
            'rate': self.rate,
            'nrmse_percent': self.nrmse_percent,
        }
        target = Path(path)
        try:
            with write_atomically(target) as temporary:
                temporary.write_text(yaml.safe_dump(content, sort_keys=False), 'utf-8')
        except OSError as error:
            raise IdentificationError(
                f'{path}: it cannot be written ({reason_of(error)})'
            ) from None

    @classmethod
    def load(cls, path: str | Path) -> TransferFunction:
        """Read a transfer function from a file written by `save`."""
        try:
            content: Any = plain_yaml.load_file(path)
            top, bottom = (tuple(map(float, content[k])) for k in ('numerator', 'denominator'))
            found = cls(top, bottom, float(content.get('rate', 0.0)),
                        float(content.get('nrmse_percent', 'nan')))  # fmt: skip
        except OSError as error:
            raise IdentificationError(f'{path}: it cannot be read ({reason_of(error)})') from None
        except (TypeError, KeyError, ValueError, OverflowError, AttributeError, yaml.YAMLError):
            raise IdentificationError(
                f'{path} is no transfer function; it needs numerator and denominator, lists of '
                'numbers with the highest power of s first'
            ) from None
        if not (top and bottom and np.all(np.isfinite([*top, *bottom])) and bottom[0] != 0.0):
            raise IdentificationError(f'{path}: numerator and denominator must be finite, not 0')
        return found


def fit_transfer_function(
    records: Sequence[Record], order: int = 3, zeros: int = 1, *, rounds: int = _ROUNDS
) -> TransferFunction:
    """Fit a transfer function to records of one sampling rate, as Xiao 2014 (4)."""
    if not 1 <= order <= 8 or not 0 <= zeros < order:
        raise IdentificationError(
            f'a transfer function has 1 to 8 poles and fewer zeros, got {order} and {zeros}'
        )
    if len({record.dt for record in records}) != 1:
        raise IdentificationError('a linear fit needs records of one sampling rate; resample them')
    dt = records[0].dt
    data = [_moved(record, order) for record in records]
    found = [_fitted(data, dt, order, zeros, corner / dt, rounds) for corner in _CORNERS]
    misfit, top, bottom = min(found, key=lambda each: each[0])
    if not np.isfinite(misfit):
        raise IdentificationError(
            f'no stable system of {order} poles and {zeros} zeros answers like these records; '
            'take fewer, or record smaller and faster moves'
        )
    return TransferFunction(tuple(top), tuple(bottom), 1.0 / dt, 100.0 * misfit)


def _fitted(
    data: Sequence[Pair], dt: float, order: int, zeros: int, corner: float, rounds: int
) -> tuple[float, list[float], list[float]]:
    """Return misfit, numerator and denominator of the best iteration for one initial filter."""
    filters: FloatArray = np.asarray(np.poly(np.full(order, -corner)), dtype=np.float64)
    best: tuple[float, list[float], list[float]] = (float('inf'), [], [])
    for _ in range(rounds + 1):
        solved = _equation(data, dt, filters, zeros)
        if solved is None or np.max(np.roots(solved[1]).real) >= 0.0:
            break
        top, bottom = solved
        misfit = _misfit(data, dt, top, bottom)
        if misfit < best[0]:
            best = misfit, [float(v) for v in top], [float(v) for v in bottom]
        if np.max(np.abs(bottom - filters) / np.abs(bottom)) <= _STILL:
            break
        filters = bottom
    return best


def _moved(record: Record, order: int) -> Pair:
    """Return voltage and displacement relative to rest, scaled to equal size."""
    if len(record) - record.warm_up_samples < 20 * order:
        raise IdentificationError(
            f'record {record.name} has {counted(len(record), "sample")}, too few for '
            f'{counted(order, "pole")}'
        )
    u, y = record.voltage, record.displacement
    if not (np.all(np.isfinite(u)) and np.all(np.isfinite(y))):
        raise IdentificationError(f'record {record.name} has lost samples; leave it out')
    if not (np.ptp(u) > 0 and np.ptp(y) > 0):
        raise IdentificationError(f'record {record.name} does not move')
    first = record.warm_up_samples
    return u[first:] - u[first], y[first:] - y[first]


def _equation(
    data: Sequence[Pair], dt: float, filters: FloatArray, zeros: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return B and A by least squares on the equation filtered by ``1 / filters``."""
    order = filters.size - 1
    rows, right = [], []
    for k, (u, y) in enumerate(data):
        ys = [_through(np.eye(order + 1)[i], filters, y, dt, 'foh') for i in range(order + 1)]
        us = [
            _through(np.eye(order + 1)[order - i], filters, u, dt, 'zoh')
            for i in range(zeros, -1, -1)
        ]
        own = _unknown(filters, u.size, dt)
        apart = np.zeros((u.size, len(data) * own.shape[1]))
        apart[:, k * own.shape[1] : (k + 1) * own.shape[1]] = own
        rows.append(np.column_stack([*(-each for each in ys[1:]), *us, apart]))
        right.append(ys[0])
    matrix, target = np.vstack(rows), np.concatenate(right)
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(target))):
        return None
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    solved = solve_least_squares(matrix / size, target, rcond=1e-13)
    if not solved.sound:
        return None
    values = solved.values / size
    top: FloatArray = values[order : order + zeros + 1]
    return top, np.concatenate([[1.0], values[:order]])


def _unknown(bottom: FloatArray, count: int, dt: float) -> FloatArray:
    """Return the regressors of one record: its offset and its decaying initial states."""
    order = bottom.size - 1
    pulse = np.zeros(count)
    pulse[0] = 1.0
    fading = [_through(np.eye(order + 1)[i + 1], bottom, pulse, dt, 'zoh') for i in range(order)]
    zero = _through(np.eye(order + 1)[order], bottom, np.ones(count), dt, 'zoh')
    return np.column_stack([zero, *fading])


def _through(
    top: FloatArray, bottom: FloatArray, signal: FloatArray, dt: float, method: str
) -> FloatArray:
    """Return a signal filtered by ``top / bottom`` in s, with a hold of zero or first order."""
    from scipy.signal import cont2discrete, tf2ss

    # in time of the filter, so that the powers of s have similar magnitude
    pace = float(abs(bottom[-1])) ** (1.0 / (bottom.size - 1))
    powers = pace ** np.arange(bottom.size)
    scaled = bottom / powers
    a, b, c, d = tf2ss(np.trim_zeros(top, 'f') if np.any(top) else np.zeros(1), scaled)
    system = cont2discrete((a, b, c, d), dt * pace, method)
    answer = np.zeros(signal.size)
    state = np.zeros(len(a))
    _run(system[0], system[1][:, 0], system[2][0], float(system[3][0, 0]), signal, state, answer)
    lead = top.size - 1 - int(np.flatnonzero(top)[0]) if np.any(top) else 0
    answer *= pace ** (lead - (bottom.size - 1))
    return answer


@jit
def _run(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    d: float,
    signal: FloatArray,
    state: FloatArray,
    answer: FloatArray,
) -> None:
    """Return the output of a sampled linear system, sample by sample."""
    n = state.size
    after = np.zeros(n)
    for k in range(signal.size):
        total = d * signal[k]
        for i in range(n):
            total += c[i] * state[i]
            row = b[i] * signal[k]
            for j in range(n):
                row += a[i, j] * state[j]
            after[i] = row
        for i in range(n):
            state[i] = after[i]
        answer[k] = total


def _misfit(data: Sequence[Pair], dt: float, top: FloatArray, bottom: FloatArray) -> float:
    """Return the relative rms free-run error, without initial states and offsets."""
    missed = moved = 0.0
    for u, y in data:
        share = np.zeros_like(y)
        for power, weight in enumerate(top[::-1]):
            unit = np.zeros(bottom.size)
            unit[bottom.size - 1 - power] = 1.0
            share += weight * _through(unit, bottom, u, dt, 'zoh')
        known = np.column_stack([np.ones(y.size), _unknown(bottom, y.size, dt)])
        known /= np.linalg.norm(known, axis=0)
        left = y - share
        left = left - known @ solve_least_squares(known, left).values
        missed += float(np.var(left)) * y.size
        moved += float(np.var(y)) * y.size
    return float(np.sqrt(missed / moved))
