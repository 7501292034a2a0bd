# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The remote port: lines of Remote Ethernet commands."""

from epson_driver.controller.connection import Connection
from epson_driver.controller.pacer import Pacer
from epson_driver.controller.port_server import PortServer
from epson_driver.controller.remote_commands import RemoteSession
from epson_driver.remote_errors import RemoteErrorNumber


class RemoteServer(PortServer):
    """Serves several remote clients, each with a login of its own."""

    name = 'remote'
    line_limit = 256

    def __init__(self, pacer: Pacer) -> None:
        super().__init__()
        self._pacer = pacer

    async def serve(self, connection: Connection) -> None:
        """Answer line by line until the client is gone or sends a line without end."""
        session = RemoteSession()
        while True:
            try:
                line = await connection.receive_line()
            except ValueError:
                connection.send(b'!,%d\r\n' % RemoteErrorNumber.FORMAT)
                return
            if not line.endswith(b'\n'):
                return
            text = line.decode('ascii', errors='replace').rstrip('\r\n')
            with self._pacer.present() as controller:
                answer = session.answer(text, controller)
            connection.send(answer.encode('ascii', errors='replace') + b'\r\n')
