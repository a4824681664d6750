"""Commands and answers of GCS 2 over TCP."""

from __future__ import annotations

import socket

from piezo_hysteresis.errors import PiezoError

PORT = 50_000
STOP, RUNNING = b'\x18', b'\x09'

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


class DriverError(PiezoError):
    """A controller cannot be reached, or refuses."""


class Connection:
    """A TCP connection that sends commands and reads whole answers.

    Parameters
    ----------
    host : str
        Name or address of the controller.
    port : int
        TCP port, 50000 for most.
    timeout : float
        Longest time to wait for an answer [s].

    Raises
    ------
    DriverError
        If the controller cannot be reached.
    """

    def __init__(self, host: str, port: int = PORT, timeout: float = 5.0) -> None:
        self.address = f'{host}:{port}'
        self._rest = b''
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except OSError as error:
            raise DriverError(
                f'{self.address}: no controller answers ({error.strerror or error}); check cable, '
                'address and port'
            ) from None

    def close(self) -> None:
        """Close the connection; the controller goes on with what it does."""
        self._socket.close()

    def send(self, text: str | bytes) -> None:
        """Send a command, or a command of a single character.

        Raises
        ------
        DriverError
            If the connection is lost.
        """
        data = text if isinstance(text, bytes) else text.encode('ascii') + b'\n'
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost(error) from None

    def ask(self, text: str | bytes) -> list[str]:
        """Send a query; return the lines of its answer.

        Raises
        ------
        DriverError
            If the connection is lost, or the answer does not come whole in time.
        """
        self.send(text)
        lines = []
        while True:
            line = self._line(text)
            lines.append(line.rstrip(' \n'))
            if not line.endswith(' \n'):
                return lines

    def command(self, text: str) -> None:
        """Send a command and ask whether it was accepted.

        Raises
        ------
        DriverError
            If it was not, with the reason.
        """
        self.send(text)
        self.require(text)

    def require(self, text: str) -> None:
        """Ask for the last error.

        Raises
        ------
        DriverError
            If there is one; `text` says of what.
        """
        (answer,) = self.ask('ERR?')
        number = int(answer)
        if number:
            reason = ERRORS.get(number, f'error {number}; see its manual')
            raise DriverError(f'{self.address}: {text[:40]!r} is refused: {reason}')

    def value(self, text: str) -> str:
        """Return what stands behind the ``=`` of the answer to a query."""
        answer = self.ask(text)[0]
        _, sign, value = answer.partition('=')
        if not sign:
            raise DriverError(f'{self.address}: {answer!r} is no answer to {text!r}')
        return value.strip()

    def number(self, text: str) -> float:
        """Return the number that answers a query."""
        value = self.value(text)
        try:
            return float(value)
        except ValueError:
            raise DriverError(f'{self.address}: {text!r} is answered by {value!r}') from None

    def _line(self, text: str | bytes) -> str:
        while b'\n' not in self._rest:
            try:
                data = self._socket.recv(1 << 16)
            except TimeoutError:
                raise DriverError(
                    f'{self.address}: no answer to {text!r} in time; the controller is busy, or '
                    'something else answers there'
                ) from None
            except OSError as error:
                raise self._lost(error) from None
            if not data:
                raise self._lost('closed by the controller')
            self._rest += data
        line, self._rest = self._rest.split(b'\n', 1)
        return line.decode('latin-1') + '\n'

    def _lost(self, reason: object) -> DriverError:
        why = getattr(reason, 'strerror', None) or reason
        return DriverError(
            f'{self.address}: the connection is lost ({why}); a wave that runs ends at 0 V by '
            'itself; check the cable, then try again'
        )
