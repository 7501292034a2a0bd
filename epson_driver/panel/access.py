# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Access rules: only the panel's own page, at its own address, with the token if one is set.

Every page in the same browser can send requests to this port. The header Origin, which pages
cannot change, names the page that sends a request. A websocket needs the panel's own origin. Other
requests may lack an Origin, because browsers send none when a user follows a link. The header Host
must name this machine, which prevents DNS rebinding.
"""

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

TOKEN_BYTES = 24
"""Number of random bytes in the token of a panel that other machines can reach."""

LOOPBACK_NAMES = frozenset({'127.0.0.1', 'localhost', '[::1]'})


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a server at `host`."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == 'localhost'


def new_token(host: str) -> str | None:
    """Return a token for a server at `host`, or None if only this machine can reach it."""
    return None if is_loopback(host) else secrets.token_urlsafe(TOKEN_BYTES)


def own_names(host: str) -> frozenset[str]:
    """Return the lower-case host names that may appear in the URL of a page served at `host`."""
    if is_loopback(host):
        return LOOPBACK_NAMES
    return LOOPBACK_NAMES | {
        bracketed(host),
        socket.gethostname().lower(),
        socket.getfqdn().lower(),
    }


def bracketed(address: str) -> str:
    return f'[{address}]' if ':' in address else address.lower()


@dataclass(frozen=True)
class Access:
    """The access rules of one panel.

    Each request must contain the `token`, unless it is None.
    """

    port: int
    names: frozenset[str]
    token: str | None = None

    def rejection(self, path: str, headers: Mapping[str, str], local_address: str) -> str | None:
        """Return why a request is rejected, or None.

        `headers`: lower-case name of each header → its value.
        """
        names = self.names | {bracketed(local_address)}
        own = {f'{name}:{self.port}' for name in names}
        if self.port == 80:
            own |= names
        host = headers.get('host', '').lower()
        if host not in own:
            return f'this panel is not {shown(host)}'
        origin = headers.get('origin')
        if origin is None and is_upgrade(headers):
            return 'a websocket without an Origin is rejected'
        if origin is not None and origin.lower() not in {f'http://{item}' for item in own}:
            return f'{shown(origin)} is not the page of this panel'
        if self.token is not None and not self._has_token(path, headers):
            return 'a token is needed: open the address printed by the panel'
        return None

    @property
    def cookie(self) -> str:
        """The name of the token's cookie.

        The name contains the port, because all ports of a host share cookies.
        """
        return f'epson_driver_panel_{self.port}'

    def new_headers(self, path: str) -> dict[str, str]:
        headers = {
            'Content-Security-Policy': CONTENT_SECURITY_POLICY,
            'X-Frame-Options': 'DENY',
            'X-Content-Type-Options': 'nosniff',
            'Referrer-Policy': 'no-referrer',
            'Cross-Origin-Opener-Policy': 'same-origin',
            'Cache-Control': 'no-store',
        }
        if self.token is not None and _token_of(path) is not None:
            headers['Set-Cookie'] = (
                f'{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict'
            )
        return headers

    def _has_token(self, path: str, headers: Mapping[str, str]) -> bool:
        tokens = [_token_of(path)]
        try:
            cookies = SimpleCookie(headers.get('cookie', ''))
        except CookieError:
            cookies = SimpleCookie()
        if self.cookie in cookies:
            tokens.append(cookies[self.cookie].value)
        expected = str(self.token).encode()
        return any(
            item is not None and hmac.compare_digest(item.encode(), expected) for item in tokens
        )


CONTENT_SECURITY_POLICY = '; '.join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self'",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""The page may send requests to its own origin only, and no other page may show it in a frame."""


def is_upgrade(headers: Mapping[str, str]) -> bool:
    return headers.get('upgrade', '').lower() == 'websocket'


def shown(text: str) -> str:
    return repr(text[:100])


def _token_of(path: str) -> str | None:
    tokens = parse_qs(urlsplit(path).query).get('token', [])
    return tokens[0] if len(tokens) == 1 else None
