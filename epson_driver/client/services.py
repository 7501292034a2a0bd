# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the driver's services do: `~/stop`, `~/enable`, `~/disable`, `~/reset_error`."""

import asyncio
from collections.abc import Callable

from epson_driver.client.arm_gate import what_forbids_motion
from epson_driver.client.driver import Driver
from epson_driver.client.motors import Action, MotorsError, motors
from epson_driver.client.points import STOP
from epson_driver.client.refusal import refusal
from epson_driver.simple_message import Packet, Status, TriState

ANSWER_TIMEOUT = 2.0
"""How long a service waits for the controller, s."""


class ServiceError(RuntimeError):
    """A service could not do what was asked; the text says why and what to do."""


class Services:
    """Each public method is a service: it returns a sentence, or raises ServiceError."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        configuration = driver.configuration
        self._motors = motors(
            configuration.motors,
            configuration.host,
            configuration.remote_port,
            driver.motion_link,
        )

    async def stop(self) -> str:
        """Stop the arm; a running goal ends as aborted. Returns a sentence.

        Raises ServiceError if the controller cannot be reached, refuses, or does not answer.
        """
        self._driver.goals.end_waiting('stopped by ~/stop before it could start')
        if self._driver.goals.busy:
            outcome = await self._driver.goals.stop('stopped by ~/stop', ANSWER_TIMEOUT)
            if outcome is None:
                raise ServiceError(f'STOP was sent; no standstill within {ANSWER_TIMEOUT:g} s')
            return f'the running goal ended: {outcome.text}'
        answer: asyncio.Future[Packet] = asyncio.get_running_loop().create_future()

        def on_reply(packet: Packet, _now: float) -> None:
            if not answer.done():
                answer.set_result(packet)

        try:
            self._driver.delivery.post(STOP, on_reply)
            async with asyncio.timeout(ANSWER_TIMEOUT):
                packet = await answer
        except ConnectionError as error:
            raise ServiceError(f'STOP could not be sent: {error}') from error
        except TimeoutError as error:
            raise ServiceError(f'no reply to STOP within {ANSWER_TIMEOUT:g} s') from error
        if (no := refusal(packet)) is not None:
            raise ServiceError(f'the controller refused STOP ({no})')
        return 'no goal was running; the controller acknowledged STOP'

    async def enable(self) -> str:
        """Open the arm gate, after switching the motors on where the driver can.

        What counts is the next STATUS, not the last one: motors may have gone off since.

        Raises ServiceError that says what is in the way and what to do about it.
        """
        self._check_links()
        errors = self._driver.robot.errors
        asked = asyncio.get_running_loop().time()
        status = await self._wait_for_status(
            lambda _: self._driver.robot.status_time > asked, 'the controller sends no STATUS'
        )
        if status.e_stopped == TriState.TRUE:
            raise ServiceError(
                'the E-stop is pressed or not reset: release it, call ~/reset_error (or reset at '
                'the controller), then ~/enable'
            )
        if status.in_error == TriState.TRUE:
            raise ServiceError(
                f'the controller is in error {errors.phrase(status.error_code)}: '
                f'{errors.advice(status.error_code, "remove the cause")}; call ~/reset_error, '
                'then ~/enable'
            )
        if status.drives_powered == TriState.FALSE:
            await self._act(Action.MOTORS_ON)
            status = await self._wait_for_status(
                lambda status: status.drives_powered == TriState.TRUE, 'the motors stay off'
            )
        if (why := await self._driver.why_not_ready(ANSWER_TIMEOUT)) is not None:
            raise ServiceError(f'nobody knows where the arm is: {why}')
        self._check_links()
        newest = self._driver.robot.status
        if newest is None:
            raise ServiceError('the controller sends no STATUS')
        if (why := what_forbids_motion(newest, errors)) is not None:
            raise ServiceError(why)
        if self._driver.gate.reason is not None:
            self._driver.robot.enabled()
            self._driver.gate.open()
        return 'the arm is enabled'

    async def disable(self) -> str:
        """Stop, close the arm gate, and switch the motors off where the driver can."""
        self._driver.gate.close('disabled by ~/disable')
        await self._driver.goals.stop('stopped by ~/disable', ANSWER_TIMEOUT)
        self._driver.fault('disabled by ~/disable')
        if self._motors.missing:
            why = self._motors.missing
            return f'the arm is disabled; {why}, so the motors were left as they are'
        await self._act(Action.MOTORS_OFF)
        return 'the arm is disabled and the motors are off'

    async def reset_error(self) -> str:
        """Reset the controller's error. The arm stays disabled.

        Raises ServiceError if it cannot be done, or if no STATUS shows that it was.
        """
        await self._act(Action.RESET)
        await self._wait_for_status(
            lambda status: TriState.TRUE not in (status.in_error, status.e_stopped),
            'the controller took the reset, but no STATUS shows that error and E-stop are gone',
        )
        return 'the controller was reset; call ~/enable to move again'

    def _check_links(self) -> None:
        for link in (self._driver.state_link, self._driver.motion_link):
            if not link.connected:
                raise ServiceError(
                    f'the {link.name} link to {link.host}:{link.port} is {link.state.value}: '
                    'start the controller, or check robot_ip and the ports'
                )

    async def _act(self, action: Action) -> None:
        """Have the controller do something; where that is not possible, say what a person can."""
        try:
            await self._motors.act(action, ANSWER_TIMEOUT)
        except MotorsError as error:
            raise ServiceError(str(error)) from error

    async def _wait_for_status(self, good: Callable[[Status], bool], otherwise: str) -> Status:
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT):
                while self._driver.robot.status is None or not good(self._driver.robot.status):
                    await self._driver.changes.next()
        except TimeoutError as error:
            raise ServiceError(f'{otherwise} (waited {ANSWER_TIMEOUT:g} s)') from error
        return self._driver.robot.status
