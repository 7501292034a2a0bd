# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Supervision of STOP until it is acknowledged and the arm is at rest.

Rules (docs/invariants.md, 3 and 9):

1. The Stopper sends every message on the motion port. It therefore knows whether the controller
   may still have points of this driver to execute. After STOP no new motion starts before the stop
   is over.
2. A stop is over when the arm has been at rest for REST_TIME_S after STOP was acknowledged.
   Without an acknowledgement, the arm must have been at rest for UNCONFIRMED_REST_TIME_S. If a
   reply can still arrive, it must also have been at rest for the reply timeout.
3. The alarm is raised if STOP is rejected, if its reply is late, or if the arm does not come to
   rest in time. The owner then closes the arm gate. While the arm still moves, STOP is repeated,
   and the motors are switched off if the driver can do that. A failed attempt is repeated, even if
   it has brought the arm to rest, until the motors are off or the arm is to be enabled again.
4. A controller that has switched off the motors, for example because of an E-stop, need not accept
   STOP. Only an arm that keeps moving then raises the alarm.
5. If a controller may still have points when a client connects, it receives STOP first
   (`may_resume`). These points may be from this driver or, on controllers that keep points, from
   an earlier client.
6. If the arm moves without a motion of this driver, for example because an operator jogs it, STOP
   is not repeated, and the motors are not switched off.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable

import numpy as np

from epson_driver.driver.delivery.delivery import Delivery, OnReply
from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.delivery.streaming import STOP
from epson_driver.driver.state.robot_state import RobotState
from epson_driver.driver.state.standstill import REST_TIME_S, UNCONFIRMED_REST_TIME_S, Standstill
from epson_driver.driver.stopping.motors import Action, Motors, MotorsError
from epson_driver.driver.tasks import Notification, report_task_error
from epson_driver.simple_message import Message, Packet, TriState

ANSWER_TIMEOUT_S = 1.0  # maximum wait for the reply to STOP before the alarm is raised, s
BRAKING_TIMEOUT_S = 2.0  # maximum time from STOP to rest before the alarm is raised, s
STOP_REPEAT_PERIOD_S = 0.3  # period for repeating STOP while the arm moves in spite of it, s
MOTORS_OFF_DELAY_S = 0.5  # wait from the alarm to motors off, s. An E-stop stops the arm sooner
MOTORS_OFF_TIMEOUT_S = 2.0  # maximum duration of one attempt to switch the motors off, s
CAUSE_TIMEOUT_S = 0.1  # maximum wait for the STATUS with the reason for a refused STOP, s

CHECK_PERIOD_S = 0.1
"""Period for checking a pending stop, s. Timeouts count checks, so time in which this process was
not scheduled does not count."""

_log = logging.getLogger(__name__)


class Stopper:
    """Sends all messages on the motion port, and supervises each STOP until the arm is at rest.

    Times are the event loop's, s. Callbacks:

    * `before_point`: called before each point. It may raise ConnectionError to prevent sending.
    * `on_alarm(why, unanswered)`: called when a stop fails. `unanswered`: STOP has no reply yet.
    * `on_rest`: called when a stop is over.
    """

    def __init__(
        self,
        delivery: Delivery,
        robot: RobotState,
        changed: Notification,
        motors: Motors,
        on_alarm: Callable[[str, bool], None],
        on_rest: Callable[[], None],
        before_point: Callable[[], None] = lambda: None,
    ) -> None:
        self.stopped_velocity = 0.01  # velocity below which a joint counts as stopped, rad/s
        self.alarm: str | None = None  # why the last stop failed, until the arm is enabled
        self.delivery = delivery
        self._robot = robot
        self._changed = changed
        self._motors = motors
        self._on_alarm = on_alarm
        self._on_rest = on_rest
        self._before_point = before_point
        self._ours = False
        self._since: float | None = None
        self._sent = 0.0
        self._acknowledged = False
        self._rejection: str | None = None
        self._rejected_check = 0
        self._unsent: str | None = None
        self._alarm_since: float | None = None
        self._reported = ''
        self._standstill = Standstill(0.0)
        self._timer: asyncio.TimerHandle | None = None
        self._checks = 0
        self._switching: asyncio.Task[None] | None = None
        self._keep_switching = False

    def post(self, message: Message, on_reply: OnReply) -> None:
        if message == STOP:
            self._post_stop(on_reply)
        else:
            self._before_point()
            self._ours = True
            self.delivery.post(message, on_reply)

    @property
    def over(self) -> bool:
        return self._since is None

    @property
    def ours(self) -> bool:
        """True while the controller may still have points of this driver to execute."""
        return self._ours

    @property
    def may_resume(self) -> bool:
        """True if the controller may resume earlier points when a client connects."""
        return self.delivery.keeps_points or self._ours or not self.over

    @property
    def may_have_old_points(self) -> bool:
        return self.delivery.keeps_points and self.doubt is not None

    @property
    def answered(self) -> bool:
        return self._acknowledged or self._rejection is not None

    @property
    def failed(self) -> bool:
        """True if the last stop raised the alarm, even if the arm is at rest now."""
        return self._alarm_since is not None

    @property
    def unsent(self) -> bool:
        return self._unsent is not None

    @property
    def doubt(self) -> str | None:
        """Why it is uncertain whether the last stop has succeeded, or None."""
        if self._unsent is not None and not self._acknowledged:
            return f'STOP could not be sent: {self._unsent}'
        if self._rejection is not None:
            return f'the controller refused STOP ({self._rejection})'
        if not self._acknowledged:
            return 'no reply to STOP'
        if self._since is None:
            return None
        if self._no_joints:
            return 'no joint state shows whether the arm is at rest'
        return 'the arm is moving' if self._moves() else 'no STATUS shows that the arm is at rest'

    @property
    def arm_state(self) -> str:
        if self._no_joints:
            return 'no joint state shows whether the arm is at rest'
        return 'the arm is still moving' if self._moves() else 'the arm is at rest'

    @property
    def _no_joints(self) -> bool:
        return self._robot.sample is None or self._robot.joints_unavailable

    def stop(self) -> None:
        """Send STOP and supervise the stop. If STOP cannot be sent, `doubt` is the reason."""
        with contextlib.suppress(ConnectionError):
            self._post_stop(lambda _packet, _now: None)

    async def wait(self, timeout: float) -> bool:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while not self.over:
                    await self._changed.wait()
        return self.over

    def raise_alarm(self, why: str) -> None:
        if self._since is not None and self._alarm_since is None:
            self._alarm_since = _now()
            self.alarm = why
            self._on_alarm(why, not self.answered)

    def goal_reached(self) -> None:
        """Record that all points are executed, because a goal succeeded or a stream ended."""
        self._ours = False

    def enabling(self) -> None:
        """End the attempts to switch the motors off, unless the arm still moves."""
        self._keep_switching = False

    def enabled(self) -> None:
        self.alarm = None

    def link_lost(self) -> None:
        if self._since is not None and not self.answered and self._unsent is None:
            self._not_sent('the motion link was lost')

    def update(self, now: float) -> None:
        sample = self._robot.sample
        if self._since is None or sample is None:
            return
        if not self._powered():  # rule 4: a reply is not required
            self._standstill.expect_rest(
                REST_TIME_S if self._acknowledged else UNCONFIRMED_REST_TIME_S
            )
        stopped = np.full(len(sample.positions), self.stopped_velocity)
        self._standstill.update(sample, self._robot, stopped, now)
        if self._standstill.reached(sample.measured):
            self._end(now)

    async def close(self) -> None:
        self._since = None
        self._stop_polling()
        if self._switching is not None:
            self._switching.cancel()
            await asyncio.gather(self._switching, return_exceptions=True)

    async def motors_off(self, timeout: float) -> None:
        """Try once to switch the motors off if the arm moves in spite of STOP."""
        if not self.over and self._ours and self._moves():
            await self._switch_off(timeout)

    def _post_stop(self, on_reply: OnReply) -> None:
        now = _now()
        self._sent = now
        if self._since is None:
            self._since, self._alarm_since, self._reported = now, None, ''
            self._acknowledged = False
            self._rejection = None
            self._standstill = Standstill(now)
            # wait until the reply is overdue, because after a network delay the state may be first
            self._standstill.expect(now, max(UNCONFIRMED_REST_TIME_S, ANSWER_TIMEOUT_S))
            self._stop_polling()
            self._checks = 0
            self._check_later()
        self._unsent = None

        def on_answer(packet: Packet, now: float) -> None:
            on_reply(packet, now)
            self._on_answer(packet, now)

        try:
            self.delivery.post(STOP, on_answer)
        except ConnectionError as error:
            self._not_sent(str(error))
            raise

    def _not_sent(self, why: str) -> None:
        """Record that no reply to STOP will arrive, so only the robot state can end the stop."""
        self._unsent = why
        if not self.answered:
            self._standstill.expect_rest(UNCONFIRMED_REST_TIME_S)

    def _on_answer(self, packet: Packet, now: float) -> None:
        if self._since is None or self._acknowledged:
            return
        no = reply_rejection(packet)
        if no is None:
            self._acknowledged = True
            self._standstill.expect(now, REST_TIME_S)
        else:
            if self._rejection is None:
                self._rejection, self._rejected_check = no, self._checks
            self._standstill.expect(now, UNCONFIRMED_REST_TIME_S)
        self._changed.notify_all()

    def _end(self, now: float) -> None:
        confirmed = self._acknowledged and self._rejection is None
        if not confirmed and self._unsent is None and self._powered():
            self.raise_alarm(self.doubt or 'STOP was not acknowledged')
        if self._alarm_since is not None:
            _log.warning('the arm is at rest %.2f s after STOP', now - (self._since or now))
        self._ours = self._ours and not self._acknowledged
        self._since = None
        self._stop_polling()
        self._changed.notify_all()
        self._on_rest()

    def _check_later(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(CHECK_PERIOD_S, self._check)

    def _stop_polling(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _check(self) -> None:
        if self._since is None:
            return
        now = _now()
        self._checks += 1
        waited = self._checks * CHECK_PERIOD_S
        self._check_later()
        if self._moves() and self._robot.sample is not None and waited >= BRAKING_TIMEOUT_S:
            self.raise_alarm(f'the arm is still moving {BRAKING_TIMEOUT_S:g} s after STOP')
        elif self._unsent is None and self._powered():
            if self._rejection is not None:
                if (self._checks - self._rejected_check) * CHECK_PERIOD_S > CAUSE_TIMEOUT_S:
                    self.raise_alarm(f'the controller refused STOP ({self._rejection})')
            elif not self._acknowledged and waited >= ANSWER_TIMEOUT_S:
                self.raise_alarm(f'no reply to STOP within {ANSWER_TIMEOUT_S:g} s')
        if not self._ours or not self._moves():
            return
        failed = self._alarm_since is not None
        if (failed or self._unsent is not None) and now - self._sent >= STOP_REPEAT_PERIOD_S:
            self.stop()
        if (
            self._alarm_since is not None
            and self._powered()
            and now - self._alarm_since >= MOTORS_OFF_DELAY_S
            and not self._motors.missing
            and (self._switching is None or self._switching.done())
        ):
            self._switching = asyncio.create_task(self._keep_switching_off())
            self._switching.add_done_callback(report_task_error)

    async def _keep_switching_off(self) -> None:
        self._keep_switching = True
        while not await self._switch_off(MOTORS_OFF_TIMEOUT_S):
            await asyncio.sleep(CHECK_PERIOD_S)
            if not (self._keep_switching and self._powered()):
                return  # `_check` tries again if the arm moves

    async def _switch_off(self, timeout: float) -> bool:
        try:
            await self._motors.act(Action.MOTORS_OFF, timeout)
        except MotorsError as error:
            text = f'{self.arm_state} after STOP, and the motors were not switched off: {error}'
            if text != self._reported:
                _log.error(text)
            self._reported = text
            return False
        _log.error('the arm moved in spite of STOP: motors switched off')
        return True

    def _powered(self) -> bool:
        """Return False if STATUS reports that the motors are off. Without STATUS, return True."""
        status = self._robot.status
        return status is None or status.drives_powered != TriState.FALSE

    def _moves(self) -> bool:
        """Return whether the arm moves. Without joints, assume so until STOP is acknowledged."""
        sample = self._robot.sample
        if sample is None:
            return not self._acknowledged
        fast = bool(np.any(np.abs(sample.velocities) >= self.stopped_velocity))
        return fast or self._robot.in_motion == TriState.TRUE


def _now() -> float:
    return asyncio.get_running_loop().time()
