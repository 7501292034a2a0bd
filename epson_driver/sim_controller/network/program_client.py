# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A SPEL+ program as a client (OpenNet … As Client): whoever listens on this machine is its peer.

The address that the program names is that of a cell; here its peer is looked for on 127.0.0.1, at
the same port or the one that --program-port says, until the program closes the port.
"""

import asyncio
import logging
from contextlib import suppress

from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.sim_controller.network.tcp_connection import TcpConnection
from epson_driver.sim_controller.ports.session import ClientSession

HOST = '127.0.0.1'
RETRY_S = 0.2
"""Pause before another attempt to reach the peer, s."""

MAX_UNSENT = 65_536

_log = logging.getLogger(__name__)


async def connect(session: ClientSession, port: int, pacer: Pacer) -> None:
    """Connect a program's port, and hand it what the peer sends, until one of them closes."""
    writer = None
    while writer is None and session.wanted:
        try:
            reader, writer = await asyncio.open_connection(HOST, port)
        except OSError:
            await asyncio.sleep(RETRY_S)
    if writer is None:
        return
    link = TcpConnection(session.name, reader, writer, MAX_UNSENT)
    try:
        with pacer.present():
            if session.wanted:
                session.begin(link.send, link.close)
        _log.info('port %s of the program is connected to %s:%d', session.name, HOST, port)
        while session.wanted and (data := await link.receive()):
            with pacer.present():
                session.receive(data)
    finally:
        link.close()
        with pacer.present():
            session.closed()
        with suppress(OSError):
            await link.lost()
