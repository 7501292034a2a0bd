# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""viser's server on a port of ours, behind the rules of `access.py`.

viser lets any page connect, takes the next port if the one it was asked for is taken, and has a
handler that opens a tunnel to the Internet. None of that has a setting, so its server is started
with a `serve` of websockets that knows better. That is not a public interface of viser: the
version is pinned and checked here, and a test tries each rule on a running panel.
"""

import contextlib
import functools
import http
import io
import socket
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from viser._messages import ShareUrlDisconnect, ShareUrlRequest
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from epson_driver.panel.access import Access, is_loopback, is_upgrade, own_names
from epson_driver.panel.page_html import ALIVE_PATH

VISER_VERSION = '1.1.1'

PING_PERIOD_S = 2.0
PING_TIMEOUT_S = 10.0
"""A browser that is silent for so long is taken for gone, s. Long: a page that compiles its
shaders, or a slow line, may keep an answer waiting for seconds. What it has started ends sooner:
arming.ALIVE_WITHIN_S."""

MAX_MESSAGE_BYTES = 1_000_000
"""Of what a browser sends. Clicks and camera poses are far smaller."""

_patching = threading.Lock()

warnings.filterwarnings('ignore', 'Queued a .* on a closed connection', UserWarning)
"""A browser that goes while its controls are drawn is nothing to warn of."""


class WebServerError(RuntimeError):
    """The page cannot be served, with the reason and the remedy as text."""


class WebServer:
    """viser's server at an address of this machine. `token`: needed by whoever comes, if not None.

    `on_alive` is called in viser's event loop, with the secret of a window whose page gives a
    sign of life (page_html.alive_html).

    Raises WebServerError for a port that is taken, an address that is not of this machine, or a
    viser of another version.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str | None,
        on_alive: Callable[[str], object] = lambda _window: None,
    ) -> None:
        if viser.__version__ != VISER_VERSION:
            raise WebServerError(
                f'viser {viser.__version__} is installed: the panel needs viser {VISER_VERSION}, '
                f'as it relies on its inside (pip install viser=={VISER_VERSION})'
            )
        if token is None and not is_loopback(host):
            raise WebServerError(f'{host} is reached from other machines: a token is needed')
        listening = _listening(host, port)
        self.port: int = listening.getsockname()[1]
        self.access = Access(self.port, own_names(host), token)
        with _serving(listening, self.access, on_alive), contextlib.redirect_stdout(io.StringIO()):
            self.viser = viser.ViserServer(
                host=host, port=self.port, label='epson_driver', verbose=False
            )
        for message in (ShareUrlRequest, ShareUrlDisconnect):
            self.viser._websock_server.unregister_handler(message)

    @property
    def alive(self) -> bool:
        """Whether the thread runs that serves the page."""
        thread = self.viser._websock_server._server_thread
        return thread is not None and thread.is_alive()

    def stop(self) -> None:
        """Close the port and all connections."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise WebServerError(f'{host}: {error.strerror or error}') from error
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen()
    except OSError as error:
        listening.close()
        raise WebServerError(
            f'port {port} of {host} cannot be opened: {error.strerror}; end the process that has '
            'it, or choose another with --port (0: any free one)'
        ) from error
    return listening


@contextlib.contextmanager
def _serving(
    listening: socket.socket, access: Access, on_alive: Callable[[str], object]
) -> Iterator[None]:
    """Have websockets serve on a socket and by rules of ours, within the block."""
    served = []
    original = websockets.asyncio.server.serve

    def serve(
        handler: Any, _host: str, _port: int, *, process_request: Any, **options: Any
    ) -> Any:
        served.append(True)
        options |= {
            'max_size': MAX_MESSAGE_BYTES,
            'ping_interval': PING_PERIOD_S,
            'ping_timeout': PING_TIMEOUT_S,
            'server_header': None,
        }
        return original(
            handler,
            sock=listening,
            process_request=functools.partial(_answer, access, on_alive, process_request),
            **options,
        )

    with _patching:
        websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]
    if not served:
        listening.close()
        raise WebServerError('viser did not start its server as expected')


def _answer(
    access: Access,
    on_alive: Callable[[str], object],
    serve_page: Any,
    connection: ServerConnection,
    request: Request,
) -> Response | None:
    """Answer a request with the page or a rejection, or None to open a websocket."""
    headers = {}
    for name, value in request.headers.raw_items():
        if name.lower() in headers and name.lower() != 'cookie':
            return _text(400, f'the header {name} is there twice')
        headers[name.lower()] = value
    rejection = access.rejection(request.path, headers, connection.local_address[0])
    if rejection is not None:
        return _text(rejection.status, rejection.text)
    if is_upgrade(headers):
        return None
    path, _, window = request.path.partition('?')
    if path == ALIVE_PATH:
        on_alive(window)
        return _text(200, 'noted')
    page: Response = serve_page(connection, request)
    for name, value in access.new_headers(request.path).items():
        page.headers[name] = value
    return page


def _text(status: int, text: str) -> Response:
    body = f'{text}\n'.encode()
    headers = Headers(
        {
            'Content-Type': 'text/plain; charset=utf-8',
            'Content-Length': str(len(body)),
            'Connection': 'close',
        }
    )
    return Response(status, http.HTTPStatus(status).phrase, headers, body)
