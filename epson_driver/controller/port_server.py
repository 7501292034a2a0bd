# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A listening TCP port of the controller; what each port does is a subclass."""

import asyncio
import logging
import os
import socket
from abc import ABC, abstractmethod
from typing import ClassVar

from epson_driver.controller.connection import Connection
from epson_driver.simple_message import FrameError

HANDOVER = 0.1
"""How long a client waits for a place, s: one that reconnects meets its own end of before."""

_log = logging.getLogger(__name__)


class PortServer(ABC):
    """Accepts clients and serves each in a task of its own.

    One client more than `max_clients` is closed at once, and the others do not notice it.
    """

    name: ClassVar[str]
    max_clients: ClassVar[int] = 16
    max_unsent: ClassVar[int] = 65_536
    send_buffer: ClassVar[int | None] = None
    line_limit: ClassVar[int] = 65_536

    def __init__(self) -> None:
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._places = asyncio.Semaphore(self.max_clients)

    async def open(self, host: str, port: int) -> int:
        """Listen, and return the port; 0 asks for any free one. Raises OSError that says where."""
        try:
            family = socket.AF_INET6 if ':' in host else socket.AF_INET
            sock = socket.create_server((host, port), family=family)
        except (OSError, OverflowError) as error:
            number = error.errno if isinstance(error, OSError) else None
            reason = os.strerror(number) if number is not None and number > 0 else str(error)
            raise OSError(f'{self.name} port {host}:{port}: {reason}') from error
        if self.send_buffer is not None:  # accepted sockets inherit it
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self.send_buffer)
        self._server = await asyncio.start_server(self._accept, sock=sock, limit=self.line_limit)
        bound: int = sock.getsockname()[1]
        return bound

    async def close(self) -> None:
        """Stop listening and disconnect everybody."""
        if self._server is not None:
            self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @abstractmethod
    async def serve(self, connection: Connection) -> None:
        """Talk to one client until it is gone. A FrameError ends its connection."""

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            connection = Connection(self.name, reader, writer, self.max_unsent)
        except (OSError, TypeError):  # gone before it was served
            writer.transport.abort()
            return
        task = asyncio.create_task(self._attend(connection))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _attend(self, connection: Connection) -> None:
        try:
            async with asyncio.timeout(HANDOVER):
                await self._places.acquire()
            try:
                _log.info('%s connected', connection.name)
                await self.serve(connection)
                _log.info('%s gone', connection.name)
            finally:
                self._places.release()
        except TimeoutError:
            _log.warning('%s refused: as many connected as may be', connection.name)
        except FrameError as error:
            _log.warning('%s disconnected: %s', connection.name, error)
        finally:
            connection.close()
