"""Commands and responses of GCS 2."""

from __future__ import annotations

from piezo_hysteresis.drivers.driver_errors import DriverError
from piezo_hysteresis.drivers.wires import ATTEMPTS, Wire, silent

PORT = 50_000
STOP, RUNNING, IDENTITY = b'\x18', b'\x09', '*IDN?'

#: What the usual error numbers mean, and what to do.
ERRORS = {
    1: 'it does not understand the parameters',
    2: 'it does not know the command',
    5: 'the axis cannot move in this servo mode',
    7: 'the value is beyond the limits of the controller',
    10: 'it was stopped',
    15: 'there is no such axis',
    17: 'a parameter is out of range',
}


class GcsConnection:
    """Sends commands and reads complete responses.

    Parameters
    ----------
    wire : Wire
        Connection to the controller.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire, self.address = wire, wire.address
        self._rest, self._identity = b'', ''
        self._is_late = False

    def close(self) -> None:
        """Close the connection; the controller continues its task."""
        self._wire.close()

    def send(self, text: str | bytes) -> None:
        """Send a command, or a command of a single character.

        Raises
        ------
        DriverError
            If the connection is lost.
        """
        self._wire.send(text if isinstance(text, bytes) else text.encode('ascii') + b'\n')

    def ask(self, text: str | bytes) -> list[str]:
        """Send a query; return the lines of the response.

        After a timeout, the late response is discarded first.

        Raises
        ------
        DriverError
            If the connection is lost, or the response is not complete before the timeout.
        """
        if self._is_late:
            self._catch_up()
        self.send(text)
        lines = []
        while True:
            line = self._line(text)
            lines.append(line.rstrip(' \n'))
            if not line.endswith(' \n'):
                break
        if text == IDENTITY:
            self._identity = lines[0]
        return lines

    def command(self, text: str) -> None:
        """Send a command and check that it was accepted.

        Raises
        ------
        DriverError
            If it was not, with the reason.
        """
        self.send(text)
        (answer,) = self.ask('ERR?')
        number = self._integer(answer, 'ERR?')
        if number:
            reason = ERRORS.get(number, f'error {number}; see its manual')
            raise DriverError(f'{self.address}: {text[:40]!r} is refused: {reason}')

    def is_running(self) -> bool:
        """Return whether a wave generator plays."""
        return self._integer(self.ask(RUNNING)[0], RUNNING, 16) != 0

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

    def _line(self, text: str | bytes) -> str:
        try:
            return self._next()
        except TimeoutError:
            self._is_late = True
            raise silent(self.address, text) from None

    def _next(self) -> str:
        while b'\n' not in self._rest:
            self._rest += self._wire.receive()
        line, self._rest = self._rest.split(b'\n', 1)
        return line.decode('latin-1') + '\n'
