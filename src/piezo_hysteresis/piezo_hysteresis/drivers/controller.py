"""Common behaviour of the drivers for one axis of a controller.

Connecting causes no motion. A wave starts and ends at 0 V and is played once, so that the output
is at 0 V at the end of the wave even if this program or the connection fails.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from types import TracebackType
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers.driver_errors import DriverError

#: Default limits; those of the controller apply in addition.
UNLIMITED = Limits(-math.inf, math.inf, math.inf)
_STEP = 0.01  # between two voltages of a ramp [s]
_AFTER = 3.0  # longest time that a wave may take more than it should [s]
_LOOK = 0.05  # how often it is looked whether a wave has ended [s]


@dataclass(frozen=True)
class Identity:
    """Identity of a controller.

    Attributes
    ----------
    name, firmware : str
        Maker, model and serial number; version of the firmware.
    rate : float
        Servo rate [Hz].
    """

    name: str
    firmware: str
    rate: float


class Measurement(NamedTuple):
    """Data recorded while a wave was played.

    Attributes
    ----------
    dt : float
        Sampling interval [s].
    voltage : ndarray, shape (n,)
        Output voltage [V].
    displacement : ndarray, shape (n,)
        Displacement measured by the controller [m].
    """

    dt: float
    voltage: FloatArray
    displacement: FloatArray


class Connection(Protocol):
    """Connection to a controller."""

    address: str

    def close(self) -> None:
        """Close it."""


class Controller(ABC):
    """One axis in open loop.

    Parameters
    ----------
    connection : Connection
        Connection to the controller; closed if it is unusable.
    limits : Limits
        Limits in addition to those of the controller.
    axis : str
        Name of the axis.

    Attributes
    ----------
    most_points : int
        Largest number of points of a wave and of a record.
    address, axis : str
        Address and axis.
    identity : Identity
        Identity of the controller.
    limits : Limits
        The given limits, or those of the controller if they are narrower.
    filters : str
        Filters of the controller before the recorder.
    """

    most_points: ClassVar[int]
    address: str
    axis: str
    identity: Identity
    limits: Limits
    filters: str
    _line: Connection

    def __init__(self, connection: Connection, limits: Limits, axis: str) -> None:
        self._line, self.axis, self.address = connection, axis, connection.address
        try:
            self._look(limits)
        except BaseException:
            connection.close()
            raise

    @abstractmethod
    def _look(self, given: Limits) -> None:
        """Read identity, filters and limits, without motion."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop and go to 0 V; an earlier error is raised, not an error of the stop."""
        try:
            self.stop()
        except DriverError:
            if error is None:
                raise
        finally:
            self.disconnect()

    def disconnect(self) -> None:
        """Close the connection without a change of the controller."""
        self._line.close()

    @property
    @abstractmethod
    def voltage(self) -> float:
        """Voltage of the output [V]."""

    @property
    @abstractmethod
    def displacement(self) -> float:
        """Position as the controller measures it [m]."""

    @property
    @abstractmethod
    def is_running(self) -> bool:
        """Whether the wave generator plays."""

    @abstractmethod
    def open_loop(self) -> None:
        """Switch the servo off, and go to 0 V.

        Raises
        ------
        DriverError
            If the controller keeps the servo on.
        """

    @abstractmethod
    def set_voltage(self, voltage: float) -> None:
        """Set the output voltage immediately [V]."""

    @abstractmethod
    def halt(self) -> None:
        """Stop the wave generator; the voltage is held."""

    @abstractmethod
    def load(self, voltages: FloatArray, divider: int) -> None:
        """Load a wave [V], to be played once, and prepare the recorder."""

    @abstractmethod
    def start(self) -> None:
        """Start wave generator and recorder."""

    @abstractmethod
    def recorded_count(self) -> int:
        """Return how many samples the recorder holds."""

    @abstractmethod
    def recorded(self, count: int, divider: int) -> Measurement:
        """Return what the recorder holds."""

    def state(self) -> tuple[float, float] | None:
        """Return voltage [V] and displacement [m]; None where asking disturbs what runs."""
        return self.voltage, self.displacement

    def about(self) -> dict[str, Any]:
        """Return metadata of a record: controller, rate and units."""
        return {
            'controller': asdict(self.identity),
            'axis': self.axis,
            'voltage': 'control voltage of the output [V]',
            'displacement': 'position as the controller measures it [m]',
            'filters': self.filters,
            'limits': asdict(self.limits),
        }

    def ramp_to(self, voltage: float) -> None:
        """Go to a voltage [V] in steps no faster than the slew."""
        begin = self.voltage
        slew = self.limits.slew if math.isfinite(self.limits.slew) else abs(voltage - begin) * 10.0
        count = max(1, math.ceil(abs(voltage - begin) / max(slew * _STEP, 1e-12)))
        if begin == voltage:
            return
        for k in range(1, count + 1):
            # the last one exactly: a range may end there
            self.set_voltage(voltage if k == count else begin + (voltage - begin) * k / count)
            time.sleep(_STEP if k < count else 0.0)

    def stop(self) -> None:
        """Stop the wave generator and go to 0 V."""
        self.halt()
        self.ramp_to(0.0)

    def divider_for(self, seconds: float) -> int:
        """Return the servo ticks per point with which a wave of this length fits."""
        return max(1, math.ceil(seconds * self.identity.rate / self.most_points))

    def require(self, voltages: FloatArray, rate: float) -> None:
        """Refuse a wave that leaves the limits, or does not begin and end at 0 V.

        Parameters
        ----------
        voltages : ndarray, shape (n,)
            The wave [V].
        rate : float
            At which it is played [Hz].

        Raises
        ------
        DriverError
            With the value that is beyond.
        """
        limits = self.limits
        if voltages.size > self.most_points:
            raise DriverError(
                f'a wave of {voltages.size} points is longer than {self.most_points}'
            )
        if voltages.size < 2 or not np.all(np.isfinite(voltages)):
            raise DriverError(
                'a wave holds values that are not finite, or none; nothing was loaded'
            )
        least, most = float(voltages.min()), float(voltages.max())
        if least < limits.low or most > limits.high:
            raise DriverError(
                f'a wave of {least:g} .. {most:g} V leaves the range {limits.low:g} .. '
                f'{limits.high:g} V: ask for a smaller amplitude or another offset'
            )
        fastest = float(np.max(np.abs(np.diff(voltages)))) * rate
        if fastest > limits.slew * (1.0 + 1e-9):
            raise DriverError(
                f'a wave moves by {fastest:.4g} V/s, the limit is {limits.slew:g} V/s: ask for a '
                'lower frequency or amplitude'
            )
        if voltages[0] != 0.0 or voltages[-1] != 0.0:
            raise DriverError('a wave begins and ends at 0 V, or the output would jump')

    def play(
        self, voltages: FloatArray, divider: int = 1, watch: Callable[[], None] = lambda: None
    ) -> Measurement:
        """Play a wave once and return what the recorder holds, one sample for each point.

        Parameters
        ----------
        voltages : ndarray, shape (n,)
            From 0 V to 0 V [V].
        divider : int
            Servo ticks per point.
        watch : callable
            Called periodically while the wave runs; an exception stops the wave.

        Raises
        ------
        DriverError
            If the wave leaves the limits, the controller refuses, or it takes too long; the output
            is then stopped and brought to 0 V, if the connection works.
        """
        rate = self.identity.rate / divider
        self.require(voltages, rate)
        self.load(voltages, divider)
        try:
            self.start()
            self._wait(voltages.size / rate, watch)
        except BaseException:
            with suppress(DriverError):  # the first error is reported
                self.stop()
            raise
        end = time.monotonic() + _AFTER
        while self.recorded_count() < voltages.size:  # written a moment after the wave
            if time.monotonic() > end:
                raise DriverError(f'{self.address}: the recorder holds too few samples')
            time.sleep(0.01)
        measured = self.recorded(voltages.size, divider)
        sizes = {measured.voltage.size, measured.displacement.size}
        if sizes != {voltages.size} or not np.all(
            np.isfinite(measured.voltage + measured.displacement)
        ):
            raise DriverError(f'{self.address}: the record did not come whole; try again')
        return measured

    def _wait(self, seconds: float, watch: Callable[[], None]) -> None:
        end = time.monotonic() + seconds + _AFTER
        while self.is_running:
            watch()
            if time.monotonic() > end:
                raise DriverError(
                    f'{self.address}: the wave of {seconds:.3g} s does not end; the generator was '
                    'stopped'
                )
            time.sleep(min(_LOOK, seconds))
