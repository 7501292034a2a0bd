# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Commands for the arm: stop, enable, disable, reset an error."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

from epson_driver.driver.driver import Driver
from epson_driver.driver.inhibit import (
    Cause,
    Inhibit,
    Purpose,
    manual_inhibit,
    refusal_inhibit,
    seen_inhibit,
    status_inhibit,
)
from epson_driver.driver.remedy import Remedy
from epson_driver.driver.stopping.arm_gate import DISABLED, EnableRequest, GateError
from epson_driver.driver.stopping.motors import Action, MotorsError
from epson_driver.driver.tasks import wait_for_fresh_state
from epson_driver.simple_message import Status, TriState

ANSWER_TIMEOUT_S = 2.0  # maximum time for each step of a command, s

STOPPED = 'stopped on request'


class CommandError(RuntimeError):
    def __init__(self, text: str, remedy: Remedy = Remedy.NONE) -> None:
        super().__init__(text)
        self.remedy = remedy


async def _nothing_waits() -> None:
    """Default of `all_received`, for clients whose goals arrive immediately."""


class ArmCommands:
    """Commands for the arm. Each returns a sentence with the result, or raises CommandError.

    `all_received` waits until the driver has received all goals that clients have already sent.
    """

    def __init__(
        self, driver: Driver, all_received: Callable[[], Awaitable[None]] = _nothing_waits
    ) -> None:
        self._driver = driver
        self._all_received = all_received
        self._enable_lock = asyncio.Lock()
        self._disabling = 0  # number of calls of `disable` in progress
        self._disabled = 0  # number of calls of `disable` so far

    async def stop(self) -> str:
        """Stop the arm, abort the running goal, and return when the arm is at rest.

        Goals that arrive during the call are also aborted, because they may have been sent before
        the call. The arm is disabled if the controller does not confirm the stop.
        """
        with self._driver.goal_queue.stopping(f'{STOPPED} before it could start'):
            try:
                return await self._stop()
            finally:
                await self._all_received()

    async def _stop(self) -> str:
        goals, stopper = self._driver.goal_queue, self._driver.stopper
        deadline = _now() + ANSWER_TIMEOUT_S
        message = 'no motion was running, the controller acknowledged STOP'
        source = self._driver.servo.source
        if goals.busy:
            self._driver.servo.stop(STOPPED)  # a stream may start when the goal ends
            outcome = await goals.stop(STOPPED, ANSWER_TIMEOUT_S)
            if outcome is not None:
                message = f'the running motion ended: {outcome.text}'
        elif self._driver.servo.stop(STOPPED):
            message = f'the stream of setpoints on {source} was stopped'
        else:
            stopper.stop()
        if stopper.unsent or not await stopper.wait(deadline - _now()):
            stopper.raise_alarm(stopper.doubt or 'no standstill after STOP')
            within = '' if stopper.unsent else f'no standstill within {ANSWER_TIMEOUT_S:g} s: '
            raise CommandError(f'{within}{stopper.doubt}, {stopper.arm_state}')
        if stopper.failed or stopper.doubt is not None:
            raise CommandError(f'{stopper.doubt or stopper.alarm}, but now {stopper.arm_state}')
        return message

    async def enable(self) -> str:
        """Enable the arm, after switching the motors on if the driver can do that."""
        self._check(Purpose.COMMAND)
        if self._disabling:
            raise CommandError('the arm is still being disabled', Remedy.ENABLE)
        gate = self._driver.gate
        with gate.enabling(motors_on=self._driver.busy) as request:
            work = asyncio.create_task(self._enable(request))
            request.on_cancel = work.cancel
            try:
                message = await work
            except asyncio.CancelledError:
                task = asyncio.current_task()
                if request.canceled is None or (task is not None and task.cancelling()):
                    raise
            if request.canceled is None:
                return message
            status = self._driver.robot.status
            if status is not None:
                self._check(Purpose.ENABLE)
                if not self._disabling:
                    await self._check_why_motors_off(status)
            raise CommandError(
                f'{request.canceled} while the arm was being enabled: it stays disabled',
                Remedy.ENABLE,
            )

    async def _enable(self, request: EnableRequest) -> str:
        driver = self._driver
        async with self._enable_lock:
            if (remaining := driver.second_driver_known - _now()) > 0.0:
                await asyncio.sleep(remaining)
            driver.check_second_driver()
            request.motors_on = driver.busy
            driver.heartbeat.repeat_request()
            start = _now()
            status = await self._wait_for_status(
                lambda _: driver.robot.status_time > start, 'the controller sends no STATUS'
            )
            self._check(Purpose.ENABLE)
            await self._wait_for_first_stop()
            if driver.stopper.delivery.keeps_points:  # the controller would now execute them
                await self._clear_motion()
            driver.stopper.enabling()
            closed = driver.gate.reason is not None
            restarts = driver.motors.restarts and (closed or driver.robot.main_ended)
            if status.drives_powered == TriState.FALSE or (
                restarts and status.motion_possible == TriState.FALSE
            ):
                await self._act(Action.MOTORS_ON)
                try:
                    await self._wait_for_status(
                        lambda status: status.drives_powered == TriState.TRUE,
                        'the motors stay off',
                    )
                except CommandError:
                    await self._check_why_motors_off(driver.robot.status or Status())
                    raise
                if driver.motors.restarts:
                    await self._wait_for_status(
                        lambda status: status.motion_possible == TriState.TRUE,
                        'the program was started, but no motion is possible',
                    )
            await self._clear_motion()
            robot = driver.robot
            fresh = wait_for_fresh_state(robot.why_not_ready, driver.changed, ANSWER_TIMEOUT_S)
            self._check(Purpose.OPEN, await fresh)
            driver.check_second_driver()  # again, immediately before the gate opens
            if closed:
                robot.enabled()
                driver.stopper.enabled()
                try:
                    driver.gate.open(request)
                except GateError as error:
                    raise CommandError(str(error)) from error
            inhibit = driver.why_not(Purpose.REPORT, _now())
            if inhibit is None and not driver.stopper.delivery.resumes:
                inhibit = seen_inhibit(robot.status or Status(), robot.errors)
            return 'the arm is enabled' + ('' if inhibit is None else f', but {inhibit.text}')

    async def _wait_for_first_stop(self) -> None:
        """Wait until STOP has been sent, if a new motion connection must start with it."""
        if self._driver.stop_due:
            await self._wait_for_status(
                lambda _: not self._driver.stop_due,
                'no STATUS, or no joints, which show the byte order for STOP',
            )

    async def _clear_motion(self) -> None:
        """Send STOP if points of an earlier motion may remain. Wait until the arm is at rest."""
        driver = self._driver
        stopper = driver.stopper
        may_have_points = stopper.ours or stopper.may_have_old_points
        if driver.busy or (stopper.over and not may_have_points):
            return
        stopper.stop()
        at_rest = await stopper.wait(ANSWER_TIMEOUT_S)
        if not at_rest or not stopper.answered or stopper.may_have_old_points:
            raise CommandError(f'after the last motion {stopper.doubt}, {stopper.arm_state}')

    async def disable(self) -> str:
        """Disable and stop the arm in any case, and switch the motors off if possible."""
        driver = self._driver
        driver.disable(DISABLED)
        self._disabling += 1
        self._disabled += 1
        try:
            message = await self._bring_to_rest()
            await self._all_received()
            succeeded, why = True, f', but the motors are unchanged: {driver.motors.missing}'
            if not driver.motors.missing:
                succeeded, why = await self._motors_off()
        finally:
            self._disabling -= 1
        text = f'the arm is disabled{why}'
        if message:
            text += f', {message}'
        if not succeeded or not driver.stopper.over:
            raise CommandError(text)
        return text

    async def _bring_to_rest(self) -> str:
        """Stop the arm. Return the reason why the stop is not confirmed, or '' if it is."""
        goals, stopper = self._driver.goal_queue, self._driver.stopper
        if goals.busy:
            await goals.stop(DISABLED, ANSWER_TIMEOUT_S)
        else:
            stopper.stop()
        goals.fault(DISABLED)
        if await stopper.wait(ANSWER_TIMEOUT_S):
            return '' if stopper.doubt is None else f'{stopper.doubt}, but {stopper.arm_state}'
        stopper.raise_alarm(stopper.doubt or 'no standstill after STOP')
        return f'{stopper.doubt}: {stopper.arm_state}'

    async def _motors_off(self) -> tuple[bool, str]:
        driver = self._driver
        try:
            await driver.motors.act(Action.MOTORS_OFF, ANSWER_TIMEOUT_S)
        except MotorsError as error:
            return False, f', but {error}'
        start = _now()
        try:
            status = await self._wait_for_status(
                lambda status: (
                    driver.robot.status_time > start and status.drives_powered != TriState.TRUE
                ),
                'the controller accepted motors off, but no STATUS confirms it',
            )
        except CommandError as error:
            return False, f', but {error}'
        if status.drives_powered != TriState.FALSE:
            return True, ' and the controller accepted motors off (unknown in STATUS)'
        if driver.motors.may_come_on:
            return True, (
                ' and the motors are off, but the controller has not answered an earlier command '
                'to switch them on and may still do so'
            )
        return True, ' and the motors are off'

    async def reset_error(self) -> str:
        """Reset the controller's error. If this stops the program, disable the arm first."""
        await self._wait_for_first_stop()
        if self._driver.motors.restarts:
            self._driver.fault('disabled by the reset, which stops the program')
        try:
            status = self._driver.robot.status
            moves = status is not None and status.in_motion == TriState.TRUE
            if moves and self._driver.gate.reason is not None:  # the arm still brakes
                await self._wait_for_status(
                    lambda status: status.in_motion != TriState.TRUE, 'the arm is still moving'
                )
            await self._act(Action.RESET)
        except CommandError as error:
            if error.remedy is Remedy.RELEASE_ESTOP:
                raise
            start = _now()
            with contextlib.suppress(CommandError):  # the last STATUS may precede an E-stop
                await self._wait_for_status(lambda _: self._driver.robot.status_time > start, '')
            status = self._driver.robot.status
            if status is not None and status.e_stopped == TriState.TRUE:
                text = f'the E-stop is not reset ({error})'
                raise CommandError(text, Remedy.RELEASE_ESTOP) from error
            raise
        await self._wait_for_status(
            lambda status: TriState.TRUE not in (status.in_error, status.e_stopped),
            'the controller accepted the reset, but STATUS still shows an error or E-stop',
        )
        if self._driver.gate.reason is None:
            return 'the controller was reset, the arm stays enabled'
        return 'the controller was reset, the arm stays disabled until it is enabled'

    async def recover(self) -> str:
        """Reset the error and enable the arm, unless `disable` is called during the reset."""
        before = self._disabled
        await self.reset_error()
        if self._disabled != before:
            text = (
                'the controller was reset, but the arm was disabled during it and stays disabled'
            )
            raise CommandError(text, Remedy.ENABLE)
        return await self.enable()

    def _check(self, purpose: Purpose, now: float | None = None) -> None:
        inhibit = self._driver.why_not(purpose, _now() if now is None else now)
        if inhibit is not None:
            raise _inhibited(inhibit)

    async def _check_why_motors_off(self, status: Status) -> None:
        errors = self._driver.robot.errors
        inhibit = status_inhibit(status, errors)
        if inhibit is None or inhibit.cause is not Cause.MOTORS_OFF:
            return
        report = await self._driver.motors.status(ANSWER_TIMEOUT_S)
        if report is not None and (inhibit := refusal_inhibit(*report, errors)):
            self._driver.gate.refusal = inhibit
            raise _inhibited(inhibit)

    async def _act(self, action: Action) -> None:
        try:
            await self._driver.motors.act(action, ANSWER_TIMEOUT_S)
        except MotorsError as error:
            raise self._refused(action, error) from error
        self._driver.gate.refusal = None

    def _refused(self, action: Action, error: MotorsError) -> CommandError:
        robot, inhibit = self._driver.robot, None
        if error.status is not None:
            inhibit = refusal_inhibit(*error.status, robot.errors)
            self._driver.gate.refusal = inhibit
        inhibit = inhibit or manual_inhibit(robot.status or Status())
        if inhibit is None or (action is Action.RESET and inhibit.remedy is Remedy.RESET):
            return CommandError(str(error))
        return _inhibited(inhibit)

    async def _wait_for_status(self, condition: Callable[[Status], bool], failure: str) -> Status:
        robot = self._driver.robot
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                while robot.status is None or not condition(robot.status):
                    await self._driver.changed.wait()
        except TimeoutError as error:
            raise CommandError(f'{failure} (waited {ANSWER_TIMEOUT_S:g} s)') from error
        return robot.status


def _inhibited(inhibit: Inhibit) -> CommandError:
    return CommandError(inhibit.text_with_remedy, inhibit.remedy)


def _now() -> float:
    return asyncio.get_running_loop().time()
