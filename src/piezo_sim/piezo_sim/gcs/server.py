"""Servers of ``python -m piezo_sim gcs`` and ``nv200`` on a TCP port or a pty, with faults."""

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

from piezo_hysteresis.common.wording import reason_of
from piezo_sim.gcs.controller import SimulatedController
from piezo_sim.gcs.language import Language
from piezo_sim.gcs.nv200 import Nv200Language
from piezo_sim.plant import Plant
from piezo_sim.simulation_errors import SimulationError

#: Faults: dropped connection, truncated answer, missing answer, late answer.
FAULTS = ('drop', 'truncate', 'silence', 'late')
LATE = 0.5  # delay of a late answer [s]
_POLL = 0.02  # period at which a pty checks for shutdown [s]


@dataclass
class Fault:
    """A fault that occurs once."""

    kind: str = ''  # one of `FAULTS`; empty for none
    after: int = 0  # number of lines answered before the fault

    def due(self) -> str:
        """Count a line; return the fault if it is due."""
        if not self.kind:
            return ''
        self.after -= 1
        if self.after >= 0:
            return ''
        kind, self.kind = self.kind, ''
        return kind


class ServedProtocol(Protocol):
    """Interface of a protocol: line ends and answers."""

    controls: tuple[int, ...]  # single-byte commands

    def control(self, byte: int) -> str | None:
        """Return the answer to a single-byte command."""

    def answer(self, line: str) -> str | None:
        """Return the answer to a line; None without an answer."""

    def framed(self, answer: str) -> bytes:
        """Return the bytes of an answer."""


class Conversation:
    """Byte stream of one client; a single-byte command may occur anywhere."""

    def __init__(self, language: ServedProtocol, fault: Fault) -> None:
        self._language, self._fault = language, fault
        self._line = bytearray()
        self.is_over = False

    def answers(self, data: bytes) -> Iterator[bytes]:
        """Yield the answers; the caller closes the connection if `is_over` is set."""
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


class GcsServer(socketserver.ThreadingTCPServer):
    """Server of a controller for several clients at a time."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(
        self,
        controller: SimulatedController,
        port: int = 0,
        fault: Fault | None = None,
        language: ServedProtocol | None = None,
    ) -> None:
        super().__init__(('127.0.0.1', port), _Client)
        self.controller, self.fault = controller, fault or Fault()
        self.language = language or Language(controller)
        self.lock = threading.Lock()


class _Client(socketserver.BaseRequestHandler):
    """Serves one client until it disconnects."""

    server: GcsServer

    def handle(self) -> None:
        """Answer the commands of the client."""
        talk = Conversation(self.server.language, self.server.fault)
        try:
            while not talk.is_over and (data := self.request.recv(1 << 16)):
                with self.server.lock:
                    answers = list(talk.answers(bytes(data)))
                for answer in answers:
                    self.request.sendall(answer)
        except OSError:  # the client has disconnected
            return


class PtyServer:
    """Server of a controller on a pseudo terminal, which a client opens as a serial port."""

    def __init__(
        self, controller: SimulatedController, language: ServedProtocol, fault: Fault | None = None
    ) -> None:
        self.controller, self.fault = controller, fault or Fault()
        self._talk = Conversation(language, self.fault)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._ends = threading.Event()

    def serve_forever(self) -> None:
        """Serve until `shutdown`, or until a fault drops the connection."""
        while not self._ends.is_set() and not self._talk.is_over:
            if select.select([self._master], [], [], _POLL)[0]:
                for answer in self._talk.answers(os.read(self._master, 1 << 16)):
                    self._send(answer)
        self._ends.set()
        os.close(self._master)
        os.close(self._slave)

    def _send(self, answer: bytes) -> None:
        """Send a complete answer, unless the client has closed the port."""
        while answer and not self._ends.is_set():
            if select.select([], [self._master], [], _POLL)[1]:
                answer = answer[os.write(self._master, answer[:256]) :]

    def shutdown(self) -> None:
        """Stop `serve_forever`."""
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
    protocol = Nv200Language(controller) if language == 'nv200' else Language(controller)
    server = PtyServer(controller, protocol, fault)
    try:
        if link is not None:
            if link.is_symlink():  # left by a killed process
                link.unlink()
            link.symlink_to(server.path)
    except OSError as error:
        raise SimulationError(f'--link {link}: it cannot be made ({reason_of(error)})') from None
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
            f'port {port} cannot be served ({reason_of(error)}); choose another with --port'
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
