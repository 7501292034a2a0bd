# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Switching the controller's motors and resetting its errors.

The profile selects the method (`program.motors`, docs/controllers.md):

* remote_ethernet: EPSON's Remote Ethernet commands, if a `remote_port` is configured;
* restart: the same commands, but the controller's program is stopped before them and restarted
  after the motors are on. Controllers that run a program accept the commands only while it is
  stopped;
* motoman: Motoman's commands on the motion port;
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
from epson_driver.remote_ethernet.answers import ask_control_device, ask_flags
from epson_driver.remote_ethernet.client import Ask, Login, RemoteError, RemoteTurns, logged_in
from epson_driver.simple_message import MotionCtrl, Packet
from epson_driver.simple_message.motoman import Command, Result

_log = logging.getLogger(__name__)

MotorsKind = Literal['none', 'remote_ethernet', 'restart', 'motoman']

READY_PERIOD_S = 0.05
"""Period for polling whether a controller is Ready, s."""

READY_FRACTION = 0.75
"""Fraction of an action's timeout within which the controller must become Ready."""


@dataclass(frozen=True, slots=True)
class Commands:
    """The commands of an action, by protocol, and the instruction for an operator."""

    remote_ethernet: str
    motoman: Command
    by_hand: str


class Action(Enum):
    """An action on the controller. Its value contains the commands."""

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
"""Instruction for the operator if the servos of a Motoman cannot be switched on."""

ControllerStatus = tuple[tuple[str, ...], int, int | None]
"""Flags, error number and control device, as reported over Remote Ethernet."""


class MotorsError(RuntimeError):
    """Raised if an action fails. The text contains the reason and a remedy for the operator.

    `unanswered`: the controller may still execute the command. `status`: status of a controller
    that refused the command, or None.
    """

    def __init__(
        self, text: str, *, unanswered: bool = False, status: ControllerStatus | None = None
    ) -> None:
        super().__init__(text)
        self.unanswered = unanswered
        self.status = status


class Motors(Protocol):
    """Interface for switching the motors.

    `missing`: why the driver cannot switch the motors, or ''. `restarts`: switching the motors on
    also restarts the controller's program.
    """

    missing: str
    restarts: bool

    async def act(self, action: Action, timeout: float) -> None:
        """Execute the action within `timeout` s. Raises MotorsError if it fails."""

    async def status(self, timeout: float) -> ControllerStatus | None:
        """Return the controller's status, or None if it is not available within `timeout` s."""


class MotorsByHand:
    """Motors that only an operator can switch. All actions fail."""

    restarts = False

    def __init__(self, missing: str) -> None:
        self.missing = missing

    async def act(self, action: Action, timeout: float) -> None:
        """Raise MotorsError."""
        raise MotorsError(f'{self.missing}, the driver cannot do it: {action.value.by_hand}')

    async def status(self, timeout: float) -> ControllerStatus | None:
        """Return None."""


class RemoteEthernetMotors:
    """Switches the motors over EPSON's Remote Ethernet, with priority over other requests."""

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
        """Log in and send the command. Raises MotorsError if it fails."""
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
        """Return the controller's status, or None if the port is in use or does not reply."""

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
    """Switches the motors with Motoman's MOTION_CTRL requests on the motion link."""

    missing = ''
    restarts = False

    def __init__(self, link: Link) -> None:
        self._link = link

    async def act(self, action: Action, timeout: float) -> None:
        """Send the command and wait for its MOTION_REPLY. Raises MotorsError if it fails."""
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
        """Return None."""


class SerializedMotors:
    """Executes the commands to another `Motors` object one after the other.

    The last command therefore determines the final state. Cancelling a caller drops a command that
    is still queued, but not a command that has already been sent.
    """

    def __init__(self, motors: Motors) -> None:
        self.missing = motors.missing
        self.restarts = motors.restarts
        self.may_come_on = False
        """True if a command to switch the motors on had no reply and may still take effect."""
        self._motors = motors
        self._lock = asyncio.Lock()
        self._active: asyncio.Task[None] | None = None
        self._tasks: dict[asyncio.Task[None], None] = {}

    @property
    def busy(self) -> bool:
        """True while a command is being executed or queued."""
        return bool(self._tasks)

    async def act(self, action: Action, timeout: float) -> None:
        """Execute an action after all earlier ones. Raises MotorsError if it fails.

        `timeout`, s, starts when the earlier actions are complete.
        """
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
        """Return the controller's status without waiting for queued commands."""
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
