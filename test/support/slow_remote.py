# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A slow Remote Ethernet port of a simulated controller."""

import asyncio

from epson_driver.sim_controller.condition.states import Event, RejectedError
from support.remote_peer import RemotePeer

EVENTS = {
    '$SetMotorsOn,1': Event.MOTORS_ON,
    '$SetMotorsOff,1': Event.MOTORS_OFF,
    '$Reset': Event.RESET,
}


class SlowRemote(RemotePeer):
    """Executes each command after `delay` s, even if its client has disconnected, and answers.

    `obeyed` contains the executed commands. `told` is set by the first command.
    """

    def __init__(self, controller, delay):
        super().__init__(delay)
        self.obeyed = []
        self.told = asyncio.Event()
        self._controller = controller

    async def answer(self, line):
        name = line[1:].partition(',')[0]
        if line in EVENTS:
            self.told.set()
            await asyncio.sleep(self.delay)
            self.obeyed.append(name)
            try:
                self._controller.apply(EVENTS[line])
            except RejectedError:
                return f'!{name},20'
        return f'#{name},0'
