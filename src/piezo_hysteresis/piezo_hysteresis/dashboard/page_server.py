"""Web server of the page and the reports on this machine, in its own thread."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.web import HTTPError, StaticFileHandler

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.dashboard.access import LOCAL_NAMES, AccessPolicy
from piezo_hysteresis.dashboard.backend import Backend
from piezo_hysteresis.dashboard.guard import GuardedApplication
from piezo_hysteresis.dashboard.live_page import Page
from piezo_hysteresis.errors import PiezoError

# A client that reads nothing for this time is disconnected [s].
STALLED_AFTER = 15.0
# Time after which the session of a disconnected client is removed [ms].
OLDEST = 5000
_NAMESPACE = re.compile(r'^[A-Za-z]\w*(/[A-Za-z]\w*)*$', re.ASCII)


class StalledClients:
    """Disconnects clients that stopped reading: what is queued for them would grow forever."""

    def __init__(self, application: Any) -> None:
        self._application = application
        self._seen: dict[Any, int] = {}

    def look(self) -> None:
        """Close each connection whose queue made no progress since the last call."""
        before, self._seen = self._seen, {}
        for connection in list(self._application._clients):
            stream = getattr(connection._socket.ws_connection, 'stream', None)
            if stream is None or not stream.writing():
                continue
            done = stream._total_write_done_index
            self._seen[stream] = done
            if before.get(stream) == done:
                stream.close()


def in_one_line(record: logging.LogRecord) -> bool:
    """Log what a client sent by mistake in one line, without a traceback."""
    # Bokeh logs these right after their cause.
    if record.args and str(record.args[0]).startswith('server failed to '):  # type: ignore[index]
        return False
    record.msg, record.args = record.getMessage().splitlines()[0][:200], ()
    record.exc_info = record.exc_text = None
    return True


class ReportHandler(StaticFileHandler):
    """Handler that serves only reports from one folder."""

    def validate_absolute_path(self, root: str, absolute_path: str) -> str | None:
        """Reject a path that is no report or is outside the folder, with links resolved."""
        try:
            target = Path(absolute_path).resolve()
            target.exists()  # raises where the name is too long
        except (OSError, ValueError):
            raise HTTPError(400) from None
        if Path(root).resolve() not in target.parents or target.suffix != '.html':
            raise HTTPError(404)
        return super().validate_absolute_path(root, absolute_path)


class DashboardServer:
    """The web server of the page."""

    def __init__(
        self,
        backend: Backend,
        *,
        address: str,
        port: int,
        folder: str,
        origins: Sequence[str] = (),
        token: str = '',
        refresh: float = 10.0,  # [Hz]
    ) -> None:
        AccessPolicy(address, port, origins, token)  # checked before the port is opened
        self._backend = backend
        self._refresh = refresh
        try:
            self._sockets, self.port = bind_sockets(address, port)
        except OSError as error:
            raise PiezoError(
                f'{address}:{port} cannot be listened to ({reason_of(error)}); give another port'
            ) from None
        self._address, self._folder = address, folder
        self._access = AccessPolicy(address, self.port, origins, token)
        self._loop: IOLoop | None = None
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='dashboard', daemon=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        name = self._address if self._address in LOCAL_NAMES else 'localhost'
        return f'http://{name}:{self.port}/'

    @property
    def local(self) -> bool:
        """Whether it is accessible only from this machine."""
        return all(s.getsockname()[0].startswith(('127.', '::1')) for s in self._sockets)

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Start the server."""
        self._thread.start()
        self._ready.wait(10.0)

    def stop(self) -> None:
        """Close every page and end the thread."""
        if self._loop is not None:
            self._loop.add_callback(self._loop.stop)
        self._thread.join(5.0)

    def _serve(self) -> None:
        # a disconnected client needs no warning
        logging.getLogger('bokeh').setLevel(logging.ERROR)
        for name in ('bokeh.server.views.ws', 'bokeh.server.protocol_handler'):
            logging.getLogger(name).addFilter(in_one_line)
        # What it finds in a header is logged again when the connection is closed.
        logging.getLogger('bokeh.protocol').disabled = True
        asyncio.set_event_loop(asyncio.new_event_loop())
        loop = IOLoop.current()
        application = Application(FunctionHandler(self._new_page))
        tornado = GuardedApplication(
            {'/': application},
            access=self._access,
            extra_websocket_origins=self._access.names,
            extra_patterns=[(r'/reports/(.*)', ReportHandler, {'path': self._folder})],
            unused_session_lifetime_milliseconds=OLDEST,
            check_unused_sessions_milliseconds=OLDEST,
            stats_log_frequency_milliseconds=3_600_000,
        )
        http = HTTPServer(tornado)
        http.add_sockets(self._sockets)
        server = BaseServer(loop, tornado, http)
        server.start()
        stalled = StalledClients(tornado)
        PeriodicCallback(stalled.look, 1000.0 * STALLED_AFTER).start()
        self._loop = loop
        self._ready.set()
        try:
            loop.start()
        finally:
            with contextlib.suppress(Exception):  # pages that are open end with the process
                server.stop(wait=False)
            loop.close(all_fds=True)

    def _new_page(self, document: Document) -> None:
        arguments = document.session_context.request.arguments.get('actuator', [b''])
        asked = arguments[0].decode('utf-8', 'replace').strip('/')
        chosen = bool(_NAMESPACE.match(asked)) and self._backend.allows(asked)
        actuator = asked if chosen else self._backend.actuators()[0]
        Page(document, self._backend, actuator, chosen, self._refresh)
