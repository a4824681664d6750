"""Hysteresis loops: how they are taken from a record, measured and drawn."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record
from studies.papers.exhibits import Draw, finish, loop, panels


def drawn(
    curves: Mapping[str, tuple[FloatArray, FloatArray]], label: str = 'displacement [µm]'
) -> Draw:
    """Return a drawing of loops, each in a panel of its own."""

    def draw(figure: Figure) -> None:
        for axis, (title, (u, y)) in zip(panels(figure, len(curves)), curves.items(), strict=True):
            loop(axis, u, y, '')
            axis.set(title=title, ylabel=label)

    return draw


def together(curves: Mapping[str, tuple[FloatArray, FloatArray]]) -> Draw:
    """Return a drawing of loops over one another."""

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for label, (u, y) in curves.items():
            loop(axis, u, y, label)
        finish(axis, 'input [V]', 'displacement [µm]')

    return draw


def last(record: Record, periods: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Return the last periods of a record."""
    part = slice(-round(periods / (record.info.frequency * record.dt)), None)
    return record.voltage[part], record.displacement[part]


def width(curve: tuple[FloatArray, FloatArray]) -> float:
    """Return the widest opening of a loop as a percentage of its height."""
    u, y = curve
    middle = 0.5 * (u.max() + u.min())
    near = np.abs(u - middle) < 0.06 * np.ptp(u)
    way = np.gradient(u)
    gap = abs(float(y[near & (way > 0)].mean() - y[near & (way < 0)].mean()))
    return 100.0 * gap / float(np.ptp(y))


def late(curve: tuple[FloatArray, FloatArray]) -> float:  # curve (n,)
    """Return by how much the maximum of the last displacement follows that of the input [deg]."""
    u, y = (part[-(part.size // 2) :] for part in curve)
    return 360.0 * float((np.argmax(y) - np.argmax(u)) % u.size) / u.size


def clockwise(curve: tuple[FloatArray, FloatArray]) -> bool:
    """Return whether a loop of whole periods is passed through clockwise."""
    u, y = curve
    return float(np.sum(u[:-1] * np.diff(y) - y[:-1] * np.diff(u))) < 0.0
