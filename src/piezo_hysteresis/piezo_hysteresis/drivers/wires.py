"""Bytes to and from a controller: over TCP or a serial port."""

from __future__ import annotations

import socket
import time
from pathlib import Path
from typing import Any, Protocol

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import PiezoError


class DriverError(PiezoError):
    """A controller cannot be reached, or refuses."""


class ConnectionLostError(DriverError):
    """The controller no longer responds; a new connection is required."""


class UnknownCommandError(DriverError):
    """A controller does not know a command."""


#: Timeout of a response [s].
TIMEOUT = 5.0
#: Of a serial port, where the address gives none [1/s].
BAUD = 115_200
#: Waits of the timeout for the response of a late controller.
ATTEMPTS = 5
_LOOK = 0.05  # how often a serial port is looked at, at least [s]


class Wire(Protocol):
    """What carries bytes."""

    address: str
    peer: str

    def send(self, data: bytes) -> None:
        """Send all data."""

    def receive(self, seconds: float | None = None) -> bytes:
        """Return the next bytes, at least one, within a time shorter than the timeout [s]."""

    def close(self) -> None:
        """Close the connection; the controller continues its task."""


class TcpWire:
    """A TCP connection."""

    def __init__(self, host: str, port: int, timeout: float = TIMEOUT) -> None:  # timeout [s]
        self.address, self._timeout = f'{host}:{port}', timeout
        try:
            self._socket = socket.create_connection((host, port), timeout)
            # else a command and the query after it wait 40 ms for each other's acknowledgement
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.peer = str(self._socket.getpeername()[:2])
        except (OSError, OverflowError) as error:
            why = reason_of(error)
            raise DriverError(
                f'{self.address}: no controller answers ({why}); check cable, address and port'
            ) from None

    def send(self, data: bytes) -> None:
        """Send all data."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise lost(self.address, error) from None

    def receive(self, seconds: float | None = None) -> bytes:
        """Return the next bytes."""
        try:
            self._socket.settimeout(min(seconds or self._timeout, self._timeout))
            data = self._socket.recv(1 << 16)
        except TimeoutError:
            raise
        except OSError as error:
            raise lost(self.address, error) from None
        if not data:
            raise lost(self.address, 'closed by the controller')
        return data

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class SerialWire:
    """A serial port, by pyserial."""

    def __init__(self, path: str, baud: int = BAUD, timeout: float = TIMEOUT) -> None:
        # baud [1/s]; timeout [s]
        self.address, self.peer, self._timeout = path, str(Path(path).resolve()), timeout
        try:
            import serial
        except ImportError:
            raise DriverError(
                f"{path}: serial ports need pyserial: pip install 'piezo_hysteresis[serial]'"
            ) from None
        # pyserial's own errors are OSErrors; a port that is gone can give it None
        self._failures = (OSError, TypeError)
        try:
            self._port: Any = serial.Serial(
                path, baud, timeout=_LOOK, write_timeout=timeout, exclusive=True
            )
            self._port.reset_input_buffer()
        except (*self._failures, ValueError) as error:
            why = reason_of(error)
            raise DriverError(
                f'{path}: the port cannot be opened ({why}); check cable, name and rights'
            ) from None

    def send(self, data: bytes) -> None:
        """Send all data."""
        try:
            self._port.write(data)
        except self._failures as error:
            raise lost(self.address, error) from None

    def receive(self, seconds: float | None = None) -> bytes:
        """Return the next bytes."""
        end = time.monotonic() + min(seconds or self._timeout, self._timeout)
        while True:
            try:
                data = bytes(self._port.read(max(1, self._port.in_waiting)))
            except self._failures as error:
                raise lost(self.address, error) from None
            if data:
                return data
            if time.monotonic() > end:
                raise TimeoutError

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def lost(address: str, reason: object) -> ConnectionLostError:
    """Return the error of a lost connection."""
    why = reason_of(reason)
    return ConnectionLostError(
        f'{address}: the connection is lost ({why}); a running wave ends at 0 V; '
        'check the cable, then try again'
    )


def silent(address: str, query: object) -> ConnectionLostError:
    """Return the error of a query without a response."""
    return ConnectionLostError(
        f'{address}: no answer to {query!r} in time; the controller is busy, or something else '
        'answers there'
    )
