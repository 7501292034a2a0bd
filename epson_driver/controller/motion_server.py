# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion port: the bytes of one client at a time to the controller, its replies back."""

from epson_driver.controller.connection import Connection
from epson_driver.controller.pacer import Pacer
from epson_driver.controller.port_server import PortServer


class MotionServer(PortServer):
    """Serves one motion client; when it is gone, however that came, the controller is told."""

    name = 'motion'
    max_clients = 1

    def __init__(self, pacer: Pacer) -> None:
        super().__init__()
        self._pacer = pacer

    async def serve(self, connection: Connection) -> None:
        """Pass bytes on until the client is gone or its stream cannot be read."""
        with self._pacer.present() as controller:
            controller.connected(connection.send)
        try:
            while data := await connection.receive():
                with self._pacer.present() as controller:
                    controller.receive(data)
        finally:
            with self._pacer.present() as controller:
                controller.disconnected()
