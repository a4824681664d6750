"""Newest samples of one actuator, merged from several topics by sample number."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray

# Messages of one writer are ordered; a larger step back is a restart of the writer.
REORDERED = 64
CAPACITY = 1 << 17
NANO = 1e-9
# Smallest number of samples over which the sampling interval is measured.
INTERVALS = 1000


@dataclass(frozen=True)
class State:
    """One tick of an actuator."""

    sample: int  # number of the tick
    stamp: int  # its time [ns]
    voltage: float  # voltage [V]
    displacement: float  # displacement [m]


@dataclass(frozen=True)
class Window:
    """The last samples, one per tick; missing ones are NaN."""

    first: int  # number of the first sample
    dt: float  # sampling interval [s]
    voltage: FloatArray  # signals [V], shape (n,)
    displacement: FloatArray  # [m], shape (n,)
    reference: FloatArray  # [m], shape (n,)

    def __len__(self) -> int:
        return int(self.voltage.size)

    @property
    def newest(self) -> int:
        """Number of the last sample."""
        return self.first + len(self) - 1

    @property
    def error(self) -> FloatArray:
        """Measured minus desired displacement [m], NaN where there is no reference."""
        return self.displacement - self.reference

    @property
    def tracked(self) -> bool:
        """Whether the samples of the last 0.1 s have a reference."""
        recent = self.reference[-max(2, round(0.1 / self.dt)) :]
        return bool(np.any(np.isfinite(recent)))

    def last(self, seconds: float) -> Window:
        """Return the end of the window."""
        n = min(len(self), max(1, round(seconds / self.dt)))
        cut = slice(len(self) - n, None)
        return Window(
            self.first + len(self) - n,
            self.dt,
            self.voltage[cut],
            self.displacement[cut],
            self.reference[cut],
        )


class Signals:
    """Buffer of the newest samples, written by one thread and read by others."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._lock = threading.Lock()
        self._capacity = capacity
        self._clear()

    def _clear(self) -> None:
        self._newest = -1
        self._dt = 1e-3
        self._anchors: list[tuple[int, int]] = []
        self._number = np.full(self._capacity, -1, np.int64)
        self._stamp = np.zeros(self._capacity, np.int64)
        self._voltage = np.zeros(self._capacity)
        self._displacement = np.zeros(self._capacity)
        self._referred = np.full(self._capacity, -1, np.int64)
        self._reference = np.zeros(self._capacity)

    @property
    def newest(self) -> int:
        """Number of the newest sample, -1 before the first."""
        return self._newest

    @property
    def rate(self) -> float:
        """Sampling rate [Hz] from the time stamps."""
        return 1.0 / self._dt

    def add_states(self, states: Sequence[State]) -> None:
        """Add samples of the actuator, in order."""
        with self._lock:
            for state in states:
                if state.sample < self._newest - REORDERED:
                    self._clear()
                if not self._anchors:
                    self._anchors = [(state.sample, state.stamp)] * 2
                slot = state.sample % self._capacity
                self._number[slot] = state.sample
                self._stamp[slot] = state.stamp
                self._voltage[slot] = state.voltage
                self._displacement[slot] = state.displacement
                self._newest = max(self._newest, state.sample)
            if states:
                self._measure_interval()

    def add_references(self, samples: Sequence[int], displacements: Sequence[float]) -> None:
        """Add desired displacements [m], which arrive a tick before their states."""
        with self._lock:
            for sample, displacement in zip(samples, displacements, strict=True):
                slot = sample % self._capacity
                self._referred[slot] = sample
                self._reference[slot] = displacement

    def _measure_interval(self) -> None:
        """Measure the interval from the newest stamp and one 1000 to 2000 samples before it."""
        newest = self._newest, int(self._stamp[self._newest % self._capacity])
        (sample, stamp), later = self._anchors
        if newest[0] > sample and newest[1] > stamp:
            self._dt = NANO * (newest[1] - stamp) / (newest[0] - sample)
        if newest[0] - later[0] > INTERVALS:
            self._anchors = [later, newest]

    def window(self, seconds: float) -> Window:
        """Return the last `seconds`, as far as available; at most half of the buffer."""
        with self._lock:
            size = min(max(1, round(seconds / self._dt)), self._capacity // 2)
            count = min(size, self._newest + 1)
            first = self._newest + 1 - count
            numbers: IntArray = np.arange(first, first + count, dtype=np.int64)
            slots = numbers % self._capacity
            here = self._number[slots] == numbers
            referred = self._referred[slots] == numbers
            return Window(
                first,
                self._dt,
                np.where(here, self._voltage[slots], np.nan),
                np.where(here, self._displacement[slots], np.nan),
                np.where(referred, self._reference[slots], np.nan),
            )
