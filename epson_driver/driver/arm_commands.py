# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Commands for the arm: stop, enable, disable, reset the error."""

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

ANSWER_TIMEOUT_S = 2.0
"""Time for the controller to respond to a service call, s."""


STOPPED = 'stopped on request'


class CommandError(RuntimeError):
    """A failed command, with the reason as its text, and the remedy."""

    def __init__(self, text: str, remedy: Remedy = Remedy.NONE) -> None:
        super().__init__(text)
        self.remedy = remedy


async def _nothing_waits() -> None:
    """Return immediately, for callers that submit goals directly."""


class ArmCommands:
    """The commands for the arm. Each returns a sentence, or raises CommandError.

    `all_taken` waits until the driver has received all goals that were sent before.
    """

    def __init__(
        self, driver: Driver, all_taken: Callable[[], Awaitable[None]] = _nothing_waits
    ) -> None:
        self._driver = driver
        self._all_taken = all_taken
        self._one_enables = asyncio.Lock()
        self._disabling = 0
        self._disabled = 0
        """Number of calls of `disable`."""

    async def stop(self) -> str:
        """Stop the arm, abort a running goal, and return a sentence when the arm is at rest.

        Goals that arrive before this returns are also aborted, because they may have been sent
        earlier and delayed.

        Raises CommandError, with the arm gate closed, unless the controller acknowledged STOP and
        the state shows that the arm is at rest.
        """
        with self._driver.goal_queue.stopping(f'{STOPPED} before it could start'):
            try:
                return await self._stop()
            finally:
                await self._all_taken()

    async def _stop(self) -> str:
        goals, stopper = self._driver.goal_queue, self._driver.stopper
        ends = _now() + ANSWER_TIMEOUT_S
        message = 'no motion was running, the controller acknowledged STOP'
        source = self._driver.servo.source
        if goals.busy:
            self._driver.servo.stop(STOPPED)  # a stream may be waiting for its turn
            outcome = await goals.stop(STOPPED, ANSWER_TIMEOUT_S)
            if outcome is not None:
                message = f'the running motion ended: {outcome.text}'
        elif self._driver.servo.stop(STOPPED):
            message = f'the stream of setpoints on {source} was stopped'
        else:
            stopper.stop()
        if stopper.unsent or not await stopper.wait(ends - _now()):
            stopper.raise_alarm(stopper.doubt or 'no standstill after STOP')
            within = '' if stopper.unsent else f'no standstill within {ANSWER_TIMEOUT_S:g} s: '
            raise CommandError(f'{within}{stopper.doubt}, {stopper.arm_state}')
        if stopper.failed or stopper.doubt is not None:
            raise CommandError(f'{stopper.doubt or stopper.alarm}, but now {stopper.arm_state}')
        return message

    async def enable(self) -> str:
        """Open the arm gate, after switching the motors on if the driver can do that.

        It relies on the next STATUS, not the last one, because the motors may have gone off since.
        Any event during this call that closes the gate, or would close an open one, cancels it.

        Raises CommandError with the reason and the remedy if the arm cannot be enabled.
        """
        self._check(Purpose.COMMAND)
        if self._disabling:
            raise CommandError('the arm is still being disabled', Remedy.ENABLE)
        gate = self._driver.gate
        with gate.enabling(motors_on=self._driver.busy) as enabling:
            work = asyncio.create_task(self._enable(enabling))
            enabling.on_cancel = work.cancel
            try:
                message = await work
            except asyncio.CancelledError:
                task = asyncio.current_task()
                if enabling.canceled is None or (task is not None and task.cancelling()):
                    raise
            if enabling.canceled is None:
                return message
            status = self._driver.robot.status
            if status is not None:
                self._check(Purpose.ENABLE)
                if not self._disabling:
                    await self._check_what_took_the_motors(status)
            raise CommandError(
                f'{enabling.canceled} while the arm was being enabled: it stays disabled',
                Remedy.ENABLE,
            )

    async def _enable(self, enabling: EnableRequest) -> str:
        driver = self._driver
        async with self._one_enables:
            if (early := driver.namesakes_known - _now()) > 0.0:
                await asyncio.sleep(early)
            driver.look_for_namesakes()
            enabling.motors_on = driver.busy
            driver.heartbeat.ask_again()
            asked = _now()
            status = await self._wait_for_status(
                lambda _: driver.robot.status_time > asked, 'the controller sends no STATUS'
            )
            self._check(Purpose.ENABLE)
            await self._wait_for_first_stop()
            if driver.stopper.delivery.keeps_points:  # with motors on, it would execute them
                await self._clear_motion()
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
                    await self._check_what_took_the_motors(driver.robot.status or Status())
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
            driver.look_for_namesakes()  # again, immediately before the gate opens
            if closed:
                robot.enabled()
                driver.stopper.enabled()
                try:
                    driver.gate.open(enabling)
                except GateError as error:
                    raise CommandError(str(error)) from error
            held = driver.why_not(Purpose.REPORT, _now())
            if held is None and not driver.stopper.delivery.resumes:
                held = seen_inhibit(robot.status or Status(), robot.errors)
            return 'the arm is enabled' + ('' if held is None else f', but {held.text}')

    async def _wait_for_first_stop(self) -> None:
        """Wait until STOP is sent, on a motion connection that needs it first."""
        if self._driver.stop_due:
            await self._wait_for_status(
                lambda _: not self._driver.stop_due,
                'no STATUS, or no joints, which show the byte order for STOP',
            )

    async def _clear_motion(self) -> None:
        """Send STOP so that the controller drops remaining points, and wait for rest."""
        driver = self._driver
        stopper = driver.stopper
        if driver.busy or (stopper.over and not stopper.ours and not stopper.kept):
            return
        stopper.stop()
        if not await stopper.wait(ANSWER_TIMEOUT_S) or not stopper.answered or stopper.kept:
            raise CommandError(f'after the last motion {stopper.doubt}, {stopper.arm_state}')

    async def disable(self) -> str:
        """Close the arm gate, stop, and switch the motors off if the driver can do that.

        Raises CommandError unless the state shows that the arm is at rest and that the motors are
        off, if the driver can switch them and STATUS reports them. The gate is closed in any case.
        """
        driver = self._driver
        driver.disable(DISABLED)
        self._disabling += 1
        self._disabled += 1
        try:
            message = await self._bring_to_rest()
            await self._all_taken()
            if driver.motors.missing:
                motors, why = (
                    True,
                    f', but the motors are unchanged: {driver.motors.missing}',
                )
            else:
                motors, why = await self._motors_off()
        finally:
            self._disabling -= 1
        text = f'the arm is disabled{why}'
        if message:
            text += f', {message}'
        if not motors or not driver.stopper.over:
            raise CommandError(text)
        return text

    async def _bring_to_rest(self) -> str:
        """Stop the arm, and return the problem, or ''."""
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
        """Switch the motors off. Return whether they are presumably off, and a clause."""
        driver = self._driver
        try:
            await driver.motors.act(Action.MOTORS_OFF, ANSWER_TIMEOUT_S)
        except MotorsError as error:
            return False, f', but {error}'
        asked = _now()
        try:
            status = await self._wait_for_status(
                lambda status: (
                    driver.robot.status_time > asked and status.drives_powered != TriState.TRUE
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
        """Reset the controller's error. The arm stays disabled.

        If the reset stops the controller's program, an enabled arm is disabled. Enabling it starts
        the program again.

        Raises CommandError if the reset fails, or if no STATUS confirms it.
        """
        await self._wait_for_first_stop()
        if self._driver.motors.restarts:
            self._driver.fault('disabled by the reset, which stops the program')
        try:
            status = self._driver.robot.status
            moves = status is not None and status.in_motion == TriState.TRUE
            if moves and self._driver.gate.reason is not None:  # it still brakes
                await self._wait_for_status(
                    lambda status: status.in_motion != TriState.TRUE, 'the arm is still moving'
                )
            await self._act(Action.RESET)
        except CommandError as error:
            if error.remedy is Remedy.RELEASE_ESTOP:
                raise
            asked = _now()
            with contextlib.suppress(CommandError):  # it may have been pressed since the last one
                await self._wait_for_status(lambda _: self._driver.robot.status_time > asked, '')
            status = self._driver.robot.status
            if status is not None and status.e_stopped == TriState.TRUE:
                text = f'the E-stop is not reset ({error})'
                raise CommandError(text, Remedy.RELEASE_ESTOP) from error
            raise
        await self._wait_for_status(
            lambda status: TriState.TRUE not in (status.in_error, status.e_stopped),
            'the controller accepted the reset, but STATUS still shows an error or E-stop',
        )
        return 'the controller was reset, the arm stays disabled until it is enabled'

    async def recover(self) -> str:
        """Reset the controller's error and enable the arm, unless it is disabled in between.

        Raises CommandError if either fails.
        """
        before = self._disabled
        await self.reset_error()
        if self._disabled != before:
            text = (
                'the controller was reset, but the arm was disabled during it and stays disabled'
            )
            raise CommandError(text, Remedy.ENABLE)
        return await self.enable()

    def _check(self, purpose: Purpose, now: float | None = None) -> None:
        """Raise CommandError if a purpose is inhibited at `now`, s, or currently."""
        result = self._driver.why_not(purpose, _now() if now is None else now)
        if result is not None:
            raise _inhibited(result)

    async def _check_what_took_the_motors(self, status: Status) -> None:
        """Raise CommandError if a cause of the motors being off, such as a door, is reported."""
        result = status_inhibit(status, self._driver.robot.errors)
        if result is None or result.cause is not Cause.MOTORS_OFF:
            return
        report = await self._driver.motors.tell(ANSWER_TIMEOUT_S)
        if report is not None and (result := refusal_inhibit(*report, self._driver.robot.errors)):
            raise _inhibited(result)

    async def _act(self, action: Action) -> None:
        """Send an action to the controller. Raises CommandError with a remedy if it fails."""
        try:
            await self._driver.motors.act(action, ANSWER_TIMEOUT_S)
        except MotorsError as error:
            raise self._refused(action, error) from error

    def _refused(self, action: Action, error: MotorsError) -> CommandError:
        """Return why an action was refused: the controller's reported condition, or the error."""
        robot, result = self._driver.robot, None
        if error.told is not None:
            result = refusal_inhibit(*error.told, robot.errors)
        result = result or manual_inhibit(robot.status or Status())
        if result is None or (action is Action.RESET and result.remedy is Remedy.RESET):
            return CommandError(str(error))
        return _inhibited(result)

    async def _wait_for_status(self, good: Callable[[Status], bool], otherwise: str) -> Status:
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                while self._driver.robot.status is None or not good(self._driver.robot.status):
                    await self._driver.changed.wait()
        except TimeoutError as error:
            raise CommandError(f'{otherwise} (waited {ANSWER_TIMEOUT_S:g} s)') from error
        return self._driver.robot.status


def _inhibited(found: Inhibit) -> CommandError:
    return CommandError(found.text_with_remedy, found.remedy)


def _now() -> float:
    return asyncio.get_running_loop().time()
