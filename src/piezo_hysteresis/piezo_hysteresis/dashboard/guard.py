"""Bokeh application with access control of every request, for all handlers."""

from __future__ import annotations

from typing import Any
from urllib.parse import unquote, urlencode

from bokeh.server.tornado import BokehTornado
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform, RequestHandler

from piezo_hysteresis.dashboard.access import AccessPolicy, Refusal

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
