# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Client of a simulated controller's remote port.

An arm may be moved without `--allow-motion` only if its controller is simulated. The proof is the
controller's own answer to `$Sim`. The proof is valid only as long as answers arrive. A real
controller serves only one remote client, which should be the driver. The panel therefore connects
only to ports of this machine that are announced as simulated. `$Sim` needs no login, so the driver
can be the only client that is logged in.
"""

import asyncio
import socket
import threading
from collections.abc import Awaitable, Callable
from typing import Any

from epson_driver.panel.access import is_loopback
from epson_driver.panel.robot_state import RequestError, Simulation
from epson_driver.remote_ethernet.client import (
    Ask,
    HungUpError,
    RemoteError,
    RemoteErrorNumber,
    connected,
    logged_in,
)
from epson_driver.remote_ethernet.hand import Action, RefusedError, do
from epson_driver.sim_controller.network.announcement import is_announced

POLL_PERIOD_S = 0.4  # interval between queries of the controller's condition, s
ANSWER_TIMEOUT_S = 3.0  # timeout of an answer, s
SESSION_S = 3000.0  # duration of a connection, s. The panel then connects again
RETRY_PERIOD_S = 1.0  # delay before the next attempt to connect, s

ONE_CLIENT = 'this action needs a Remote Ethernet login, and the driver has the only one'


def needs_login(action: Action) -> bool:
    return not action.commands[0].startswith('Sim,')


Say = Callable[[str, bool], object]  # outcome of a command: a text, and whether it was carried out


class NotSimulatedError(RequestError):
    """A request needs a simulated controller, and none is connected."""


class SimPendant:
    """The pendant of one controller, created by `PendantThread.pendant`. Thread-safe."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, host: str, port: int, clock: Callable[[], float]
    ) -> None:
        self.host, self.port = host, port
        self.real = False  # whether the controller has answered that it is not simulated
        self.latest: tuple[Simulation, float] | None = None  # report, and its arrival, s
        self.joints_wanted = False  # whether the controller reports no joints to the driver
        self._loop = loop
        self._clock = clock
        self._commands: asyncio.Queue[tuple[Action, Say]] = asyncio.Queue()
        self._task: asyncio.Task[None] | None = None
        loop.call_soon_threadsafe(self._start)

    def press(self, command: Action, say: Say) -> None:
        """Send an action to the controller. `say` is called in another thread."""
        if self.latest is None:
            raise NotSimulatedError('no reply from a simulated controller')
        self._loop.call_soon_threadsafe(self._commands.put_nowait, (command, say))

    def end(self) -> None:
        self._loop.call_soon_threadsafe(lambda: self._task and self._task.cancel())

    def _start(self) -> None:
        self._task = self._loop.create_task(self._run())
        self._task.add_done_callback(_report)

    async def _run(self) -> None:
        while not self.real:
            try:
                if await self._is_announced():
                    async with connected(self.host, self.port, SESSION_S, tries=1) as ask:
                        await self._serve(ask)
            except RemoteError as error:
                self.real = error.number == RemoteErrorNumber.BAD_COMMAND
            except (OSError, ValueError):
                pass  # it is gone or too slow: `latest` is None, which the panel shows
            self.latest = None
            self._refuse_waiting()
            await asyncio.sleep(RETRY_PERIOD_S)
            self._refuse_waiting()  # commands queued just before `latest` was cleared

    async def _is_announced(self) -> bool:
        family = socket.AF_INET6 if ':' in self.host else socket.AF_INET
        found = await self._loop.getaddrinfo(self.host, self.port, family=family)
        return is_announced(str(found[0][4][0]), self.port)

    async def _serve(self, ask: Ask) -> None:
        while True:
            await self._poll(ask)
            try:
                async with asyncio.timeout(POLL_PERIOD_S / (4 if self.joints_wanted else 1)):
                    command, say = await self._commands.get()
            except TimeoutError:
                continue
            try:
                await self._do(ask, command)
            except (RefusedError, RemoteError, ValueError) as error:  # ValueError: not sent
                say(str(error), False)
            except BaseException:
                say(f'{command.commands[0]}: no reply from the controller', False)
                raise
            else:
                say('', True)

    async def _do(self, ask: Ask, command: Action) -> None:
        if not needs_login(command):
            await _in_time(do(ask, command))
            return
        place = (self.host, self.port)
        try:
            async with logged_in(*place, ANSWER_TIMEOUT_S, max_logins=1) as own:
                await do(own, command)
        except HungUpError as error:
            raise RefusedError(ONE_CLIENT) from error

    async def _poll(self, ask: Ask) -> None:
        parts = (await _in_time(ask('Sim,condition'))).split(';')
        faults = (await _in_time(ask('Sim,fault,list'))).split(';')
        condition = dict(part.split('=', 1) for part in parts)
        joints = ''
        if self.joints_wanted and await _in_time(ask('Sim,tasks')):
            joints = await _in_time(ask('Sim,joints'))
        places = tuple(map(float, joints.split()))
        self.latest = Simulation(condition, tuple(filter(None, faults)), places), self._clock()

    def _refuse_waiting(self) -> None:
        while not self._commands.empty():
            command, say = self._commands.get_nowait()
            say(f'{command.commands[0]}: no reply from a simulated controller', False)


class PendantThread:
    """One thread with an event loop for all pendants. `on_error` is called after a failure."""

    def __init__(
        self, clock: Callable[[], float], on_error: Callable[[str, BaseException], None]
    ) -> None:
        self._clock = clock
        self._on_error = on_error
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(self._on_loop_error)
        self._thread = threading.Thread(target=self._run, name='pendants', daemon=True)
        self._thread.start()

    def pendant(self, host: str, port: int) -> SimPendant | None:
        """Return the pendant of a controller.

        Return None if its port is 0, or if it is on another machine.
        """
        if not port or not is_loopback(host):
            return None
        return SimPendant(self._loop, host, port, self._clock)

    def end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(1.0)
        if not self._thread.is_alive():
            self._loop.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        except BaseException as error:  # noqa: BLE001 - reported by `on_error`
            self._on_error('the thread of the pendants ended', error)

    def _on_loop_error(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self._on_error(
            'a pendant failed', context.get('exception') or RuntimeError(context['message'])
        )


def _report(task: 'asyncio.Task[None]') -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        task.get_loop().call_exception_handler({'message': 'a pendant failed', 'exception': error})


async def _in_time(answer: Awaitable[str]) -> str:
    async with asyncio.timeout(ANSWER_TIMEOUT_S):  # `wait_for` may swallow a cancellation
        return await answer
