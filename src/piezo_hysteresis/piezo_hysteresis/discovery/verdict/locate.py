"""Decomposition of the residual by record, frequency and harmonic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.numerics.harmonics import harmonics


@dataclass(frozen=True)
class Place:
    """Rms residual of one harmonic in one record."""

    record: str  # name of the record
    frequency: float  # drive frequency [Hz]; 0 without a periodic drive
    harmonic: int  # harmonic order; 0 is the mean, -1 the remaining residual
    rms: float  # rms residual of this harmonic [m]


def places(data: Dataset, views: Sequence[Target], errors: Sequence[FloatArray]) -> list[Place]:
    """Return the rms residual by record and harmonic, largest first."""
    found = []
    for view, error in zip(views, errors, strict=True):
        found += _of_view(view, error, data.periods[view.name])
    return sorted(found, key=lambda place: -place.rms)


def _of_view(view: Target, error: FloatArray, period: int) -> list[Place]:
    frequency = view.frequency or (1.0 / (period * view.dt) if period else 0.0)
    if frequency <= 0.0 or error.size * view.dt * frequency < 1.0:
        level = float(error.mean())
        rest = float(np.std(error))
        return [
            Place(view.name, view.frequency, 0, abs(level)),
            Place(view.name, view.frequency, -1, rest),
        ]
    orders, phasors, left = harmonics(error, frequency, view.dt)
    sizes = np.abs(phasors) / np.sqrt(2.0)
    sizes[0] *= np.sqrt(2.0)
    rows = [
        Place(view.name, view.frequency, order, float(size))
        for order, size in zip(orders, sizes, strict=True)
    ]
    return [*rows, Place(view.name, view.frequency, -1, left)]
