"""One axis of a controller: its limits, a wave in its generator, and what its recorder holds.

Nothing moves on connecting. A wave begins and ends at 0 V and is played once, so that whatever
happens to this program or the cable, the generator stands still at 0 V when the wave is over.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.drivers.gcs.connection import RUNNING, STOP, Connection, DriverError

#: Points of a wave and of a record that every controller of this kind holds.
MOST_POINTS = 60_000
_UPDATE_TIME = '0x0E000200'  # period of the servo [s]
_POSITION, _OUTPUT = 2, 7  # what the recorder holds: position [um], voltage of the output [V]
_TABLE = _GENERATOR = 1
_POINTS_PER_LINE = 100
_STEP = 0.01  # between two voltages of a ramp [s]
_AFTER = 3.0  # longest time that a wave may take more than it should [s]


@dataclass(frozen=True)
class Identity:
    """What a controller says of itself.

    Attributes
    ----------
    name, firmware : str
        Maker, model and serial number; version of the firmware.
    rate : float
        Of the servo [Hz].
    """

    name: str
    firmware: str
    rate: float


@dataclass(frozen=True)
class DriveLimits:
    """What is never exceeded.

    Attributes
    ----------
    low, high : float
        Voltage [V]; that of the controller where it is narrower.
    slew : float
        Largest rate of the voltage [V/s].
    """

    low: float = -math.inf
    high: float = math.inf
    slew: float = math.inf

    def require(self, voltages: FloatArray, rate: float) -> None:
        """Refuse a wave that leaves the limits, or does not begin and end at 0 V.

        Raises
        ------
        DriverError
            With the value that is beyond.
        """
        if not np.all(np.isfinite(voltages)):
            raise DriverError('a wave holds values that are not finite; nothing was loaded')
        least, most = float(voltages.min()), float(voltages.max())
        if least < self.low or most > self.high:
            raise DriverError(
                f'a wave of {least:g} .. {most:g} V leaves the range {self.low:g} .. {self.high:g}'
                ' V: ask for a smaller amplitude or another offset'
            )
        fastest = float(np.max(np.abs(np.diff(voltages)))) * rate
        if fastest > self.slew * (1.0 + 1e-9):
            raise DriverError(
                f'a wave moves by {fastest:.4g} V/s, the limit is {self.slew:g} V/s: ask for a '
                'lower frequency or amplitude'
            )
        if voltages[0] != 0.0 or voltages[-1] != 0.0:
            raise DriverError('a wave begins and ends at 0 V, or the output would jump')


class Measurement(NamedTuple):
    """What was recorded while a wave was played.

    Attributes
    ----------
    dt : float
        Sampling interval [s].
    voltage : ndarray, shape (n,)
        Of the output [V].
    displacement : ndarray, shape (n,)
        As the controller measures it [m].
    """

    dt: float
    voltage: FloatArray
    displacement: FloatArray


class GcsController:
    """One axis in open loop.

    Parameters
    ----------
    connection : Connection
        To the controller.
    limits : DriveLimits, optional
        What is never exceeded, besides the limits of the controller.
    axis : str
        Name of the axis and of its output.

    Raises
    ------
    DriverError
        If the axis is not there.
    """

    def __init__(
        self, connection: Connection, limits: DriveLimits | None = None, axis: str = '1'
    ) -> None:
        self._line, self.axis = connection, axis
        axes = connection.ask('SAI?')
        if axis not in axes:
            raise DriverError(
                f'{connection.address}: there is no axis {axis}; it has {", ".join(axes)}'
            )
        name, _, firmware = connection.ask('*IDN?')[0].rpartition(',')
        period = connection.number(f'SPA? {axis} {_UPDATE_TIME}')
        if not 0.0 < period < 1.0:
            raise DriverError(f'{connection.address}: a servo period of {period:g} s is none')
        self.identity = Identity(name.strip(), firmware.strip(), 1.0 / period)
        given = limits or DriveLimits()
        low, high = (connection.number(f'{word} {axis}') for word in ('VMI?', 'VMA?'))
        self.limits = DriveLimits(max(low, given.low), min(high, given.high), given.slew)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop and go to 0 V; what went wrong before is raised, not what goes wrong now."""
        try:
            self.stop()
        except DriverError:
            if error is None:
                raise
        finally:
            self._line.close()

    def disconnect(self) -> None:
        """Leave the controller as it is."""
        self._line.close()

    @property
    def voltage(self) -> float:
        """Voltage of the output [V]."""
        return self._line.number(f'VOL? {self.axis}')

    @property
    def is_running(self) -> bool:
        """Whether the wave generator plays."""
        (answer,) = self._line.ask(RUNNING)
        return int(answer, 16) != 0

    def open_loop(self) -> None:
        """Switch the servo off, and go to 0 V.

        Raises
        ------
        DriverError
            If the controller keeps the servo on.
        """
        self._line.command(f'SVO {self.axis} 0')
        if self._line.number(f'SVO? {self.axis}') != 0.0:
            raise DriverError(f'{self._line.address}: the servo stays on; switch it off there')
        self.ramp_to(0.0)

    def ramp_to(self, voltage: float) -> None:
        """Go to a voltage [V] in steps no faster than the slew."""
        begin = self.voltage
        slew = self.limits.slew if math.isfinite(self.limits.slew) else abs(voltage - begin) * 10.0
        count = max(1, math.ceil(abs(voltage - begin) / max(slew * _STEP, 1e-12)))
        if begin == voltage:
            return
        for k in range(1, count + 1):
            self._line.command(f'SVA {self.axis} {begin + (voltage - begin) * k / count:.9g}')
            time.sleep(_STEP if k < count else 0.0)

    def stop(self) -> None:
        """Stop the wave generator and go to 0 V."""
        self._line.send(STOP)
        self._line.ask('ERR?')  # it says that it was stopped
        self.ramp_to(0.0)

    def divider_for(self, seconds: float) -> int:
        """Return the servo ticks per point with which a wave of this length fits."""
        return max(1, math.ceil(seconds * self.identity.rate / MOST_POINTS))

    def play(self, voltages: FloatArray, divider: int = 1) -> Measurement:
        """Play a wave once and return what the recorder holds, one sample for each point.

        Parameters
        ----------
        voltages : ndarray, shape (n,)
            From 0 V to 0 V [V].
        divider : int
            Servo ticks per point.

        Raises
        ------
        DriverError
            If the wave leaves the limits, the controller refuses, or it takes too long; the output
            is stopped and brought to 0 V then, where the connection holds.
        """
        rate = self.identity.rate / divider
        if voltages.size > MOST_POINTS:
            raise DriverError(f'a wave of {voltages.size} points is longer than {MOST_POINTS}')
        self.limits.require(voltages, rate)
        self._load(voltages, divider)
        self._line.command(f'WGO {self.axis} 1')
        try:
            self._wait(voltages.size / rate)
        except DriverError:
            self.stop()
            raise
        return self._recorded(voltages.size)

    def _load(self, voltages: FloatArray, divider: int) -> None:
        say, last = self._line.send, voltages.size
        for first in range(0, last, _POINTS_PER_LINE):
            part = voltages[first : first + _POINTS_PER_LINE]
            mode = '&' if first else 'X'
            values = ' '.join(f'{value:.9g}' for value in part)
            say(f'WAV {_TABLE} {mode} PNT 1 {part.size} {values}')
        self._line.require('WAV')
        if self._line.number(f'WAV? {_TABLE} 1') != last:
            raise DriverError(f'{self._line.address}: the wave did not arrive whole; try again')
        for text in (
            f'WSL {_GENERATOR} {_TABLE}', f'WGC {_GENERATOR} 1', f'WOS {_GENERATOR} 0',
            f'WTR {_GENERATOR} {divider} 1', f'DRC 1 {self.axis} {_POSITION}',
            f'DRC 2 {self.axis} {_OUTPUT}', 'DRT 0 0 0', f'RTR {divider}',
        ):  # fmt: skip
            self._line.command(text)

    def _wait(self, seconds: float) -> None:
        end = time.monotonic() + seconds + _AFTER
        while self.is_running:
            if time.monotonic() > end:
                raise DriverError(
                    f'{self._line.address}: the wave of {seconds:.3g} s does not end; the '
                    'generator was stopped'
                )
            time.sleep(min(0.05, seconds))

    def _recorded(self, count: int) -> Measurement:
        """Return the samples, which may be written a moment after the wave."""
        end = time.monotonic() + _AFTER
        while min(self._line.number(f'DRL? {table}') for table in (1, 2)) < count:
            if time.monotonic() > end:
                raise DriverError(f'{self._line.address}: the recorder holds too few samples')
            time.sleep(0.01)
        lines = self._line.ask(f'DRR? 1 {count} 1 2')
        head = [line for line in lines if line.startswith('#')]
        header = dict(line.lstrip('# ').split(' = ', 1) for line in head if ' = ' in line)
        try:
            dt = float(header['SAMPLE_TIME'])
            rows = np.array([line.split() for line in lines[len(head) :]], np.float64)
        except (KeyError, ValueError):
            raise DriverError(f'{self._line.address}: the record cannot be read') from None
        if rows.shape != (count, 2) or not np.all(np.isfinite(rows)):
            raise DriverError(f'{self._line.address}: the record did not come whole; try again')
        return Measurement(dt, rows[:, 1].copy(), 1e-6 * rows[:, 0])
