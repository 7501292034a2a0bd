# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Real-time Motion Control on the network. A thread of its library receives DDS messages."""

import logging

from epson_driver.rtmc.transport import Arrival, Transport
from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.sim_controller.rtmc.rtmc_port import RtmcPort

_log = logging.getLogger(__name__)


class RtmcServer:
    """Serves Real-time Motion Control. `open` and `close` run in the event loop."""

    def __init__(self, pacer: Pacer, address: str, port: int) -> None:
        """Listen on `port`. Raises TransportError if this is not possible."""
        self._pacer = pacer
        self._transport = Transport(address, port)
        _log.info('real-time motion: UDP port %d of %s', port, address)
        with pacer.present() as controller:
            self._port = RtmcPort(controller, self._transport.write)
        self._transport.listen(self._receive, pacer.fail)

    def _receive(self, arrival: Arrival) -> None:
        with self._pacer.present():
            self._port.receive(arrival.sender, arrival.data)

    async def close(self) -> None:
        await self._transport.aclose()
