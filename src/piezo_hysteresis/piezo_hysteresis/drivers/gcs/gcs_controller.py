"""One axis of a controller of PI: a wave in its generator, and what its recorder holds."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers.controller import Controller, Identity, Measurement, metres_of
from piezo_hysteresis.drivers.wires import ATTEMPTS, DriverError, UnknownCommandError, Wire, silent

PORT = 50_000
MOVING, RUNNING, IDENTITY = b'\x05', b'\x09', '*IDN?'
_PLAIN = (IDENTITY, 'ERR?', 'SAI?')  # answers without an equals sign
_UNKNOWN = 2  # error number
_SILENT = 1.0  # longest silence before it is asked for an error [s]

#: What the usual error numbers mean, and what to do.
ERRORS = {
    1: 'it does not understand the parameters',
    2: 'it does not know the command',
    5: 'the axis cannot move in this servo mode',
    7: 'the value is beyond the limits of the controller',
    10: 'it was stopped',
    15: 'there is no such axis',
    17: 'a parameter is out of range',
    54: 'it does not know this parameter',
}


class GcsConnection:
    """Sends commands and reads complete responses."""

    def __init__(self, wire: Wire) -> None:
        self._wire, self.address, self.peer = wire, wire.address, wire.peer
        self._rest, self._identity = b'', ''
        self._is_late = False

    def close(self) -> None:
        """Close the connection; the controller continues its task."""
        self._wire.close()

    def send(self, text: str | bytes) -> None:
        """Send a command, or a command of a single character."""
        self._wire.send(text if isinstance(text, bytes) else text.encode('ascii') + b'\n')

    def ask(self, text: str | bytes) -> list[str]:
        """Send a query; return the lines of the response.

        After a timeout, the late response is discarded first. A controller does not answer what it
        refuses: after a second of silence it is asked for its error.
        """
        if self._is_late:
            self._catch_up()
        self.send(text)
        lines: list[str] = []
        while True:
            line = self._line(text, is_first=not lines)
            lines.append(line.rstrip(' \n'))
            if not line.endswith(' \n'):
                break
        if text == IDENTITY:
            self._identity = lines[0]
        return lines

    def command(self, text: str) -> None:
        """Send a command and check that it was accepted."""
        self.send(text)
        self.require(text, self.error())

    def error(self) -> int:
        """Return the number of the last error, 0 for none; this clears it."""
        return self._integer(self.ask('ERR?')[0], 'ERR?')

    def require(self, text: str, number: int) -> None:
        """Raise the error of a command, if there is one."""
        if number:
            reason = ERRORS.get(number, f'error {number}; see its manual')
            kind = UnknownCommandError if number == _UNKNOWN else DriverError
            raise kind(f'{self.address}: {text[:40]!r} is refused: {reason}')

    def bits(self, text: bytes) -> int:
        """Return one bit for each axis or generator."""
        return self._integer(self.ask(text)[0], text, 16)

    def value(self, text: str) -> str:
        """Return the text after the ``=`` of the response to a query."""
        answer = self.ask(text)[0]
        _, sign, value = answer.partition('=')
        if not sign:
            raise DriverError(f'{self.address}: {answer!r} is no answer to {text!r}')
        return value.strip()

    def number(self, text: str) -> float:
        """Return the numeric response to a query."""
        value = self.value(text)
        try:
            return float(value)
        except ValueError:
            raise DriverError(f'{self.address}: {text!r} is answered by {value!r}') from None

    def _integer(self, answer: str, text: str | bytes, base: int = 10) -> int:
        try:
            return int(answer, base)
        except ValueError:
            raise DriverError(f'{self.address}: {text!r} is answered by {answer!r}') from None

    def _catch_up(self) -> None:
        """Read until the controller returns its identity, after all earlier responses."""
        self.send(IDENTITY)
        for _ in range(ATTEMPTS if self._identity else 0):
            try:
                while self._identity not in self._next():
                    pass
            except TimeoutError:
                continue
            self._is_late = False
            return
        raise silent(self.address, IDENTITY)

    def _line(self, text: str | bytes, is_first: bool) -> str:
        is_plain = isinstance(text, bytes) or text in _PLAIN
        try:
            if is_plain or not is_first:
                return self._next()
            with suppress(TimeoutError):
                return self._next(_SILENT)
            self.send('ERR?')
            line = self._next()
            if not line.strip().isdigit():  # it was only late; the answer to ERR? is on its way
                self._is_late = True
                return line
            self.require(str(text), int(line))
        except TimeoutError:
            pass
        self._is_late = True
        raise silent(self.address, text)

    def _next(self, seconds: float | None = None) -> str:
        while b'\n' not in self._rest:
            self._rest += self._wire.receive(seconds)
        line, self._rest = self._rest.split(b'\n', 1)
        return line.decode('latin-1') + '\n'


_UPDATE_TIME, _UNIT = '0x0E000200', '0x07000601'  # period of the servo [s]; unit of the axis
_POSITION, _OUTPUT = 2, 7  # what the recorder holds: position, voltage of the output [V]
_POINTS_PER_LINE = 100


class GcsController(Controller):
    """One axis in open loop; parameters and errors as in `Controller`."""

    most_points = 60_000  # that every controller of this kind holds
    interpolates = True
    filters = 'those of the controller, at the rate of its servo; see its manual'

    _line: GcsConnection

    def _look(self, given: Limits) -> None:
        connection, axis = self._line, self.axis
        axes = connection.ask('SAI?')
        if axis not in axes:
            raise DriverError(
                f'{connection.address}: there is no axis {axis}; it has {", ".join(axes)}'
            )
        self._channel = axes.index(axis) + 1  # of its output, wave generator and wave table
        self._bit = 1 << (self._channel - 1)
        name, _, firmware = connection.ask(IDENTITY)[0].rpartition(',')
        period = connection.number(f'SPA? {axis} {_UPDATE_TIME}')
        if not 0.0 < period < 1.0:
            raise DriverError(f'{connection.address}: a servo period of {period:g} s is none')
        self.identity = Identity(name.strip(), firmware.strip(), 1.0 / period)
        low, high = (connection.number(f'{word} {self._channel}') for word in ('VMI?', 'VMA?'))
        self.limits = Limits(max(low, given.low), min(high, given.high), given.slew)
        self.span, self.noise = high - low, 1e-5 * (high - low)
        try:
            unit = connection.value(f'PUN? {axis}')
        except UnknownCommandError:
            unit = connection.value(f'SPA? {axis} {_UNIT}')
        self._metres = metres_of(unit, self.address)

    @property
    def voltage(self) -> float:
        """Voltage of the output [V]."""
        return self._line.number(f'VOL? {self._channel}')

    @property
    def displacement(self) -> float:
        """Position as the controller measures it [m]."""
        return self._metres * self._line.number(f'POS? {self.axis}')

    @property
    def is_running(self) -> bool:
        """Whether the wave generator plays."""
        return bool(self._line.bits(RUNNING) & self._bit)

    def other_motion(self) -> str:
        """Return what runs or moves on this axis, empty where nothing does."""
        if self.is_running:
            return 'its wave generator runs'
        return 'the axis moves' if self._line.bits(MOVING) & self._bit else ''

    @property
    def is_open(self) -> bool:
        """Whether the servo is off."""
        return self._line.number(f'SVO? {self.axis}') == 0.0

    def switch_off(self) -> None:
        """Switch the servo off; the voltage is held."""
        self._line.command(f'SVO {self.axis} 0')

    def step(self, voltage: float) -> None:
        """Set the output voltage at once [V]."""
        self._line.command(f'SVA {self.axis} {voltage:.9g}')

    def go(self, begin: float, end: float, slew: float) -> None:
        """Move the output by a wave; by steps while another generator uses the wave rate."""
        if self._others():
            self._in_steps(begin, end, slew)
            return
        ticks = max(1, math.ceil(1.001 * abs(end - begin) * self.identity.rate / slew))
        divider = math.ceil((ticks + 1) / self.most_points)
        self.load(np.linspace(begin, end, math.ceil(ticks / divider) + 1), divider)
        self.run(ticks / self.identity.rate)
        self.step(end)

    def halt(self) -> None:
        """Stop the wave generator of the axis; the voltage is held."""
        self._line.send(f'WGO {self._channel} 0')
        self._line.error()  # clears that of a generator at rest

    def _others(self) -> int:
        """Return which other wave generators run: recorder and often the rate are common."""
        return self._line.bits(RUNNING) & ~self._bit

    def load(self, voltages: FloatArray, divider: int) -> None:
        """Load a wave [V], to be played once, and prepare the recorder."""
        last, channel = voltages.size, self._channel
        if other := self._others():
            raise DriverError(
                f'{self.address}: generator {other.bit_length()} runs too, and recorder and wave '
                'rate are common: wait for its end or stop it there'
            )
        for first in range(0, last, _POINTS_PER_LINE):
            part = voltages[first : first + _POINTS_PER_LINE]
            mode = '&' if first else 'X'
            values = ' '.join(f'{value:.9g}' for value in part)
            # each is awaited, so that the timeout holds for a line and not for a table
            self._line.command(f'WAV {channel} {mode} PNT 1 {part.size} {values}')
        if self._line.number(f'WAV? {channel} 1') != last:
            raise DriverError(f'{self._line.address}: the wave did not arrive whole; try again')
        for text in (
            f'WSL {channel} {channel}', f'WGC {channel} 1', f'WOS {channel} 0',
            f'DRC 1 {self.axis} {_POSITION}', f'DRC 2 {channel} {_OUTPUT}', 'DRT 0 0 0',
            f'RTR {divider}',
        ):  # fmt: skip
            self._line.command(text)
        self._set_rate(divider)

    def _set_rate(self, divider: int) -> None:
        """Set the servo ticks per point: of the generator, or the one rate of all of them."""
        rate_and_mode = (
            f'{divider} {int(divider > 1)}'  # interpolated where a point lasts for ticks
        )
        for generator in (self._channel, 0):
            self._line.send(f'WTR {generator} {rate_and_mode}')
            if self._line.error() == 0 and self._line.value(f'WTR? {generator}') == rate_and_mode:
                return
        raise DriverError(
            f'{self.address}: it does not take the wave rate {rate_and_mode!r} (WTR)'
        )

    def start(self) -> None:
        """Start wave generator and recorder."""
        self._line.command(f'WGO {self._channel} 1')

    def recorded_count(self) -> int:
        """Return how many samples the recorder holds."""
        return int(min(self._line.number(f'DRL? {table}') for table in (1, 2)))

    def recorded(self, count: int, divider: int) -> Measurement:
        """Return what the recorder holds."""
        lines = self._line.ask(f'DRR? 1 {count} 1 2')
        head = [line for line in lines if line.startswith('#')]
        header = dict(line.lstrip('# ').split(' = ', 1) for line in head if ' = ' in line)
        try:
            dt = float(header['SAMPLE_TIME'])
            rows = np.array([line.split() for line in lines[len(head) :]], np.float64)
            position, voltage = rows.T
        except (KeyError, ValueError):
            raise DriverError(f'{self._line.address}: the record cannot be read') from None
        return Measurement(dt, voltage.copy(), self._metres * position)
