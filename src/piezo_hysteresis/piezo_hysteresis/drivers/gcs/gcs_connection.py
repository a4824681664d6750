"""Commands and responses of GCS 2."""

from __future__ import annotations

from contextlib import suppress

from piezo_hysteresis.drivers.driver_errors import DriverError, UnknownCommandError
from piezo_hysteresis.drivers.wires import ATTEMPTS, Wire, silent

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
