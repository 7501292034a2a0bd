# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A gripper with two outputs that open and close it, and two inputs for its end positions.

The gripper also moves while the arm is disabled, and cannot be stopped (docs/io.md).
"""

import asyncio
import contextlib

from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring
from epson_driver.driver.io.io_client import Io
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.simple_message import IoAddress, IoSetting, IoType

READ_PERIOD_S = 0.1  # maximum time between two readings of the inputs during a motion, s


class Gripper:
    """Opens and closes one gripper. A new command replaces the previous one."""

    def __init__(self, io: Io, wiring: GripperWiring) -> None:
        self.wiring = wiring
        self._io = io
        self._commands = 0
        self._input_was_on = False

    async def state(self) -> GripperState:
        return self._checked_state(*await self._inputs())

    async def _inputs(self) -> tuple[bool, bool]:
        wiring = self.wiring
        inputs = [
            IoAddress(IoType.DIGITAL_INPUT, index)
            for index in (wiring.opened_input, wiring.closed_input)
        ]
        try:
            answers = await self._io.read(inputs)
        except IoUnavailableError as error:
            raise GripperError(f'the inputs of the gripper are not known: {error}') from error
        for answer in answers:
            if answer.text:
                raise GripperError(f'the inputs of the gripper are not known: {answer.text}')
        opened, closed = (bool(answer.value) for answer in answers)
        self._input_was_on |= opened or closed
        return opened, closed

    def _checked_state(self, opened: bool, closed: bool) -> GripperState:
        if opened and closed:
            raise GripperError(
                f'DI {self.wiring.opened_input} (opened) and DI {self.wiring.closed_input} '
                '(closed) are both on: check the wiring'
            )
        return GripperState(opened, closed)

    async def move(self, *, opened: bool) -> GripperState:
        """Open or close the gripper, and wait until it has reached its end or holds an object.

        Returns the state of the gripper.
        """
        self._commands += 1
        command = self._commands
        wiring = self.wiring
        on, off = wiring.open_output, wiring.close_output
        if not opened:
            on, off = off, on
        await self._write([(off, 0), (on, 1)])
        deadline = asyncio.get_running_loop().time() + wiring.time
        while True:
            inputs = await self._inputs()
            if command != self._commands:
                raise GripperError('replaced by a newer command')
            if inputs == (opened, not opened):
                return GripperState(*inputs)
            remaining = deadline - asyncio.get_running_loop().time()
            if remaining <= 0.0:
                return self._state_after_timeout(self._checked_state(*inputs), opened)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(min(READ_PERIOD_S, remaining)):
                    await self._io.changed.wait()

    async def _write(self, outputs: list[tuple[int, int]]) -> None:
        settings = [IoSetting(IoType.DIGITAL_OUTPUT, index, value) for index, value in outputs]
        try:
            answers = await self._io.write(settings)
        except IoUnavailableError as error:
            raise GripperError(f'the outputs of the gripper were not set: {error}') from error
        for answer in answers:
            if answer.text:
                raise GripperError(f'the outputs of the gripper were not set: {answer.text}')

    def _state_after_timeout(self, state: GripperState, opened: bool) -> GripperState:
        """Return `state` if the gripper holds an object after closing, else raise GripperError."""
        wiring = self.wiring
        if not self._input_was_on:
            raise GripperError(
                f'neither DI {wiring.opened_input} (opened) nor DI {wiring.closed_input} (closed) '
                'has ever been on: check the wiring, or open it first'
            )
        if not opened and not state.opened:
            return state
        expected = 'DI {} (opened)' if opened else 'DI {} (closed)'
        expected = expected.format(wiring.opened_input if opened else wiring.closed_input)
        actual = 'closed' if state.closed else 'open' if state.opened else 'between'
        raise GripperError(f'{expected} did not come on within {wiring.time:g} s; it is {actual}')
