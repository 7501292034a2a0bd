# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the driver's services do: `~/stop`, `~/enable`, `~/disable`, `~/reset_error`."""

import asyncio
from collections.abc import Callable

from epson_driver.client.arm_gate import what_forbids_motion
from epson_driver.client.driver import Driver
from epson_driver.client.points import STOP
from epson_driver.client.refusal import refusal
from epson_driver.link.remote_ethernet import RemoteError, execute
from epson_driver.simple_message import Packet, Status, TriState

ANSWER_TIMEOUT = 2.0
"""How long a service waits for the controller, s."""


class ServiceError(RuntimeError):
    """A service could not do what was asked; the text says why and what to do."""


class Services:
    """Each public method is a service: it returns a sentence, or raises ServiceError."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver

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

        Raises ServiceError that says what is in the way and what to do about it.
        """
        self._check_links()
        errors = self._driver.robot.errors
        status = await self._wait_for_status(lambda status: True, 'the controller sends no STATUS')
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
            await self._remote(['SetMotorsOn,1'], 'switch the motors on at the controller')
            status = await self._wait_for_status(
                lambda status: status.drives_powered == TriState.TRUE, 'the motors stay off'
            )
        self._check_links()
        if (why := what_forbids_motion(status, errors)) is not None:
            raise ServiceError(why)
        self._driver.gate.open()
        return 'the arm is enabled'

    async def disable(self) -> str:
        """Stop, close the arm gate, and switch the motors off where the driver can."""
        self._driver.gate.close('disabled by ~/disable')
        await self._driver.goals.stop('stopped by ~/disable', ANSWER_TIMEOUT)
        self._driver.fault('disabled by ~/disable')
        if not self._driver.configuration.remote_port:
            return 'the arm is disabled; remote_port is 0, so the motors were left as they are'
        await self._remote(['SetMotorsOff,1'], 'switch the motors off at the controller')
        return 'the arm is disabled and the motors are off'

    async def reset_error(self) -> str:
        """Reset the controller's error. The arm stays disabled."""
        await self._remote(['Reset'], 'reset the error at the controller')
        return 'the controller was reset; call ~/enable to move again'

    def _check_links(self) -> None:
        for link in (self._driver.state_link, self._driver.motion_link):
            if not link.connected:
                raise ServiceError(
                    f'the {link.name} link to {link.host}:{link.port} is {link.state.value}: '
                    'start the controller, or check robot_ip and the ports'
                )

    async def _remote(self, commands: list[str], by_hand: str) -> None:
        """Run Remote Ethernet commands; where that is not possible, say what a person can do."""
        port = self._driver.configuration.remote_port
        if not port:
            raise ServiceError(f'remote_port is 0, the driver cannot do it: {by_hand}')
        try:
            await execute(self._driver.configuration.host, port, commands, timeout=ANSWER_TIMEOUT)
        except (RemoteError, OSError, TimeoutError) as error:
            where = f'remote port {self._driver.configuration.host}:{port}'
            raise ServiceError(f'{where}: {str(error) or "no answer"}: {by_hand}') from error

    async def _wait_for_status(self, good: Callable[[Status], bool], otherwise: str) -> Status:
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT):
                while self._driver.robot.status is None or not good(self._driver.robot.status):
                    await self._driver.changes.next()
        except TimeoutError as error:
            raise ServiceError(f'{otherwise} (waited {ANSWER_TIMEOUT:g} s)') from error
        return self._driver.robot.status
