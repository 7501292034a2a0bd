# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's listening TCP ports: sockets for the sessions of the core.

Misbehaving clients must not prevent an operator from pressing the E-stop through the remote port.
A client that never pauses could occupy the whole process. Therefore only one client is read per
turn of the event loop, and each client has a budget of processor time. The motion port has no
budget, because its STOP must not be delayed. A full remote port evicts a client to admit a new
one. It also reserves a file descriptor, with which it admits a client when the process has no
other descriptor left.
"""

import asyncio
import errno
import logging
import os
import socket
import time
from collections import deque
from contextlib import suppress
from typing import NamedTuple

from epson_driver.profiles.profile import ServerProfile
from epson_driver.sim_controller.client_connections import (
    GRACE_S,
    MAX_NEWCOMERS,
    MAX_REMOTE_CLIENTS,
)
from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.sim_controller.network.tcp_connection import TcpConnection
from epson_driver.simple_message import FrameError
from epson_driver.socket_errors import reason

HALF_CLOSED_S = 2.0
"""Time for which a client that has shut down its sending side still receives data, s."""

HANDOVER_S = 0.1
"""Time for which a new client waits at a full port, s.

A previous connection may still be closing.
"""

MAX_WAITING_CLIENTS = 4
"""Maximum number of clients waiting at a full port. Further clients are refused immediately."""

BACKLOG = 64  # connections queued by the kernel. One is accepted per turn of the loop
ACCEPT_RETRY_S = 0.05

_EXHAUSTED = (errno.EMFILE, errno.ENFILE)  # no file descriptor is left
_GONE = (errno.EAGAIN, errno.EINTR, errno.ECONNABORTED)  # no connection is pending
_log = logging.getLogger(__name__)

MAX_SAVED_S = 0.1  # maximum processor time saved by an idle client, s

INITIAL_S = 0.002  # short, so that reconnecting has no advantage


class CpuBudget:
    """The processor time that a client may use.

    It grows with the elapsed time, up to MAX_SAVED_S.
    """

    def __init__(self, now: float) -> None:
        self._saved = INITIAL_S
        self._time = now

    def used(self, seconds: float, cpu_fraction: float, now: float) -> float:
        """Record `seconds` of used processor time. Return how long the client must wait, s."""
        self._saved = min(self._saved + (now - self._time) * cpu_fraction, MAX_SAVED_S) - seconds
        self._time = now
        return max(-self._saved / cpu_fraction, 0.0)


class SpareDescriptor:
    """A file descriptor in reserve, for use when no other descriptor is available."""

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def reserve(self) -> None:
        if self._descriptor is None:
            try:
                self._descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
            except OSError:  # tried again when a client disconnects, which frees a descriptor
                return

    def release(self) -> bool:
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)
        return descriptor is not None


class PortRules(NamedTuple):
    """The rules of one port.

    * max_clients: maximum number of clients (None: a full port evicts a client to admit another).
      Further clients wait HANDOVER_S, at most MAX_WAITING_CLIENTS at a time, and are then refused.
    * max_unsent: number of unsent bytes beyond which a client is disconnected.
    * send_buffer: size of the socket's own send buffer, bytes (None: the default).
    * half_closed: whether a client that has shut down its sending side still receives data for
      HALF_CLOSED_S.
    * chunk: maximum number of bytes per read.
    * cpu_fraction: fraction of the processor time that all clients together may use in the long
      run (None: unlimited).
    * replace: whether a new client replaces the oldest one on a full port.
    """

    name: str
    max_clients: int | None
    max_unsent: int = 65_536
    send_buffer: int | None = None
    half_closed: bool = False
    chunk: int = 1024
    cpu_fraction: float | None = 0.2
    replace: bool = False


def port_rules(server: ServerProfile) -> tuple[PortRules, ...]:
    replace = server.full == 'replace'
    return (
        PortRules('motion', 1, chunk=4096, cpu_fraction=None, replace=replace),  # for its STOP
        # The buffers store the messages of a scheduling delay of this process, plus several
        # seconds for a client that does not read. A real controller would wait for it.
        PortRules(
            'state', server.state_clients, 65_536, 16_384, half_closed=True, replace=replace
        ),
        PortRules('io', server.io_clients, 16_384),
        PortRules('remote', None, 16_384, chunk=128),  # a command may have two characters
    )


class PortServer:
    """Accepts clients of one port and serves each in a separate task.

    A refused client does not affect the others. All ports share the lock `turn`, so only one
    client is read per turn of the event loop. This bounds the input between two steps of the
    controller, even if many clients send continuously.
    """

    def __init__(self, rules: PortRules, pacer: Pacer, turn: asyncio.Lock) -> None:
        self._rules = rules
        self._pacer = pacer
        self._turn = turn
        self._sock: socket.socket | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        clients = rules.max_clients
        self._admitted: deque[float] = deque([-GRACE_S] * MAX_NEWCOMERS, MAX_NEWCOMERS)  # times, s
        self._spare = SpareDescriptor()  # only without `max_clients`
        self._places = None if clients is None else asyncio.Semaphore(clients)

    @property
    def name(self) -> str:
        return self._rules.name

    @property
    def clients(self) -> int:
        return len(self._tasks)

    def open(self, host: str, port: int) -> int:
        """Listen on a port (0: any free port) and return its number. Raises OSError on failure."""
        try:
            family = socket.AF_INET6 if ':' in host else socket.AF_INET
            sock = socket.create_server((host, port), family=family, backlog=BACKLOG)
        except (OSError, OverflowError) as error:
            raise OSError(f'{self._rules.name} port {host}:{port}: {reason(error)}') from error
        if self._rules.send_buffer is not None:  # accepted sockets inherit it
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._rules.send_buffer)
        sock.setblocking(False)
        self._sock = sock
        if self._rules.max_clients is None:
            self._spare.reserve()
        self._listen()
        bound: int = sock.getsockname()[1]
        return bound

    async def close(self) -> None:
        if self._retry is not None:
            self._retry.cancel()
        if self._sock is not None:
            asyncio.get_running_loop().remove_reader(self._sock)
            self._sock.close()
            self._sock = None
        self._spare.release()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _listen(self) -> None:
        if self._sock is not None:
            asyncio.get_running_loop().add_reader(self._sock, self._accept, self._sock)

    def _accept(self, listening: socket.socket) -> None:
        """Accept one connection. Further connections remain queued in the operating system."""
        limit = self._rules.max_clients
        if limit is None and len(self._tasks) >= MAX_REMOTE_CLIENTS:
            wait = self._admitted[0] + GRACE_S - asyncio.get_running_loop().time()
            if wait > 0.0:  # too many clients are new, and none of them may be evicted yet
                self._pause(listening, wait)
                return
        try:
            try:
                sock, address = listening.accept()
            except OSError as error:
                if error.errno not in _EXHAUSTED or not self._spare.release():
                    raise
                sock, address = listening.accept()
        except OSError as error:
            if error.errno not in _GONE:
                self._report_failure(listening, error.strerror or str(error))
            return
        self._admitted.append(asyncio.get_running_loop().time())
        if limit is not None and len(self._tasks) >= limit + MAX_WAITING_CLIENTS:
            sock.close()
            _log.warning(
                '%s client %s:%d refused: too many pending connections',
                self._rules.name,
                *address[:2],
            )
            return
        task = asyncio.create_task(self._admit(sock))
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._pacer.on_task_done(task)
        if self._rules.max_clients is None and self._sock is not None:
            self._spare.reserve()

    def _report_failure(self, listening: socket.socket, why: str) -> None:
        _log.error('%s port: cannot accept connections: %s', self._rules.name, why)
        self._pause(listening, ACCEPT_RETRY_S)
        if self._rules.max_clients is None:
            with self._pacer.present() as controller:
                controller.clients.dismiss_remote(why)

    def _pause(self, listening: socket.socket, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(listening)
        self._retry = loop.call_later(seconds, self._listen)

    async def _admit(self, sock: socket.socket) -> None:
        rules = self._rules
        reader, writer = await asyncio.open_connection(sock=sock, limit=rules.chunk)
        try:
            connection = TcpConnection(rules.name, reader, writer, rules.max_unsent, rules.chunk)
        except (OSError, TypeError):  # the client has already disconnected
            writer.transport.abort()
            return
        await self._admit_to_port(connection)

    async def _admit_to_port(self, connection: TcpConnection) -> None:
        try:
            if self._places is not None:
                if self._places.locked() and self._rules.replace:
                    with self._pacer.present() as controller:
                        controller.clients.make_room(self._rules.name)
                async with asyncio.timeout(HANDOVER_S):
                    await self._places.acquire()
            try:
                _log.info('%s connected', connection.name)
                await self._serve(connection)
                _log.info('%s disconnected', connection.name)
            finally:
                if self._places is not None:
                    self._places.release()
        except TimeoutError:
            _log.warning('%s refused: too many connections', connection.name)
        except ConnectionRefusedError as error:
            _log.warning('%s refused: %s', connection.name, error)
            connection.abort()
        except FrameError as error:
            _log.warning('%s disconnected: %s', connection.name, error)
        finally:
            connection.close()

    async def _serve(self, connection: TcpConnection) -> None:
        with self._pacer.present() as controller:
            session = controller.connect(self._rules.name, connection)
        budget = CpuBudget(asyncio.get_running_loop().time())
        try:
            while data := await connection.receive():
                async with self._turn:
                    await asyncio.sleep(0)  # one turn of the loop
                    with self._pacer.present():
                        start = time.thread_time()
                        session.receive(data)
                        used = time.thread_time() - start
                await self._throttle(budget, used)
            if self._rules.half_closed:
                with suppress(TimeoutError):
                    async with asyncio.timeout(HALF_CLOSED_S):
                        await connection.lost()
        finally:
            with self._pacer.present():
                session.closed()

    async def _throttle(self, budget: CpuBudget, used: float) -> None:
        if self._rules.cpu_fraction is not None:
            fraction = self._rules.cpu_fraction / len(self._tasks)
            wait = budget.used(used, fraction, asyncio.get_running_loop().time())
            if wait:
                await asyncio.sleep(wait)
