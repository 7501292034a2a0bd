# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How the driver switches the controller's motors and resets its errors, where it can.

The profile says it (`program.motors`, docs/controllers.md):

* remote_ethernet: EPSON's commands, if there is a `remote_port`;
* motoman: Motoman's commands, on the motion port;
* none: a person does it.
"""

import asyncio
from dataclasses import dataclass
from enum import Enum
from typing import Literal, Protocol

from epson_driver.client.refusal import refusal
from epson_driver.link import Link
from epson_driver.link.remote_ethernet import RemoteError, execute
from epson_driver.simple_message import MotionCtrl, Packet
from epson_driver.simple_message.motoman import Command

MotorsKind = Literal['none', 'remote_ethernet', 'motoman']


@dataclass(frozen=True, slots=True)
class Commands:
    """What an action is called: in Remote Ethernet, by Motoman, and for a person."""

    remote_ethernet: str
    motoman: Command
    by_hand: str


class Action(Enum):
    """What is done to the controller, with its commands."""

    MOTORS_ON = Commands(
        'SetMotorsOn,1', Command.START_SERVOS, 'switch the motors on at the controller'
    )
    MOTORS_OFF = Commands(
        'SetMotorsOff,1', Command.STOP_SERVOS, 'switch the motors off at the controller'
    )
    RESET = Commands('Reset', Command.RESET_ALARM, 'reset the error at the controller')


class MotorsError(RuntimeError):
    """It could not be done; the text says why, and what a person can do."""


class Motors(Protocol):
    """A way to the motors. `missing`: why there is none; '' if there is one."""

    missing: str

    async def act(self, action: Action, timeout: float) -> None:
        """Do it within `timeout` s. Raises MotorsError."""


class ByHand:
    """The driver has no way."""

    def __init__(self, missing: str) -> None:
        self.missing = missing

    async def act(self, action: Action, timeout: float) -> None:
        """Raise MotorsError."""
        raise MotorsError(f'{self.missing}, the driver cannot do it: {action.value.by_hand}')


class RemoteEthernet:
    """EPSON's remote port."""

    missing = ''

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port

    async def act(self, action: Action, timeout: float) -> None:
        """Log in and give the command. Raises MotorsError."""
        commands = action.value
        try:
            await execute(self._host, self._port, [commands.remote_ethernet], timeout)
        except (RemoteError, OSError, TimeoutError) as error:
            why = str(error) or 'no answer'
            raise MotorsError(
                f'remote port {self._host}:{self._port}: {why}: {commands.by_hand}'
            ) from error


class MotomanCommands:
    """MOTION_CTRL requests on the motion link."""

    missing = ''

    def __init__(self, link: Link) -> None:
        self._link = link

    async def act(self, action: Action, timeout: float) -> None:
        """Send the command and wait for its MOTION_REPLY. Raises MotorsError."""
        commands = action.value
        answer: asyncio.Future[Packet] = asyncio.get_running_loop().create_future()

        def on_reply(packet: Packet, _now: float) -> None:
            if not answer.done():
                answer.set_result(packet)

        why: str | None
        try:
            waiting = self._link.post(MotionCtrl(0, 0, commands.motoman), on_reply)
            try:
                async with asyncio.timeout(timeout):
                    why = refusal(await answer)
            except TimeoutError:
                self._link.give_up(waiting)
                why = f'no reply within {timeout:g} s'
        except ConnectionError as error:
            why = str(error)
        if why is not None:
            raise MotorsError(f'{commands.motoman.name}: {why}: {commands.by_hand}')


def motors(kind: MotorsKind, host: str, remote_port: int, motion_link: Link) -> Motors:
    """Return the way that a controller's profile and the parameter `remote_port` leave."""
    if kind == 'motoman':
        return MotomanCommands(motion_link)
    if kind == 'none':
        return ByHand('the controller takes no such command')
    if not remote_port:
        return ByHand('remote_port is 0')
    return RemoteEthernet(host, remote_port)
