"""Common behaviour of the drivers for one axis of a controller.

Connecting causes no motion. The first motion claims the controller: an output that another client
drives is left alone unless it is taken over. A wave starts and ends at 0 V and is played once, so
that the output is at 0 V at its end even if this program or the connection fails. The slew limit
holds from one tick of the servo to the next, also where a wave has fewer points.
"""

from __future__ import annotations

import math
import socket
import sys
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
from piezo_hysteresis.drivers.wires import DriverError

#: Default limits; those of the controller apply in addition.
UNLIMITED = Limits(-math.inf, math.inf, math.inf)
_LENGTHS = {'m': 1.0, 'mm': 1e-3, 'nm': 1e-9} | dict.fromkeys(
    ('um', '\u00b5m', '\u03bcm', 'micron', 'microns'), 1e-6
)
_UNHURRIED = 10.0  # of a way per second, where no slew is given
_FEW = 10  # steps of such a way
_REST = 1e-3  # share of the range up to which the output rests
_LAG = 2e-4  # by which notch filters and the like may delay the output [s]
_AGREED = 2e-3  # share of a wave by which the output may deviate from it
_SAME_RATE = 1e-3  # share by which the rate of a record may deviate
_AFTER = 3.0  # longest time that a wave may take more than it should [s]
_LOOK = 0.05  # how often it is looked whether a wave has ended [s]


@dataclass(frozen=True)
class Identity:
    """Identity of a controller."""

    name: str
    firmware: str
    rate: float  # servo rate [Hz]


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


def metres_of(unit: str, address: str) -> float:
    """Return the length of a unit [m]."""
    if (metres := _LENGTHS.get(unit.strip().lower())) is None:
        raise DriverError(
            f'{address}: its position has the unit {unit!r}, which is no length; an axis with a '
            'sensor of displacement is needed'
        )
    return metres


class Connection(Protocol):
    """Connection to a controller."""

    address: str
    peer: str

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
        Name of the axis, also of its output.
    take_over : bool
        Whether the wave or motion of another client is stopped instead of refused.

    Attributes
    ----------
    most_points : int
        Largest number of points of a wave and of a record.
    interpolates : bool
        Whether the output moves in a straight line between two points; else in one tick.
    address : str
        Its address.
    identity : Identity
        Identity of the controller.
    limits : Limits
        The given limits, or those of the controller if they are narrower.
    filters : str
        Filters of the controller before the recorder.
    span, noise, lag : float
        Output range [V], and by what the recorded voltage may miss the wave: [V], delay [s].

    Raises
    ------
    DriverError
        If the axis does not exist or has no sensor of displacement.
    """

    most_points: ClassVar[int]
    interpolates: ClassVar[bool]
    identity: Identity
    limits: Limits
    filters: str
    span: float
    noise: float
    lag: float = _LAG

    def __init__(
        self,
        connection: Connection,
        limits: Limits = UNLIMITED,
        axis: str = '1',
        take_over: bool = False,
    ) -> None:
        self._line: Any = connection
        self.axis, self.address, self.take_over = axis, connection.address, take_over
        self._claim: socket.socket | None = None
        self._is_playing = False
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
        """Stop and go to 0 V what was driven; an earlier error is raised, not one of the stop."""
        try:
            if self.is_claimed:
                self.stop()
        except DriverError:
            if error is None:
                raise
        finally:
            self.disconnect()

    def disconnect(self) -> None:
        """Close the connection without a change of the controller."""
        self.release()
        self._line.close()

    @property
    def is_claimed(self) -> bool:
        """Whether this object may move the axis, and no other program of the suite."""
        return self._claim is not None

    def claim(self, take_over: bool = False) -> None:
        """Claim the controller, unless a program on this computer has: recorders are shared.

        Raises
        ------
        DriverError
            If another program of the suite drives it, or any client moves its output.
        """
        if self.is_claimed:
            return
        claim = socket.socket(socket.AF_UNIX)
        try:
            if sys.platform == 'linux':  # a name without a file: it ends with its process
                claim.bind(f'\0piezo_hysteresis controller {self._line.peer}')
            if (what := self.other_motion()) and not (take_over or self.take_over):
                raise DriverError(
                    f'{self.address}: {what}, started by another client: wait for its end, stop '
                    'it there, or stop it from here by --take-over'
                )
        except OSError:
            claim.close()
            raise DriverError(
                f'{self.address}: another sweep of this suite drives it; wait for its end'
            ) from None
        except DriverError:
            claim.close()
            raise
        self._claim = claim

    def release(self) -> None:
        """Let other programs claim the controller."""
        if self._claim is not None:
            self._claim.close()
            self._claim = None

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
    def other_motion(self) -> str:
        """Return what runs or moves in the controller, empty where nothing does."""

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """Whether the servo is off."""

    @abstractmethod
    def switch_off(self) -> None:
        """Switch the servo off; the voltage is held."""

    @abstractmethod
    def halt(self) -> None:
        """Stop the wave generator of the axis; the voltage is held."""

    @abstractmethod
    def step(self, voltage: float) -> None:
        """Set the output voltage at once [V]."""

    @abstractmethod
    def go(self, begin: float, end: float, slew: float) -> None:
        """Move the output from one voltage to another at this slew [V], [V/s]."""

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

    def open_loop(self) -> None:
        """Claim the axis, switch its servo off, and go to 0 V.

        Raises
        ------
        DriverError
            If another client drives it, or the controller keeps the servo on.
        """
        self.claim()
        if self.take_over:
            self.halt()
        self.switch_off()
        if not self.is_open:
            raise DriverError(f'{self.address}: the servo stays on; switch it off there')
        self.set_voltage(0.0)

    def set_voltage(self, voltage: float) -> None:
        """Go to a voltage [V]: within the slew limit, and in 0.1 s where there is none.

        Raises
        ------
        DriverError
            If the voltage is outside the limits, or another client drives the axis.
        """
        limits = self.limits
        if not (voltage == 0.0 or limits.low <= voltage <= limits.high):
            raise DriverError(f'{voltage:g} V is outside {limits.low:g} .. {limits.high:g} V')
        self.claim()
        if not self.is_open:
            raise DriverError(f'{self.address}: the servo is on; nothing was moved')
        begin = self.voltage
        slew = limits.slew if math.isfinite(limits.slew) else _UNHURRIED * abs(voltage - begin)
        if begin != voltage:
            self.go(begin, voltage, slew)

    def stop(self, is_ours: bool = False) -> None:
        """Stop the wave and go to 0 V; what another client plays is left alone.

        Parameters
        ----------
        is_ours : bool
            Whether what plays was started by a lost connection of this program.

        Raises
        ------
        DriverError
            If the connection is lost, or another client drives the axis.
        """
        is_ours = is_ours or self._is_playing
        self.claim(is_ours)
        if not (is_ours or self.take_over) and (what := self.other_motion()):
            raise DriverError(f'{self.address}: {what}, started by another client; it goes on')
        self.halt()
        self._is_playing = False
        self.set_voltage(0.0)

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
        ticks = rate if self.interpolates else self.identity.rate
        fastest = float(np.max(np.abs(np.diff(voltages)))) * ticks
        if fastest > limits.slew * (1.0 + 1e-9):
            steps = '' if ticks == rate else f', as steps of a wave of {rate:g} Hz'
            raise DriverError(
                f'a wave moves by {fastest:.4g} V/s{steps}; the limit is {limits.slew:g} V/s: ask '
                'for a lower frequency or amplitude' + (', or a shorter record' if steps else '')
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
            If the wave leaves the limits, the controller refuses, it takes too long, or the output
            was not the wave; it is then stopped and brought to 0 V, if the connection works.
        """
        rate = self.identity.rate / divider
        self.require(voltages, rate)
        self._require_rest()
        self.load(voltages, divider)
        self._refuse(self.other_motion())
        try:
            self.run(voltages.size / rate, watch)
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
        if abs(measured.dt * rate - 1.0) > _SAME_RATE:
            raise DriverError(
                f'{self.address}: recorded at {1.0 / measured.dt:.4g} Hz instead of {rate:.6g} '
                'Hz: another client set the rate of the recorder; there is no record of it'
            )
        self._require_played(voltages, rate, measured.voltage)
        return measured

    def run(self, seconds: float, watch: Callable[[], None] = lambda: None) -> None:
        """Start the loaded wave of this length [s], and wait for its end.

        Raises
        ------
        DriverError
            If it does not start or end.
        """
        end = time.monotonic() + seconds + _AFTER
        self._is_playing = True
        self.start()
        while self.is_running:
            watch()
            if time.monotonic() > end:
                raise DriverError(
                    f'{self.address}: the wave of {seconds:.3g} s does not end; the generator was '
                    'stopped'
                )
            time.sleep(min(_LOOK, seconds))
        self._is_playing = False

    def _in_steps(self, begin: float, end: float, slew: float) -> None:
        """Move the output by commands, each of a step that the slew allows in one tick."""
        count = math.ceil(abs(end - begin) * self.identity.rate / slew)
        if not math.isfinite(self.limits.slew):
            count = _FEW
        for k in range(1, count + 1):
            # the last one exactly: a range may end there
            self.step(end if k == count else begin + (end - begin) * k / count)
            time.sleep(abs(end - begin) / slew / count)

    def _refuse(self, what: str) -> None:
        if what:
            raise DriverError(f'{self.address}: {what}, by another client; no wave was started')

    def _require_rest(self) -> None:
        """Refuse unless the axis is ours and rests at 0 V in open loop."""
        self.claim()
        self._refuse(self.other_motion() or ('' if self.is_open else 'the servo is on'))
        voltage = abs(self.voltage)
        self._refuse(f'the output is at {voltage:g} V' if voltage > _REST * self.span else '')
        if voltage * self.identity.rate > self.limits.slew:
            self.set_voltage(0.0)

    def _require_played(self, wave: FloatArray, rate: float, voltage: FloatArray) -> None:
        """Refuse a record whose voltage is not the wave, but for its delay and rounding."""
        off = np.abs(voltage - wave)
        step = float(np.max(np.abs(np.diff(wave))))
        allowed = _AGREED * float(np.ptp(wave)) + step * (1.0 + self.lag * rate)
        allowed += self.noise
        if np.any(off > allowed) or not self.is_open:
            k = int(np.argmax(off > allowed))
            raise DriverError(
                f'{self.address}: the output was not the wave: {voltage[k]:.4g} V instead of '
                f'{wave[k]:.4g} V after {k / rate:.3g} s. Another client drives it, or its output '
                'is limited; there is no record of it'
            )
