"""One experiment with several voltages and several displacements on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import NoReturn

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import counted, not_numbers
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, RecordInfo

SAME_LEVEL = 0.05  # records whose RMS voltages differ by a smaller part are of one level
SAME_PERIOD = 0.1  # the voltages of periods may differ by this part of their RMS


@dataclass(frozen=True, eq=False, repr=False)
class AxesRecord:
    """One experiment at a constant rate; records are compared by identity.

    ``voltage[k, i]`` is commanded to input i at tick k; ``displacement[k, j]`` is measured at
    output j at tick k, before that voltage acts. Inputs and outputs may differ in number.

    Attributes
    ----------
    name : str
        Unique within a data set.
    dt : float
        Sampling interval [s].
    voltage : ndarray, shape (n, inputs)
        Commanded inputs [V].
    displacement : ndarray, shape (n, outputs)
        Measured displacements [m].
    periods : int
        Number of whole periods of a steady state that the record holds; 0: it starts anywhere.
    level : str
        Group of records of one amplitude; empty: none is stated.

    Raises
    ------
    RecordError
        If an array is empty, has no columns or is not finite, their lengths differ, ``dt`` is not
        positive, or the samples are no whole periods of the same voltage.
    """

    name: str
    dt: float
    voltage: FloatArray
    displacement: FloatArray
    periods: int = 0
    level: str = ''

    def __post_init__(self) -> None:
        if not (isinstance(self.dt, Real) and np.isfinite(self.dt) and self.dt > 0):
            self._refuse(f'the sampling interval must be a positive number [s], got {self.dt!r}')
        for what in ('voltage', 'displacement'):
            object.__setattr__(self, what, self._checked(what, getattr(self, what)))
        if len(self.displacement) != len(self):
            self._refuse(
                f'the displacements have {counted(len(self.displacement), "sample")} but the '
                f'voltages {len(self)}; export both from the same clock'
            )
        if not (isinstance(self.periods, int | np.integer) and self.periods >= 0):
            self._refuse(f'periods is a whole number from 0 on, got {self.periods!r}')
        if self.periods and len(self) % self.periods:
            self._refuse(
                f'{counted(len(self), "sample", "is")} not '
                f'{counted(self.periods, "whole period")}; cut it to whole ones, '
                'or state their number'
            )
        if self.periods > 1:
            self._check_repetition()

    def _check_repetition(self) -> None:
        by_period = self._by_period(self.voltage)
        apart = float(np.sqrt(np.mean((by_period - by_period.mean(axis=0)) ** 2)))
        if apart > SAME_PERIOD * float(self.voltage.std()):
            self._refuse(
                f'the voltages of its {self.periods} periods differ by {apart:.3g} V RMS; state '
                'the number of whole periods that it holds'
            )

    def _checked(self, what: str, given: object) -> FloatArray:
        try:
            array = np.ascontiguousarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            self._refuse(f'{what} must be an array of numbers, not of type {type(given).__name__}')
        if array.ndim != 2 or array.size == 0:
            self._refuse(f'{what} must have the shape (samples, axes), got {array.shape}')
        bad = np.argwhere(~np.isfinite(array))
        if bad.size:
            self._refuse(
                f'{what} has {counted(len(bad), "value")} that '
                f'{not_numbers(len(bad))}, the first at sample '
                f'{bad[0, 0]} of axis {bad[0, 1] + 1}; cut or mend them'
            )
        return array

    def _refuse(self, what: str) -> NoReturn:
        raise RecordError(f'record {self.name}: {what}')

    def __len__(self) -> int:
        return int(self.voltage.shape[0])

    def __repr__(self) -> str:
        steady = f', {counted(self.periods, "period")} in steady state' if self.periods else ''
        return (
            f'AxesRecord {self.name}: {counted(self.axes, "voltage")}, '
            f'{counted(self.outputs, "displacement")}, '
            f'{counted(len(self), "sample")} at {self.rate:g} Hz{steady}'
        )

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.dt

    @property
    def axes(self) -> int:
        """Number of voltages."""
        return int(self.voltage.shape[1])

    @property
    def outputs(self) -> int:
        """Number of displacements."""
        return int(self.displacement.shape[1])

    @property
    def noise(self) -> FloatArray | None:
        """Noise of one period by output [m RMS], shape (outputs,); None without two periods.

        Found from the deviation of the periods from their mean; the mean of P periods has
        ``noise / sqrt(P)``.
        """
        if self.periods < 2:
            return None
        spread = self._by_period(self.displacement).var(axis=0, ddof=1)
        return np.asarray(np.sqrt(spread.mean(axis=0)), np.float64)

    def _by_period(self, array: FloatArray) -> FloatArray:
        """Return samples as (periods, samples a period, channels)."""
        return array.reshape(max(self.periods, 1), -1, array.shape[1])

    def axis(self, i: int, j: int | None = None) -> Record:
        """Return input i with output j (that of the same number) as a record of one axis.

        Raises
        ------
        RecordError
            If there is no such input or output.
        """
        j = i if j is None else j
        if not (0 <= i < self.axes and 0 <= j < self.outputs):
            self._refuse(
                f'it has no pair of input {i} and output {j}; inputs are 0 to {self.axes - 1}, '
                f'outputs 0 to {self.outputs - 1}'
            )
        return Record(
            f'{self.name}/axis_{i + 1}' + (f'_to_{j + 1}' if j != i else ''),
            self.dt,
            self.voltage[:, i],
            self.displacement[:, j],
            info=RecordInfo(start='settled' if self.periods else 'auto'),
        )

    def mean_period(self) -> AxesRecord:
        """Return the mean of the periods as one period.

        Raises
        ------
        RecordError
            If the record holds no whole periods.
        """
        if not self.periods:
            self._refuse('it holds no whole periods; state their number, as in periodic=2')
        return replace(
            self,
            voltage=self._by_period(self.voltage).mean(axis=0),
            displacement=self._by_period(self.displacement).mean(axis=0),
            periods=1,
        )

    def section(self, first: int, last: int) -> AxesRecord:
        """Return samples ``first`` to ``last - 1``; whole periods of a steady state stay such."""
        cut = slice(first, last)
        voltage = self.voltage[cut]
        periods = self.periods * len(voltage) / len(self)
        return replace(
            self,
            voltage=voltage,
            displacement=self.displacement[cut],
            periods=int(periods) if periods.is_integer() else 0,
        )


def leveled(records: Sequence[AxesRecord]) -> list[AxesRecord]:
    """Return records with a level: those that state none are grouped by their RMS voltage."""
    groups: list[tuple[float, str]] = []
    result = []
    for record in records:
        if not record.level:
            size = float(np.sqrt(np.mean(np.var(record.voltage, axis=0))))
            near = [name for rms, name in groups if abs(size - rms) <= SAME_LEVEL * rms]
            if not near:
                near = [f'{size:.3g} V RMS']
                groups.append((size, near[0]))
            record = replace(record, level=near[0])
        result.append(record)
    return result
