"""Commands and responses of the NV200: ASCII lines, each with a response up to the byte XON."""

from __future__ import annotations

from piezo_hysteresis.drivers.driver_errors import DriverError
from piezo_hysteresis.drivers.wires import ATTEMPTS, Wire, silent

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
