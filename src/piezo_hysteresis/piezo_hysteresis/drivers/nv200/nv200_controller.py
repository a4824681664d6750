"""An amplifier NV200 of piezosystem jena: a wave of 1024 points, two recorders of 6144 values.

The wave is set in percent of the output range; the recorded voltage is the applied one. With a
sensor the output cannot be queried: it is read by a recording of one value.
"""

from __future__ import annotations

import time

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.drivers.controller import Controller, Identity, Measurement, metres_of
from piezo_hysteresis.drivers.wires import ATTEMPTS, DriverError, Wire, silent

#: Of its telnet server.
PORT = 23
XON = b'\x11'
#: Text in the response to an empty line.
MODEL = 'NV200'
_AROUND = '\x00\x01\x11\x13\r\n <>'  # characters around a response

#: What the error numbers mean.
ERRORS = {
    1: 'it does not say why',
    2: 'it does not know the command',
    3: 'a parameter is missing',
    4: 'a parameter is out of range',
    5: 'there are too many parameters',
    6: 'the parameter is locked',
    7: 'underload',
    8: 'overload',
    9: 'a parameter is too low',
    10: 'a parameter is too high',
}


class Nv200Connection:
    """Sends commands and reads complete responses."""

    def __init__(self, wire: Wire) -> None:
        self._wire, self.address, self.peer = wire, wire.address, wire.peer
        self._rest, self._is_late = b'', False

    def close(self) -> None:
        """Close the connection; the controller continues its task."""
        self._wire.close()

    def ask(self, text: str) -> str:
        """Send a line; return the response, empty for a command.

        After a timeout, the late response is discarded first.
        """
        if self._is_late:
            self._catch_up()
        self._wire.send(text.encode('ascii') + b'\r\n')
        try:
            answer = self._next()
        except TimeoutError:
            self._is_late = True
            raise silent(self.address, text) from None
        if answer.startswith('error'):
            number = answer.partition(',')[2].strip()
            reason = ERRORS.get(int(number) if number.isdigit() else 1, f'error {number}')
            raise DriverError(f'{self.address}: {text[:40]!r} is refused: {reason}')
        return answer

    def _catch_up(self) -> None:
        """Read until the controller returns its identity, after all earlier responses."""
        self._wire.send(b'\r\n')
        for _ in range(ATTEMPTS):
            try:
                while MODEL not in self._next():
                    pass
            except TimeoutError:
                continue
            self._is_late = False
            return
        raise silent(self.address, '')

    def _next(self) -> str:
        while XON not in self._rest:
            self._rest += self._wire.receive()
        raw, self._rest = self._rest.split(XON, 1)
        return raw.decode('latin-1').strip(_AROUND)

    def values(self, text: str) -> list[str]:
        """Return the text after the command in the response to a query."""
        answer = self.ask(text)
        word, *values = answer.split(',')
        if word.strip() != text.split(',', 1)[0] or not values:
            raise DriverError(f'{self.address}: {answer[:40]!r} is no answer to {text!r}')
        return [value.strip(_AROUND) for value in values]

    def number(self, text: str, place: int = 0) -> float:
        """Return one of the numbers in the response to a query."""
        values = self.values(text)
        try:
            return float(values[place])
        except (ValueError, IndexError):
            raise DriverError(
                f'{self.address}: {text!r} is answered by {",".join(values)[:40]!r}'
            ) from None


#: Of its servo, recorder and generator [Hz].
SERVO = 20_000.0
_POSITION, _OUTPUT = 0, 2  # what a recorder holds: position [µm], voltage of the output [V]
_LINE, _GENERATOR = 0, 3  # what gives the set point: this connection, or the wave generator
_NOISE = 2e-3  # of the measured voltage, share of the range
_SLEW_OFF = 2000.0  # of the limiter of the set point [%/ms]
_RECORDED = 1.0  # longest time that a recorder of one value takes [s]


class Nv200Controller(Controller):
    """The only axis, 1, in open loop; parameters and errors as in `Controller`."""

    most_points = 1024
    interpolates = False

    _line: Nv200Connection

    def _look(self, given: Limits) -> None:
        ask, number = self._line.ask, self._line.number
        if self.axis != '1':
            raise DriverError(f'{self.address}: there is no axis {self.axis}; it has 1')
        name = ask('')
        if MODEL not in name:
            raise DriverError(f'{self.address}: {name[:40]!r} answers, which is no NV200')
        actuator, serial = ','.join(self._line.values('desc')), self._line.values('acserno')[0]
        self.identity = Identity(f'piezosystem jena {name}, {actuator}, {serial}', '', SERVO)
        if not number('acmeasure'):
            raise DriverError(
                f'{self.address}: the actuator has no position sensor (acmeasure 0): there is '
                'no displacement to record'
            )
        self._metres = metres_of(self._line.values('unitcl')[0], self.address)
        self._low, self._high = number('avmin'), number('avmax')
        if not self._low < self._high:
            raise DriverError(f'{self.address}: a range of {self._low:g} .. {self._high:g} V')
        percent = number('sr')
        own = np.inf if percent >= _SLEW_OFF else 10.0 * percent * (self._high - self._low)
        self.limits = Limits(
            max(self._low, given.low), min(self._high, given.high), min(own, given.slew)
        )
        self.filters = self._filters()
        self.span = self._high - self._low
        self.noise = _NOISE * self.span  # the voltage is measured, not that of the wave
        if number('setlpon'):
            self.lag += 1.0 / (2.0 * np.pi * number('setlpf'))

    def _filters(self) -> str:
        """Return the active filters, which are not changed."""
        number, found = self._line.number, []
        for switch, frequency, what in (
            ('setlpon', 'setlpf', 'low-pass of the set point'),
            ('poslpon', 'poslpf', 'low-pass of the position'),
            ('notchon', 'notchf', 'notch of the set point'),
        ):
            if number(switch):
                found.append(f'{what} at {number(frequency):g} Hz')
        return ', '.join(found) or 'none is on'

    @property
    def voltage(self) -> float:
        """Voltage of the output [V], recorded now."""
        for text in ('recast,0', f'recsrc,1,{_OUTPUT}', 'recstr,1', 'reclen,1', 'recrun,1'):
            self._line.ask(text)
        end = time.monotonic() + _RECORDED
        while self._line.number('recrun'):
            if time.monotonic() > end:
                raise DriverError(f'{self.address}: the recorder does not end')
            time.sleep(0.001)
        return self._line.number('recout,1,0,1', 2)

    @property
    def displacement(self) -> float:
        """Position as the controller measures it [m]."""
        return self._metres * self._line.number('meas')

    @property
    def is_running(self) -> bool:
        """Whether the wave generator plays."""
        return self._line.number('grun') != 0.0

    def state(self) -> tuple[float, float] | None:
        """Return voltage [V] and displacement [m]; None while the recorder is in use."""
        return None if self.is_running else super().state()

    def other_motion(self) -> str:
        """Return what drives the output, empty where nothing does."""
        if self.is_running:
            return 'its wave generator runs'
        source = self._line.number('modsrc')
        return '' if source in (_LINE, _GENERATOR) else f'source {source:g} (modsrc) drives it'

    @property
    def is_open(self) -> bool:
        """Whether the servo is off."""
        return self._line.number('cl') == 0.0

    def switch_off(self) -> None:
        """Switch the servo off; the voltage is held."""
        if self.is_open and self._line.number('modsrc') == _LINE:
            return
        before = self.voltage
        self._line.ask('cl,0')
        if self.is_open:
            self.step(before)
            self._line.ask(f'modsrc,{_LINE}')

    def step(self, voltage: float) -> None:
        """Set the set point of the output at once [V]."""
        self._line.ask(f'set,{voltage:.6f}')

    def go(self, begin: float, end: float, slew: float) -> None:
        """Move the output by steps: a wave is not interpolated."""
        self._in_steps(begin, end, slew)

    def halt(self) -> None:
        """Stop the wave generator; the voltage is held."""
        self._line.ask('grun,0')
        if self.is_open and self._line.number('modsrc') != _LINE:
            self.step(self.voltage)
            self._line.ask(f'modsrc,{_LINE}')

    def load(self, voltages: FloatArray, divider: int) -> None:
        """Load a wave [V], to be played once, and prepare the recorder."""
        ask, count = self._line.ask, voltages.size
        if not self.is_open:
            raise DriverError(f'{self.address}: the loop is closed, a wave would be a position')
        percent = 100.0 * (voltages - self._low) / (self._high - self._low)
        for k, value in enumerate(percent):
            ask(f'gbarb,{k},{value:.7g}')
        for text in (
            'gsarb,0', f'gearb,{count - 1}', 'goarb,0', 'gcarb,1', f'gtarb,{divider}',
            f'recsrc,0,{_POSITION}', f'recsrc,1,{_OUTPUT}', f'recstr,{divider}', f'reclen,{count}',
            'recast,2',
        ):  # fmt: skip
            ask(text)
        for k in (0, count // 2, count - 1):  # verify the stored points
            if abs(self._line.number(f'gbarb,{k}', 1) - percent[k]) > 1e-3:
                raise DriverError(f'{self.address}: the wave did not arrive whole; try again')

    def start(self) -> None:
        """Start wave generator and recorder."""
        self.step(0.0)
        self._line.ask(f'modsrc,{_GENERATOR}')
        self._line.ask('grun,1')

    def recorded_count(self) -> int:
        """Return how many samples the recorder holds: all, or none while it writes."""
        return 0 if self._line.number('recrun') else int(self._line.number('reclen'))

    def recorded(self, count: int, divider: int) -> Measurement:
        """Return what the recorder holds."""
        columns = []
        for channel in (0, 1):
            values = self._line.values(f'recoutf,{channel}')[1:]
            try:
                columns.append(np.array(values, np.float64))
            except ValueError:
                raise DriverError(f'{self.address}: the record cannot be read') from None
        return Measurement(divider / SERVO, columns[1], self._metres * columns[0])
