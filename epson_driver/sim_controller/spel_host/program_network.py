# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The TCP ports that a SPEL+ program opens, its port objects 201 to 216.

A port object that the program has opened as a server serves the next client of its TCP port. Like
on real controllers, it serves no other client until the program closes and reopens it. The manual
does not document what happens to new clients when the task that opened the port has ended. Here
they are refused, because no task would answer them.
"""

import logging
from collections.abc import Callable, Mapping

from epson_driver.sim_controller.ports import Send, Session
from epson_driver.spel import NetSettings, SpelError
from epson_driver.spel.errors import to_add

MAX_UNREAD_BYTES = 65_536  # a client with more unread bytes is disconnected
OPEN_FAILED = 2900
NO_PEER = 2902

_log = logging.getLogger(__name__)


class PortObject(Session):
    def __init__(
        self, settings: NetSettings, name: str, news: Callable[[], None], client: bool = False
    ) -> None:
        self.settings = settings
        self.name = name
        self.client = client
        self.connected = False
        self.had_client = False
        self.orphaned = False  # whether the task that opened it has ended
        self.is_open = True  # whether the program has the port open
        self.unread = bytearray()
        self._news = news
        self._send: Send | None = None
        self._close: Callable[[], None] | None = None

    @property
    def tcp_port(self) -> int:
        return self.settings.tcp_port

    def start(self, send: Send, close: Callable[[], None]) -> None:
        self.connected = self.had_client = True
        self._send, self._close = send, close
        self._news()

    def receive(self, data: bytes) -> None:
        if not self.connected:
            return
        if len(self.unread) + len(data) > MAX_UNREAD_BYTES:
            text = 'the program does not read: %s client disconnected with %d bytes unread'
            _log.warning(text, self.name, len(self.unread))
            self.end()
            return
        self.unread += data
        self._news()

    def send(self, data: bytes) -> None:
        if self._send is None:
            raise SpelError(NO_PEER, f'TCP port {self.settings.tcp_port} has no peer')
        self._send(data)

    def closed(self) -> None:
        """Record that the client has disconnected. Its bytes can still be read."""
        self.connected = False
        self._send = self._close = None
        self._news()

    def end(self) -> None:
        self.is_open = False
        close = self._close
        self.closed()
        if close is not None:
            close()


class ProgramNetwork:
    """The network ports that a SPEL+ program opens with OpenNet.

    * `names`: TCP port in the program → name of the controller's port. The number of a port
      without a name is used as its name.
    * `listen`: called with the number of a port without a name when the program first opens it as
      a server. May raise OSError.
    * `connect`: called with each port that the program opens as a client. If it is None, the port
      is connected to the program's own server port, if any.
    * `news`: called when a port object has changed.
    """

    def __init__(self, names: Mapping[int, str]) -> None:
        self._names = names
        self._objects: dict[int, PortObject] = {}
        self._listened: set[int] = set()
        self.listen: Callable[[int], None] = _nobody
        self.connect: Callable[[PortObject], None] | None = None
        self.news: Callable[[], None] = _nothing

    def name(self, tcp_port: int) -> str:
        return self._names.get(tcp_port, str(tcp_port))

    # Clients

    def rejection(self, port: str) -> str | None:
        result = self._open(port)
        if result is None:
            return f'the program has not opened the {port} port'
        if result.orphaned:
            return f'the task that opened the {port} port has ended'
        if result.connected:
            return f'the {port} port already has a client'
        if result.had_client:
            return f'the {port} port has lost its client, and the program has not reopened it yet'
        return None

    def session(self, port: str, send: Send, close: Callable[[], None]) -> Session:
        result = self._open(port)
        if result is None:
            raise ConnectionRefusedError(self.rejection(port))
        result.start(send, close)
        return result

    def _open(self, port: str) -> PortObject | None:
        return next((item for item in self._objects.values() if item.name == port), None)

    # The program

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        tcp_port = settings.tcp_port
        if tcp_port == 0:
            advice = to_add('ports', f'{port}: ADDRESS:PORT')
            text = f'port {port} has no TCP port: use SetNet, or {advice}'
            raise SpelError(OPEN_FAILED, text)
        self.close_net(port)
        if not server:
            client = PortObject(settings, f'{tcp_port} (client)', lambda: self.news(), client=True)
            self._objects[port] = client
            if self.connect is not None:
                self.connect(client)
            else:
                self._meet()
            return
        name = self.name(tcp_port)
        if self._open(name) is not None:
            text = f'OpenNet #{port}: another port object serves TCP port {tcp_port}'
            raise SpelError(OPEN_FAILED, text)
        if tcp_port not in self._names and tcp_port not in self._listened:
            try:
                self.listen(tcp_port)
            except OSError as error:
                raise SpelError(OPEN_FAILED, f'OpenNet #{port}: {error}') from error
            self._listened.add(tcp_port)
        self._objects[port] = PortObject(settings, name, lambda: self.news())
        if self.connect is None:
            self._meet()

    def _meet(self) -> None:
        """Connect the program's client ports with its server ports of the same number."""
        for client in self._objects.values():
            server = self._open(self.name(client.tcp_port)) if client.client else None
            if server is None or client.had_client or server.had_client or server.orphaned:
                continue
            client.start(server.receive, server.closed)
            server.start(client.receive, client.closed)

    def close_net(self, port: int) -> None:
        result = self._objects.pop(port, None)
        if result is not None:
            result.end()

    def release_owner(self, port: int) -> None:
        """Refuse new clients of a port whose task has ended. A connected client remains."""
        result = self._objects.get(port)
        if result is not None:
            result.orphaned = True

    def close_all(self) -> None:
        for port in list(self._objects):
            self.close_net(port)

    def connected(self, port: int) -> bool:
        result = self._objects.get(port)
        return result is not None and result.connected

    def received(self, port: int) -> bytes:
        result = self._objects.get(port)
        return bytes(result.unread) if result is not None else b''

    def take(self, port: int, count: int) -> bytes:
        unread = self._objects[port].unread
        data = bytes(unread[:count])
        del unread[:count]
        return data

    def send(self, port: int, data: bytes) -> None:
        result = self._objects.get(port)
        if result is None:
            raise SpelError(NO_PEER, f'port {port} has no peer')
        result.send(data)


def _nobody(_port: object) -> None:
    """Do nothing, because clients without sockets call `session` directly."""


def _nothing() -> None:
    pass
