"""Bokeh's application behind one door: no handler, its own or ours, is reached past it."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlencode

from bokeh.server.tornado import BokehTornado
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform, RequestHandler

from piezo_hysteresis.dashboard.access import AccessPolicy, Refusal

_NO_TOKEN = Refusal(401, 'This page asks for its token: open it once with ?token=... behind.')
# Every answer carries them: no frame of another page shows this one, no address leaves with it.
_HEADERS = {
    'Content-Security-Policy': "frame-ancestors 'none'",
    'X-Frame-Options': 'DENY',
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'same-origin',
}


class GuardedApplication(BokehTornado):
    """Bokeh's application that asks an `AccessPolicy` first.

    Parameters
    ----------
    applications : dict
        As Bokeh takes them.
    access : AccessPolicy
        Judges every request.
    **settings
        As Bokeh takes them.
    """

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
        """Return what answers a request; every one, a WebSocket's too, comes through here."""
        request.uri = request.path  # what is logged of it; a token may stand behind
        refusal = self._access.refusal(request.headers)
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
    """Writes the headers of every answer."""

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add them."""
        for name, value in _HEADERS.items():
            headers[name] = value
        return status_code, headers, chunk


class _Refused(RequestHandler):
    """Answers with the reason, whatever was asked."""

    def initialize(self, refusal: Refusal) -> None:
        """Take the reason."""
        self._refusal = refusal

    def prepare(self) -> None:
        """Reply before the method is looked at."""
        self.set_status(self._refusal.status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(self._refusal.reason + '\n')


class _Admission(RequestHandler):
    """Stores an accepted token in a cookie, and removes it from the address."""

    def initialize(self, cookie: str, target: str) -> None:
        """Take what is remembered, and where the reader goes on."""
        self._cookie, self._target = cookie, target

    def get(self) -> None:
        """Send the reader on."""
        self.add_header('Set-Cookie', self._cookie)
        self.redirect(self._target)


class _Head(RequestHandler):
    """Answers that the page exists, without opening it."""

    def head(self) -> None:
        """Return what the page would begin with."""
        self.set_header('Content-Type', 'text/html; charset=UTF-8')
