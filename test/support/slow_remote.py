# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A Remote Ethernet port that takes its time to switch a simulated controller's motors."""

import asyncio
import contextlib

from epson_driver.sim_controller.condition.states import Event, RejectedError

EVENTS = {
    '$SetMotorsOn,1': Event.MOTORS_ON,
    '$SetMotorsOff,1': Event.MOTORS_OFF,
    '$Reset': Event.RESET,
}


class SlowRemote:
    """Obeys `delay` s after it was told, whatever becomes of who told it; answers then.

    `obeyed` are the commands so far. `given` is set with the first one that comes.
    """

    def __init__(self, controller, delay):
        self.delay = delay
        self.obeyed = []
        self.given = asyncio.Event()
        self._controller = controller
        self._tasks = set()

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._serve, '127.0.0.1', 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_):
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _serve(self, reader, writer):
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        with contextlib.suppress(ConnectionError, asyncio.CancelledError):
            while line := (await reader.readline()).decode().strip():
                answer = await self._obey(line)
                if not writer.is_closing():
                    writer.write(f'{answer}\r\n'.encode())
        writer.close()

    async def _obey(self, line):
        name = line[1:].partition(',')[0]
        if line in EVENTS:
            self.given.set()
            await asyncio.sleep(self.delay)
            self.obeyed.append(name)
            try:
                self._controller.apply(EVENTS[line])
            except RejectedError:
                return f'!{name},20'
        return f'#{name},0'
