# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Serves the page and its websocket in a thread, under the rules of `access.py`."""

import asyncio
import errno
import functools
import http
import socket
import threading
from collections.abc import Callable
from importlib.resources import files
from typing import NamedTuple, Protocol, cast

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.http11 import Request, Response
from websockets.protocol import OPEN, Event

from epson_driver.pages import asset
from epson_driver.panel.access import Access, is_loopback, is_upgrade, own_names
from epson_driver.panel.window import BadMessageError, Window

PING_PERIOD_S = 2.0
PING_TIMEOUT_S = 10.0
"""Time without an answer to a ping after which a browser counts as disconnected, s. It is long,
because a slow connection may delay an answer by seconds. Arming ends after
arming.ALIVE_WITHIN_S."""

CLOSE_TIMEOUT_S = 1.0  # maximum wait for a browser's closing handshake, s
MAX_MESSAGE_BYTES = 10_000  # limit for a browser's message. The page sends far smaller ones
RECEIVE_BUFFER_BYTES = 4096
"""Receive buffer of a connection. It limits the data read from one window at a time."""

START_TIMEOUT_S = 10.0  # maximum time for the start of the server's thread, s
KINDS = {'html': 'text/html', 'js': 'text/javascript', 'css': 'text/css', 'svg': 'image/svg+xml'}
POLICY_VIOLATION = 1008  # websocket close code for a message that the page never sends


class WebServerError(RuntimeError):
    """The page cannot be served. The text is the reason and the remedy."""


class WindowListener(Protocol):
    """The receiver of new windows and of their messages. It is called in the server's thread."""

    def add(self, window: Window) -> None: ...
    def remove(self, window: Window) -> None: ...
    def received(self, window: Window, text: str | bytes) -> None:
        """Process a message.

        Raises BadMessageError if the panel's page never sends such a message.
        """


class Page(NamedTuple):
    content_type: str
    body: bytes


def page_files() -> dict[str, Page]:
    own = files('epson_driver.panel').joinpath('assets').iterdir()
    bodies = {item.name: item.read_bytes() for item in own}
    bodies |= {name: asset(name).encode() for name in ('bundle.js', 'bundle.css', 'arm.js')}
    result = {
        f'/{name}': Page(f'{KINDS[name.rpartition(".")[2]]}; charset=utf-8', body)
        for name, body in bodies.items()
    }
    result['/'] = result.pop('/index.html')
    return result


class WebServer:
    """Serves the page at an address of this machine.

    Clients must send the `token`, unless it is None. `on_error` is called with the failed part and
    the exception. Raises WebServerError if the port cannot be opened, or if other machines can
    reach the address and the token is None.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str | None,
        listener: WindowListener,
        on_error: Callable[[str, BaseException], None],
    ) -> None:
        if token is None and not is_loopback(host):
            raise WebServerError(f'{host} can be reached from other machines: a token is needed')
        self.host = host
        self._listening = _listening(host, port)
        self.port: int = self._listening.getsockname()[1]
        self.access = Access(self.port, own_names(host), token)
        self._pages = page_files()
        self._listener = listener
        self._on_error = on_error
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, name='web server', daemon=True)
        self._thread.start()
        if not self._started.wait(START_TIMEOUT_S):
            raise WebServerError(f'the server did not start within {START_TIMEOUT_S:g} s')

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def stop(self) -> None:
        if self._loop is not None and self._end is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # noqa: BLE001 - reported by `on_error`
            self._on_error('serving the page failed', error)
        finally:
            self._started.set()
            self._listening.close()

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        async with serve(
            self._talk,
            sock=self._listening,
            process_request=functools.partial(_answer, self.access, self._pages),
            create_connection=_Connection,
            max_size=MAX_MESSAGE_BYTES,
            ping_interval=PING_PERIOD_S,
            ping_timeout=PING_TIMEOUT_S,
            close_timeout=CLOSE_TIMEOUT_S,
            server_header=None,
        ) as server:
            self._started.set()
            await self._end.wait()
            server.close()

    async def _talk(self, connection: ServerConnection) -> None:
        window = cast(_Connection, connection).window
        writing = asyncio.create_task(window.write(connection.send))
        writing.add_done_callback(self._on_written)
        try:
            self._listener.add(window)
            async for message in connection:
                self._listener.received(window, message)
                await asyncio.sleep(0)  # serves other windows between two queued messages
        except BadMessageError as error:
            await connection.close(POLICY_VIOLATION, str(error)[:100])
        except ConnectionClosed:
            pass  # the window is gone
        except Exception as error:  # noqa: BLE001 - websockets would only print it
            self._on_error('a request of a window failed', error)
        finally:
            writing.cancel()
            try:
                self._listener.remove(window)
            except BaseException as error:  # noqa: BLE001 - websockets would only print it
                self._on_error('disarming failed', error)

    def _on_written(self, writing: 'asyncio.Task[None]') -> None:
        error = None if writing.cancelled() else writing.exception()
        if error is not None and not isinstance(error, ConnectionClosed):
            self._on_error('writing to a window failed', error)


class _Connection(ServerConnection):
    """A connection that is closed after too many frames (`Window.count`) or a fragmented message.

    Pings count as frames, because the library answers each ping. Fragments are refused, because
    the library would store any number of empty fragments.
    """

    @functools.cached_property
    def window(self) -> Window:
        return Window(self.loop)

    def process_event(self, event: Event) -> None:
        if isinstance(event, Frame) and self.protocol.state is OPEN:
            try:
                self.window.count(self.loop.time())
                if not event.fin or event.opcode is Opcode.CONT:
                    raise BadMessageError('fragmented messages are not supported')
            except BadMessageError as error:
                self.protocol.fail(POLICY_VIOLATION, str(error))
                self.send_data()
        super().process_event(event)


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise WebServerError(f'{host}: {error.strerror or error}') from error
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        listening.bind(address)
        listening.listen()
    except OSError as error:
        listening.close()
        remedy = 'end the process that uses it, or choose another port (0: any free port)'
        if error.errno == errno.EADDRNOTAVAIL:
            remedy = 'this machine has no such address: choose one of its addresses as host'
        what = f'port {port} of {host} cannot be opened'
        raise WebServerError(f'{what}: {error.strerror}; {remedy}') from error
    return listening


def _answer(
    access: Access, pages: dict[str, Page], connection: ServerConnection, request: Request
) -> Response | None:
    """Return the response to a request, or None to open a websocket."""
    headers = {}
    for name, value in request.headers.raw_items():
        if name.lower() in headers and name.lower() != 'cookie':
            return _text(400, f'the header {name} occurs twice')
        headers[name.lower()] = value
    rejection = access.rejection(request.path, headers, connection.local_address[0])
    if rejection is not None:
        return _text(403, rejection)
    if is_upgrade(headers):
        return None
    page = pages.get(request.path.partition('?')[0])
    if page is None:
        return _text(404, 'unknown page')
    return _response(200, page, access.new_headers(request.path))


def _text(status: int, text: str) -> Response:
    return _response(status, Page('text/plain; charset=utf-8', f'{text}\n'.encode()), {})


def _response(status: int, page: Page, more: dict[str, str]) -> Response:
    headers = {'Content-Type': page.content_type, 'Content-Length': str(len(page.body))}
    headers |= {'Connection': 'close', **more}
    return Response(status, http.HTTPStatus(status).phrase, Headers(headers), page.body)
