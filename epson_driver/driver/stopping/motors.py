# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Switching the controller's motors and resetting its errors.

The profile selects the method (`program.motors`, docs/controllers.md):

* remote_ethernet: EPSON's Remote Ethernet commands, if a `remote_port` is configured;
* restart: the same commands, for a controller that runs a program. It accepts the commands only
  while its program is stopped, so the program is stopped before them, and restarted when the
  motors are on;
* motoman: Motoman's commands on the motion port;
* rtmc: requests of Real-time Motion Control;
* none: an operator switches the motors.
"""

import asyncio
import logging
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Literal, Protocol

from epson_driver.driver.delivery.reply_rejection import RESULTS, reply_rejection
from epson_driver.link import Link
from epson_driver.link.rtmc_link import RtmcLink
from epson_driver.remote_ethernet.answers import ask_control_device, ask_flags
from epson_driver.remote_ethernet.client import Ask, Login, RemoteError, RemoteTurns, logged_in
from epson_driver.rtmc.session import RefusedError
from epson_driver.simple_message import MotionCtrl, Packet
from epson_driver.simple_message.motoman import Command, Result

_log = logging.getLogger(__name__)

MotorsKind = Literal['none', 'remote_ethernet', 'restart', 'motoman', 'rtmc']

READY_PERIOD_S = 0.05  # period for polling whether a controller is Ready, s
READY_FRACTION = 0.75  # fraction of an action's timeout for becoming Ready


@dataclass(frozen=True, slots=True)
class Commands:
    remote_ethernet: str
    motoman: Command
    by_hand: str


class Action(Enum):
    MOTORS_ON = Commands(
        'SetMotorsOn,1', Command.START_SERVOS, 'switch the motors on at the controller'
    )
    MOTORS_OFF = Commands(
        'SetMotorsOff,1', Command.STOP_SERVOS, 'switch the motors off at the controller'
    )
    RESET = Commands('Reset', Command.RESET_ALARM, 'reset the error at the controller')


MOTOMAN_CHECKS = (
    'the controller reports no cause: check whether a safeguard door is open, an E-stop is '
    'pressed, or the pendant shows an alarm, or is not in REMOTE mode'
)
"""Text for the operator if the servos of a Motoman cannot be switched on."""

ControllerStatus = tuple[tuple[str, ...], int, int | None]  # flags, error, control device


class MotorsError(RuntimeError):
    """Raised if an action fails. `unanswered`: the controller may still execute the command."""

    def __init__(
        self, text: str, *, unanswered: bool = False, status: ControllerStatus | None = None
    ) -> None:
        super().__init__(text)
        self.unanswered = unanswered
        self.status = status


class Motors(Protocol):
    """Interface for switching the motors.

    * `missing`: why the driver cannot switch the motors, or ''.
    * `restarts`: whether the controller's program is restarted when the motors are switched on.
    """

    missing: str
    restarts: bool

    async def act(self, action: Action, timeout: float) -> None:
        """Execute the action within `timeout` s. Raises MotorsError if it fails."""

    async def status(self, timeout: float) -> ControllerStatus | None:
        """Return the controller's status, or None if it is not available within `timeout` s."""


class MotorsByHand:
    restarts = False

    def __init__(self, missing: str) -> None:
        self.missing = missing

    async def act(self, action: Action, timeout: float) -> None:
        raise MotorsError(f'{self.missing}, so {action.value.by_hand}')

    async def status(self, timeout: float) -> ControllerStatus | None:
        """Return None, because the status is not queried."""


class RtmcMotors:
    """Switches the motors by Real-time Motion Control. Motors on also sets high power."""

    missing = ''
    restarts = False

    def __init__(self, link: RtmcLink) -> None:
        self._link = link

    async def act(self, action: Action, timeout: float) -> None:
        try:
            async with asyncio.timeout(timeout):
                if action is Action.RESET:
                    await self._link.reset()
                else:
                    await self._link.switch_motors(action is Action.MOTORS_ON)
        except (RefusedError, OSError, TimeoutError) as error:
            raise MotorsError(
                str(error) or f'no reply: {action.value.by_hand}',
                unanswered=isinstance(error, TimeoutError),
            ) from error

    async def status(self, timeout: float) -> ControllerStatus | None:
        """Return None, because the status is not queried."""


class RemoteEthernetMotors:
    """Switches the motors over EPSON's Remote Ethernet. This has priority over other requests."""

    missing = ''
    restarts = False

    def __init__(
        self,
        host: str,
        port: int,
        turns: RemoteTurns | None = None,
        login: Login | None = None,
    ) -> None:
        self._address = f'{host}:{port}'
        self._login = login or partial(logged_in, host, port)
        self._turns = turns or RemoteTurns()

    async def act(self, action: Action, timeout: float) -> None:
        failed: Exception | None = None
        status: ControllerStatus | None = None
        try:
            async with self._turns.urgent(), self._login(timeout) as ask:
                try:
                    await self._execute(ask, action, timeout)
                except RemoteError as error:
                    failed = error
                    status = await self._query(ask)
        except (RemoteError, OSError, TimeoutError) as error:
            failed = failed or error
        if failed is not None:
            raise MotorsError(
                f'remote port {self._address}: {str(failed) or "no answer"}: '
                f'{action.value.by_hand}',
                unanswered=isinstance(failed, TimeoutError),
                status=status,
            ) from failed

    async def status(self, timeout: float) -> ControllerStatus | None:
        async def query() -> ControllerStatus:
            async with self._login(timeout) as ask:
                return await self._query(ask)

        try:
            async with asyncio.timeout(timeout):
                return await self._turns.patient(query)
        except (RemoteError, OSError, TimeoutError):
            return None

    async def _query(self, ask: Ask) -> ControllerStatus:
        return (*await ask_flags(ask), await ask_control_device(ask))

    async def _execute(self, ask: Ask, action: Action, _timeout: float) -> None:
        await ask(action.value.remote_ethernet)


class RestartingMotors(RemoteEthernetMotors):
    """Switches the motors over Remote Ethernet, for a controller that runs a program.

    The controller accepts most commands only while it is Ready, that is, while no program runs.
    The program is therefore stopped before each command, and restarted after the motors are on.
    The Stop command also brings a moving arm to rest.
    """

    restarts = True

    async def _execute(self, ask: Ask, action: Action, timeout: float) -> None:
        await ask('Stop')
        try:
            async with asyncio.timeout(timeout * READY_FRACTION):
                while 'Ready' not in (await ask_flags(ask))[0]:  # noqa: ASYNC110 - it sends no events
                    await asyncio.sleep(READY_PERIOD_S)
        except TimeoutError as error:
            text = 'not Ready: the arm is still moving, or a task runs that Stop does not end'
            raise ConnectionError(text) from error
        await ask(action.value.remote_ethernet)
        if action is Action.MOTORS_ON:
            await ask('Start,0')


class MotomanMotors:
    missing = ''
    restarts = False

    def __init__(self, link: Link) -> None:
        self._link = link

    async def act(self, action: Action, timeout: float) -> None:
        commands = action.value
        answer: asyncio.Future[Packet] = asyncio.get_running_loop().create_future()

        def on_reply(packet: Packet, _now: float) -> None:
            if not answer.done():
                answer.set_result(packet)

        why: str | None
        unanswered = False
        try:
            waiting = self._link.post(MotionCtrl(0, 0, commands.motoman), on_reply)
            try:
                async with asyncio.timeout(timeout):
                    why = reply_rejection(await answer)
            except TimeoutError:
                self._link.give_up(waiting)
                unanswered = True
                why = f'no reply within {timeout:g} s'
        except ConnectionError as error:
            why = str(error)
        if why is not None:
            unexplained = why == RESULTS[Result.FAILURE] and action is Action.MOTORS_ON
            remedy = MOTOMAN_CHECKS if unexplained else commands.by_hand
            raise MotorsError(f'{commands.motoman.name}: {why}: {remedy}', unanswered=unanswered)

    async def status(self, timeout: float) -> ControllerStatus | None:
        """Return None, because the status is not queried."""


class SerializedMotors:
    """Executes the commands to another `Motors` object one after the other.

    Therefore the last command determines the final state. If a caller is cancelled, its command is
    dropped while it is queued, but not after it has been sent.
    """

    def __init__(self, motors: Motors) -> None:
        self.missing = motors.missing
        self.restarts = motors.restarts
        self.may_come_on = False  # a command to switch them on had no reply
        self._motors = motors
        self._lock = asyncio.Lock()
        self._active: asyncio.Task[None] | None = None
        self._tasks: dict[asyncio.Task[None], None] = {}

    @property
    def busy(self) -> bool:
        return bool(self._tasks)

    async def act(self, action: Action, timeout: float) -> None:
        """Execute an action after all earlier actions. The `timeout`, s, excludes this wait."""
        task = asyncio.create_task(self._act(action, timeout))
        self._tasks[task] = None
        task.add_done_callback(self._done)
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError:
            caller = asyncio.current_task()
            if task.cancelled() and caller is not None and not caller.cancelling():
                raise MotorsError('the driver has ended', unanswered=True) from None
            if task is not self._active:
                task.cancel()
            raise

    async def status(self, timeout: float) -> ControllerStatus | None:
        return await self._motors.status(timeout)

    async def close(self) -> None:
        """Cancel the running and queued commands. Their callers receive MotorsError."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.pop(task, None)
        if task is self._active:
            self._active = None  # its exception refers to the caller's frames
        if not task.cancelled() and (error := task.exception()) is not None:
            _log.debug('%s', error)  # also raised to a caller that still waits

    async def _act(self, action: Action, timeout: float) -> None:
        async with self._lock:
            self._active = asyncio.current_task()
            on = action is Action.MOTORS_ON
            try:
                await self._motors.act(action, timeout)
            except MotorsError as error:
                self.may_come_on |= on and error.unanswered
                raise
            if on:
                self.may_come_on = False
