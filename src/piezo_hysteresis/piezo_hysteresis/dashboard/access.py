"""Access control of the page: host names, origins, an optional token.

A page of another site can direct its own host name to this machine (DNS rebinding). Its requests
then reach the server as same-origin requests; only their host name shows that they are foreign.
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

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
