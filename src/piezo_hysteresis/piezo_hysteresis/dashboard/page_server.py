"""Web server of the page and the reports on this machine, in its own thread."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import hmac
import logging
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlencode, urlsplit

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.web import HTTPError, OutputTransform, RequestHandler, StaticFileHandler

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.dashboard.backend import Backend
from piezo_hysteresis.dashboard.pictures import Page
from piezo_hysteresis.errors import PiezoError

# Names of this machine as a browser on it writes them.
LOCAL_NAMES = ('localhost', '127.0.0.1', '[::1]')
# Wildcard addresses, which are no host name of a browser.
_EVERY_ADDRESS = ('', '0.0.0.0', '::')
# Default ports, which a browser omits from a name.
_USUAL_PORT = re.compile(r':(80|443)$')
_NAME = re.compile(r'^(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:\d{1,5})?$')
# Shorter tokens can be guessed [characters].
SHORTEST_TOKEN = 16


@dataclass(frozen=True)
class Refusal:
    """Reason for the rejection of a request."""

    status: int  # HTTP status
    reason: str  # problem and remedy, without any text of the request


class AccessPolicy:
    """Access control of a request by its headers, before any handler."""

    def __init__(
        self, address: str, port: int, origins: Sequence[str] = (), token: str = ''
    ) -> None:
        if token and (len(token) < SHORTEST_TOKEN or not token.isascii()):
            raise PiezoError(
                f'token has to be {SHORTEST_TOKEN} or more characters of ASCII; one is made by '
                "python3 -c 'import secrets; print(secrets.token_urlsafe())'"
            )
        own = [*LOCAL_NAMES, *([] if address in _EVERY_ADDRESS else [_bracketed(address)])]
        self.names = tuple(
            dict.fromkeys(
                [*(_canonical(f'{name}:{port}') for name in own), *map(_checked, origins)]
            )
        )
        self._token = token
        # A proof of the token, so that the token itself is in no later request.
        self._proof = hmac.new(token.encode(), b'piezo page', hashlib.sha256).hexdigest()
        # Browsers share cookies between ports.
        self.cookie = f'piezo_page_{port}'

    @property
    def proof(self) -> str:
        """The value of the cookie after the token was accepted."""
        return self._proof

    def refusal(self, headers: Mapping[str, str]) -> Refusal | None:
        """Return the reason to reject a request with these headers, None to accept it.

        A request without an origin comes from a program or from a followed link.
        """
        if _canonical(headers.get('Host', '')) not in self.names:
            return Refusal(
                403,
                f'This page is not known by that name. Open http://{self.names[0]}/ on its own '
                'machine, or name the host in the parameter origins of the dashboard.',
            )
        for name in ('Origin', 'Sec-Websocket-Origin'):
            if name in headers and not self._is_known_host(headers[name]):
                return Refusal(403, 'Pages of other sites may not use this one.')
        return None

    def _is_known_host(self, origin: str) -> bool:
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return parts.scheme in ('http', 'https') and _canonical(parts.netloc) in self.names

    def shown(self, token: str) -> bool:
        """Return whether a text is the token."""
        return bool(self._token) and hmac.compare_digest(token.encode(), self._token.encode())

    def admitted(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request carries the token, if one is required."""
        if not self._token:
            return True
        try:
            cookies = SimpleCookie(headers.get('Cookie', ''))
        except CookieError:
            return False
        found = cookies.get(self.cookie)
        return found is not None and hmac.compare_digest(found.value.encode(), self.proof.encode())


def _bracketed(address: str) -> str:
    return f'[{address}]' if ':' in address else address


def _canonical(name: str) -> str:
    """Return the normalised form of a host name with its port."""
    return _USUAL_PORT.sub('', name.strip().lower())


def _checked(origin: str) -> str:
    name = _canonical(origin)
    if not _NAME.match(name):
        raise PiezoError(f'origins holds {origin!r}; write HOST:PORT, as in bench:5006')
    return name


_NO_TOKEN = Refusal(401, 'This page asks for its token: open it once with ?token=... behind.')
# Headers of every response: no embedding in other pages, no referrer.
_HEADERS = {
    'Content-Security-Policy': "frame-ancestors 'none'",
    'X-Frame-Options': 'DENY',
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'same-origin',
}


class GuardedApplication(BokehTornado):
    """Bokeh application that checks an `AccessPolicy` first."""

    def __init__(self, applications: Any, *, access: AccessPolicy, **settings: Any) -> None:
        self._access = access
        super().__init__(applications, **settings)
        self.transforms.append(_Headers)

    def resources(self, absolute_url: str | bool | None = None) -> Any:
        """Return Bokeh's resources without the scripts that the page does not need."""
        found = super().resources(absolute_url)
        found.components = ['bokeh', 'bokeh-widgets']
        return found

    def find_handler(self, request: HTTPServerRequest, **more: Any) -> Any:
        """Return the handler of a request; all requests, WebSockets included, pass here."""
        request.uri = request.path  # the logged part of the address; a token may follow it
        refusal = self._access.refusal(request.headers)
        if '\0' in unquote(request.path):
            refusal = Refusal(400, 'the path has a null byte: open / instead')
        if refusal is None and self._shows_token(request):
            cookie = f'{self._access.cookie}={self._access.proof}; HttpOnly; SameSite=Lax; Path=/'
            details = {'cookie': cookie, 'target': _without_token(request)}
            return self.get_handler_delegate(request, _Admission, details)
        if refusal is None and not self._access.admitted(request.headers):
            refusal = _NO_TOKEN
        if refusal is not None:
            return self.get_handler_delegate(request, _Refused, {'refusal': refusal})
        if request.method == 'HEAD' and request.path == '/':
            return self.get_handler_delegate(request, _Head)
        return super().find_handler(request, **more)

    def _shows_token(self, request: HTTPServerRequest) -> bool:
        shown = request.query_arguments.get('token', [])
        return (
            request.method == 'GET'
            and request.path == '/'
            and any(self._access.shown(token.decode('utf-8', 'replace')) for token in shown)
        )


def _without_token(request: HTTPServerRequest) -> str:
    """Return the address of a request for the page without the token in it."""
    rest = [
        (name, value.decode('utf-8', 'replace'))
        for name, values in request.query_arguments.items()
        for value in values
        if name != 'token'
    ]
    return f'/?{urlencode(rest)}' if rest else '/'


class _Headers(OutputTransform):
    """Adds the headers to every response."""

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add the headers to the first chunk."""
        for name, value in _HEADERS.items():
            headers[name] = value
        return status_code, headers, chunk


class _Refused(RequestHandler):
    """Handler that responds with the reason of a rejection."""

    def initialize(self, refusal: Refusal) -> None:
        """Store the reason."""
        self._refusal = refusal

    def prepare(self) -> None:
        """Respond before the method is evaluated."""
        self.set_status(self._refusal.status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(self._refusal.reason + '\n')


class _Admission(RequestHandler):
    """Stores an accepted token in a cookie, and removes it from the address."""

    def initialize(self, cookie: str, target: str) -> None:
        """Store the cookie, and the address to redirect to."""
        self._cookie, self._target = cookie, target

    def get(self) -> None:
        """Redirect the client."""
        self.add_header('Set-Cookie', self._cookie)
        self.redirect(self._target)


class _Head(RequestHandler):
    """Handler of HEAD requests, which do not open the page."""

    def head(self) -> None:
        """Return the headers of the page."""
        self.set_header('Content-Type', 'text/html; charset=UTF-8')


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
