# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The gripper of a robot, if its wiring is known."""

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, TypeVar

from epson_driver.api.errors import RobotError
from epson_driver.api.ownership import Unique
from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring

if TYPE_CHECKING:  # the driver is loaded when a Robot is made
    from epson_driver.driver.io.gripper import Gripper as DrivenGripper

__all__ = ['Gripper', 'GripperState', 'GripperWiring']

T = TypeVar('T')


class Gripper(Unique):
    """Opens and closes the gripper that `Settings(gripper=GripperWiring(...))` describes.

    Without that, each method raises RobotError that says so. The arm need not be enabled for it.
    """

    def __init__(self, gripper: Callable[[], 'DrivenGripper | None']) -> None:
        self._gripper = gripper

    async def open(self) -> GripperState:
        """Open it and return its state when it is open.

        Raises RobotError if it does not open in its time, or if a newer command took its place.
        """
        return await _answered(self._known().move(opened=True))

    async def close(self) -> GripperState:
        """Close it and return its state: closed, or neither if it holds something.

        Whether it holds something is known after its `time`. Raises RobotError if it stays open,
        or if a newer command took its place.
        """
        return await _answered(self._known().move(opened=False))

    async def state(self) -> GripperState:
        """Return what its inputs show now. Raises RobotError if they are not known."""
        return await _answered(self._known().state())

    def _known(self) -> 'DrivenGripper':
        gripper = self._gripper()
        if gripper is None:
            raise RobotError('no gripper is known: Robot(..., settings=Settings(gripper=...))')
        return gripper


async def _answered(work: Awaitable[T]) -> T:
    try:
        return await work
    except GripperError as error:
        raise RobotError(str(error)) from error
