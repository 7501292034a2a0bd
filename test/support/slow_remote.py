# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A Remote Ethernet port that takes its time to switch a simulated controller's motors."""

import asyncio

from epson_driver.sim_controller.condition.states import Event, RejectedError
from support.remote_peer import RemotePeer

EVENTS = {
    '$SetMotorsOn,1': Event.MOTORS_ON,
    '$SetMotorsOff,1': Event.MOTORS_OFF,
    '$Reset': Event.RESET,
}


class SlowRemote(RemotePeer):
    """Obeys `delay` s after it was told, whatever becomes of who told it; answers then.

    `obeyed` are the commands so far. `told` is set with the first one that comes.
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
