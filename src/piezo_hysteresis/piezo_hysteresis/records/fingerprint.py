"""A few numbers by which the same measurement is recognised under another name or in another file.

They are sums over all samples with fixed irregular weights. Rounding, such as that of a CSV file,
changes them by less than the noise does between two repeats of an experiment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import comb, isclose, sqrt
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.record import Record

_MULTIPLIERS = (58_321, 74_933, 90_821, 103_091, 131_111, 176_041)
_SUMS = len(_MULTIPLIERS)
# Samples that are weighed at a time.
_BLOCK = 1 << 16
_TURN = 1 << 20
# A copy differs by its rounding, two repeats by 1.4 times their noise. Six sums of two repeats
# agree within this share of the noise once in (2 * 0.2 / 1.4 / sqrt(2 pi))^-6 = 5e5 pairs.
_OF_NOISE = 0.2
# Below this share of the standard deviation a signal or a change of a command is negligible.
_NOTHING, _SAME_COMMAND = 1e-6, 1e-4
# The noise is estimated from differences of this order, to which slow drives contribute little.
_ORDER = 8


@dataclass(frozen=True)
class Fingerprint:
    """Fingerprint that identifies a record.

    Attributes
    ----------
    name : str
        Name of the record; not compared.
    samples : int
        Number of samples.
    dt : float
        Sampling interval [s].
    sums : str
        Of voltage and displacement, as hexadecimal numbers of four bytes: the standard deviation,
        then sums with irregular weights over the root of the number of samples [V or N, m].
    """

    name: str
    samples: int
    dt: float
    sums: str

    @classmethod
    def of(cls, record: Record) -> Fingerprint:
        """Return the fingerprint of a record."""
        sums = np.concatenate([_sums(record.voltage, 1), _sums(record.displacement, _SUMS)])
        dt = float(f'{record.dt:.9g}')
        return cls(record.name, len(record), dt, sums.astype('>f4').tobytes().hex())

    def is_of(self, record: Record) -> bool:
        """Return whether the samples of a record are those that this is of, but for rounding."""
        if self.samples != len(record) or not isclose(self.dt, record.dt, rel_tol=1e-5):
            return False
        known = np.frombuffer(bytes.fromhex(self.sums), '>f4').astype(np.float64)
        allowed = max(_OF_NOISE * _noise(record.displacement), _NOTHING)
        return _agree(known[:2], record.voltage, _SAME_COMMAND) and _agree(
            known[2:], record.displacement, min(allowed, _SAME_COMMAND)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return a row of plain types."""
        return asdict(self)

    @classmethod
    def parse(cls, row: Mapping[str, Any]) -> Fingerprint:
        """Read a row that `to_dict` gave.

        Raises
        ------
        RecordError
            If it is none.
        """
        try:
            found = cls(str(row['name']), int(row['samples']), float(row['dt']), str(row['sums']))
            if len(bytes.fromhex(found.sums)) != 4 * (_SUMS + 3):
                raise ValueError
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(
                'a fitted record is described by name, samples, dt and sums; remove the row or '
                'identify again'
            ) from error
        return found


def fingerprints(records: Sequence[Record]) -> tuple[Fingerprint, ...]:
    """Return the fingerprint of each record."""
    return tuple(map(Fingerprint.of, records))


def recognised(records: Sequence[Record], known: Sequence[Fingerprint]) -> list[str]:
    """Return the names of those records that are among the known ones."""
    return [record.name for record in records if any(each.is_of(record) for each in known)]


def _sums(samples: FloatArray, count: int) -> FloatArray:
    """Return the standard deviation and `count` sums, shape (count + 1,)."""
    mean, totals = samples.mean(), np.zeros(count)
    for begin in range(0, samples.size, _BLOCK):
        deviation = samples[begin : begin + _BLOCK] - mean
        place = np.arange(begin, begin + deviation.size, dtype=np.int64)
        square = place * place % _TURN
        for k, each in enumerate(_MULTIPLIERS[:count]):
            totals[k] += np.cos((2.0 * np.pi / _TURN) * (square * each % _TURN)) @ deviation
    return np.array([float(samples.std()), *(totals / sqrt(samples.size))])


def _agree(known: FloatArray, samples: FloatArray, allowed: float) -> bool:
    apart = np.abs(_sums(samples, known.size - 1) - known)
    return bool(np.all(apart <= allowed * float(samples.std()) + 1e-300))


def _noise(samples: FloatArray) -> float:
    """Return the noise of one sample over the standard deviation of all, about."""
    spread = float(samples.std())
    if samples.size <= _ORDER or spread <= 0.0:
        return 0.0
    size = 1.4826 * float(np.median(np.abs(np.diff(samples, _ORDER))))
    return size / sqrt(comb(2 * _ORDER, _ORDER)) / spread
