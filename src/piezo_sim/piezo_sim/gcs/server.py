"""``python -m piezo_sim gcs`` and ``nv200``: on a TCP port or a pty, with faults a lab meets."""

from __future__ import annotations

import argparse
import os
import select
import socketserver
import sys
import threading
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from piezo_sim.gcs.controller import SimulatedController
from piezo_sim.gcs.language import Language
from piezo_sim.gcs.nv200 import Nv200Language
from piezo_sim.plant import Plant
from piezo_sim.simulation_errors import SimulationError

#: Faults: the connection is dropped, an answer cut in its middle, nothing is answered, or late.
FAULTS = ('drop', 'truncate', 'silence', 'late')
LATE = 0.5  # of an answer [s]
_POLL = 0.02  # how often a pty looks whether it should end [s]


@dataclass
class Fault:
    """A fault that comes once.

    Attributes
    ----------
    kind : str
        One of `FAULTS`; empty for none.
    after : int
        Lines that are served before.
    """

    kind: str = ''
    after: int = 0

    def due(self) -> str:
        """Count a line; return the fault where it is its turn."""
        if not self.kind:
            return ''
        self.after -= 1
        if self.after >= 0:
            return ''
        kind, self.kind = self.kind, ''
        return kind


class Spoken(Protocol):
    """A language: how lines end, and what they are answered.

    Attributes
    ----------
    controls : tuple of int
        Bytes that are commands of their own.
    """

    controls: tuple[int, ...]

    def control(self, byte: int) -> str | None:
        """Return the answer to a command of a single byte."""

    def answer(self, line: str) -> str | None:
        """Return the answer to a line; None where there is none."""

    def framed(self, answer: str) -> bytes:
        """Return an answer as it is sent."""


class Conversation:
    """What one client says, byte by byte: a command of one byte may stand anywhere.

    Parameters
    ----------
    language : Spoken
        That answers.
    fault : Fault
        What goes wrong.
    """

    def __init__(self, language: Spoken, fault: Fault) -> None:
        self._language, self._fault = language, fault
        self._line = bytearray()
        self.is_over = False

    def answers(self, data: bytes) -> Iterator[bytes]:
        """Yield what is sent back; the connection is to be dropped where `is_over`."""
        for byte in data:
            if byte in self._language.controls:
                answer = self._language.control(byte)
            elif byte == 10:
                fault = self._fault.due()
                if fault == 'drop':
                    self.is_over = True
                    return
                answer = self._language.answer(self._line.decode('ascii', 'replace'))
                self._line.clear()
                if fault == 'truncate' and answer is not None:
                    self.is_over = True
                    yield answer[: len(answer) // 2].encode('latin-1')
                    return
                answer = None if fault == 'silence' else answer
                time.sleep(LATE if fault == 'late' else 0.0)
            else:
                self._line.append(byte)
                continue
            if answer is not None:
                yield self._language.framed(answer)


class GcsServer(socketserver.TCPServer):
    """A controller for one client at a time; it goes on where a client has gone.

    Parameters
    ----------
    controller : SimulatedController
        What is served.
    port : int
        On this machine; 0 takes a free one.
    fault : Fault, optional
        What goes wrong.
    """

    allow_reuse_address = True

    def __init__(
        self, controller: SimulatedController, port: int = 0, fault: Fault | None = None
    ) -> None:
        super().__init__(('127.0.0.1', port), _Client)
        self.controller, self.fault = controller, fault or Fault()
        self.language = Language(controller)


class _Client(socketserver.BaseRequestHandler):
    """Serves one client until it goes."""

    server: GcsServer

    def handle(self) -> None:
        """Answer what comes."""
        talk = Conversation(self.server.language, self.server.fault)
        try:
            while not talk.is_over and (data := self.request.recv(1 << 16)):
                for answer in talk.answers(bytes(data)):
                    self.request.sendall(answer)
        except OSError:  # the client has gone
            return


class PtyServer:
    """A controller on a pseudo terminal, which a client opens as a serial port.

    Parameters
    ----------
    controller : SimulatedController
        What is served.
    language : Spoken
        That it speaks.
    fault : Fault, optional
        What goes wrong; where the connection is dropped, the terminal is gone.

    Attributes
    ----------
    path : str
        Of the port.
    """

    def __init__(
        self, controller: SimulatedController, language: Spoken, fault: Fault | None = None
    ) -> None:
        self.controller, self.fault = controller, fault or Fault()
        self._talk = Conversation(language, self.fault)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._ends = threading.Event()

    def serve_forever(self) -> None:
        """Answer until `shutdown`, or until a fault drops the connection."""
        while not self._ends.is_set() and not self._talk.is_over:
            if select.select([self._master], [], [], _POLL)[0]:
                for answer in self._talk.answers(os.read(self._master, 1 << 16)):
                    self._send(answer)
        self._ends.set()
        os.close(self._master)
        os.close(self._slave)

    def _send(self, answer: bytes) -> None:
        """Send all of an answer, unless nobody reads it any more."""
        while answer and not self._ends.is_set():
            if select.select([], [self._master], [], _POLL)[1]:
                answer = answer[os.write(self._master, answer[:256]) :]

    def shutdown(self) -> None:
        """End `serve_forever`."""
        self._ends.set()


def run(options: argparse.Namespace, overrides: dict[str, Any], language: str = 'gcs') -> int:
    """Serve until interrupted."""
    plant = Plant.from_preset(options.preset, options.rate, options.seed, overrides)
    kind, _, after = options.fault.partition(':')
    if kind not in ('', *FAULTS) or not (after or '0').isdigit():
        raise SimulationError(
            f'--fault {options.fault}: write one of {", ".join(FAULTS)}, as drop:9'
        )
    if not options.speed > 0.0:
        raise SimulationError(f'--speed {options.speed:g}: time goes forwards; give more than 0')
    fault = Fault(kind, int(after or 0))
    controller = SimulatedController(plant, options.speed)
    try:
        if language == 'nv200' or options.pty:
            _serve_pty(controller, language, fault, options.link)
        else:
            _serve_tcp(controller, options.port, fault)
    except KeyboardInterrupt:
        print('ended', file=sys.stderr)
    return 0


def _serve_pty(
    controller: SimulatedController, language: str, fault: Fault, link: Path | None
) -> None:
    spoken = Nv200Language(controller) if language == 'nv200' else Language(controller)
    server = PtyServer(controller, spoken, fault)
    try:
        if link is not None:
            if link.is_symlink():  # of one that was killed
                link.unlink()
            link.symlink_to(server.path)
    except OSError as error:
        raise SimulationError(f'--link {link}: it cannot be made ({error.strerror})') from None
    try:
        _announce(f'{language}://{server.path}', controller)
        server.serve_forever()
    finally:
        if link is not None:
            link.unlink(missing_ok=True)


def _serve_tcp(controller: SimulatedController, port: int, fault: Fault) -> None:
    try:
        server = GcsServer(controller, port, fault)
    except OSError as error:
        raise SimulationError(
            f'port {port} cannot be served ({error.strerror or error}); choose another with --port'
        ) from None
    with server:
        _announce(f'gcs://127.0.0.1:{server.server_address[1]}', controller)
        server.serve_forever(poll_interval=0.1)


def _announce(address: str, controller: SimulatedController) -> None:
    plant = controller.plant
    print(
        f'{address}: {plant.preset.name} at {plant.rate:g} Hz, {controller.low:g} .. '
        f'{controller.high:g} V',
        flush=True,
    )
