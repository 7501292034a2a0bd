# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Access to the controller's inputs and outputs, and to a gripper that is wired to them."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, TypeVar

from epson_driver.api.errors import RobotError, checked_arguments, checked_timeout
from epson_driver.api.ownership import Unique
from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring
from epson_driver.inputs import Rule, choice, count

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.driver.io import io_client
    from epson_driver.driver.io.gripper import Gripper as DrivenGripper
    from epson_driver.simple_message import IoType

__all__ = ['Gripper', 'GripperState', 'GripperWiring', 'Io']

T = TypeVar('T')

INDEX = count(0, 2**31 - 1)
VALUE = count(-(2**31), 2**31 - 1)

WAIT_PERIOD_S = 0.02  # between two readings of an awaited point, s


class Io(Unique):
    """Reads and writes single I/O points.

    The methods raise RobotError if the controller has no I/O, or refuses a request.
    """

    def __init__(self, driver: Callable[[], 'io_client.Io']) -> None:
        self._driver = driver

    @checked_arguments
    async def read(self, kind: str, index: int) -> int:
        """Return the value of an I/O point, for example `read('DI', 3)`.

        kind: type of the point (docs/io.md lists all types). The value of an analogue point is in
        mV.
        """
        from epson_driver.simple_message import IoAddress

        address = IoAddress(_type(kind), INDEX.checked(index, 'index'))
        return await _answered(self._driver().read, [address])

    @checked_arguments
    async def wait(self, kind: str, index: int, value: int, timeout: float | None = None) -> None:
        """Wait until an I/O point has a value, for example `wait('DI', 3, 1)`.

        Raises TimeoutError after `timeout` s (None: never), and the exceptions of `read`.
        """
        VALUE.checked(value, 'value')
        try:
            async with asyncio.timeout(checked_timeout(timeout)):
                while await self.read(kind, index) != value:
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(WAIT_PERIOD_S):
                            await self._driver().changed.wait()
        except TimeoutError as error:
            raise TimeoutError(f'{kind} {index} was not {value} within {timeout:g} s') from error

    @checked_arguments
    async def write(self, kind: str, index: int, value: int) -> None:
        """Set an output, a group or a flag, for example `write('DO', 3, 1)`."""
        from epson_driver.simple_message import IoSetting

        number = VALUE.checked(int(value) if isinstance(value, bool) else value, 'value')
        setting = IoSetting(_type(kind), INDEX.checked(index, 'index'), number)
        await _answered(self._driver().write, [setting])


class Gripper(Unique):
    """Opens and closes the gripper of `Settings(gripper=GripperWiring(...))`.

    Without this setting, each method raises RobotError. The arm need not be enabled.
    """

    def __init__(self, gripper: Callable[[], 'DrivenGripper | None']) -> None:
        self._gripper = gripper

    async def open(self) -> GripperState:
        """Open the gripper, and return its state once it is open.

        Raises RobotError if the gripper does not open in time, or a newer command replaces this
        one.
        """
        return await _done(self._known().move(opened=True))

    async def close(self) -> GripperState:
        """Close the gripper, and return its state once it is closed or holds a part.

        If the gripper is neither open nor closed after the wiring's `time`, it counts as holding a
        part, and `closed` of the state is False. Raises RobotError if the gripper stays open, or a
        newer command replaces this one.
        """
        return await _done(self._known().move(opened=False))

    async def state(self) -> GripperState:
        """Read the gripper's state from its inputs.

        Raises RobotError if the inputs are unknown.
        """
        return await _done(self._known().state())

    def _known(self) -> 'DrivenGripper':
        gripper = self._gripper()
        if gripper is None:
            raise RobotError(
                'no gripper is configured: Robot(..., settings=Settings(gripper=...))'
            )
        return gripper


def _type(kind: str) -> 'IoType':
    from epson_driver.driver.io.points import NAMES

    known = {name.upper(): io_type for io_type, name in NAMES.items()}
    rule = Rule(lambda value: known[str.upper(value)], choice(*NAMES.values()).text)
    io_type: IoType = rule.checked(kind, 'kind')
    return io_type


async def _answered(
    ask: Callable[[list[T]], Awaitable[list['io_client.IoAnswer']]], points: list[T]
) -> int:
    from epson_driver.driver.io.points import IoUnavailableError

    try:
        (answer,) = await ask(points)
    except IoUnavailableError as error:
        raise RobotError(str(error)) from error
    if answer.text:
        raise RobotError(answer.text)
    return answer.value


async def _done(work: Awaitable[T]) -> T:
    try:
        return await work
    except GripperError as error:
        raise RobotError(str(error)) from error
