"""``python -m piezo_sim gcs``: the controller on a TCP port, with faults that a lab meets."""

from __future__ import annotations

import argparse
import socketserver
import sys
from dataclasses import dataclass
from typing import Any

from piezo_sim.errors import SimulationError
from piezo_sim.gcs.controller import SimulatedController
from piezo_sim.gcs.language import Language
from piezo_sim.plant import Plant

#: Faults: the connection is dropped, an answer cut in its middle, or nothing is answered.
FAULTS = ('drop', 'truncate', 'silence')
_CONTROLS = (5, 7, 9, 24)


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
        """Answer byte by byte: a command of one character may stand anywhere."""
        line = bytearray()
        while data := self._received():
            for byte in data:
                if byte in _CONTROLS:
                    answer = self.server.language.control(byte)
                elif byte == 10:
                    fault = self.server.fault.due()
                    if fault == 'drop':
                        return
                    answer = self.server.language.answer(line.decode('ascii', 'replace'))
                    line.clear()
                    if fault == 'truncate' and answer is not None:
                        self.request.sendall(answer[: len(answer) // 2].encode('latin-1'))
                        return
                    answer = None if fault == 'silence' else answer
                else:
                    line.append(byte)
                    continue
                if answer is not None:
                    self._send(answer)

    def _received(self) -> bytes:
        try:
            return bytes(self.request.recv(1 << 16))
        except OSError:
            return b''

    def _send(self, answer: str) -> None:
        """Send lines: all but the last end with a space before the line feed."""
        try:
            self.request.sendall((answer.replace('\n', ' \n') + '\n').encode('latin-1'))
        except OSError:
            return


def run(options: argparse.Namespace, overrides: dict[str, Any]) -> int:
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
        server = GcsServer(controller, options.port, fault)
    except OSError as error:
        raise SimulationError(
            f'port {options.port} cannot be served ({error.strerror or error}); choose another '
            'with --port'
        ) from None
    with server:
        print(
            f'gcs://127.0.0.1:{server.server_address[1]}: {plant.preset.name} at '
            f'{plant.rate:g} Hz, {server.controller.low:g} .. {server.controller.high:g} V',
            flush=True,
        )
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            print('ended', file=sys.stderr)
    return 0
