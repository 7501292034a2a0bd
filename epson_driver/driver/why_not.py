# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Determines why the arm may not move, for enabling, goals, streams, diagnostics and the API.

InhibitTable.ROWS lists all possible reasons in order, each with the purposes that it inhibits.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

from epson_driver.driver.channel import Channel
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.inhibit import (
    PAUSED,
    Cause,
    Inhibit,
    Purpose,
    flags_inhibit,
    main_ended,
    manual_inhibit,
    not_enabled,
    status_inhibit,
)
from epson_driver.driver.remedy import Remedy
from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.state.robot_state import RobotState
from epson_driver.driver.stopping.arm_gate import ArmGate
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.link import Link
from epson_driver.link.connection import CLOSED
from epson_driver.link.link_reports import MAX_SHORT, TURNED_AWAY
from epson_driver.remote_ethernet.client import RemoteError, RemoteErrorNumber
from epson_driver.simple_message import Mode, Status

STATUS_TIMEOUT_S = 1.0  # maximum age: an EPSON controller sends one every 55 ms

Check = Callable[['InhibitTable', float], Inhibit | None]
"""check(table, now) returns the inhibit that applies at `now` (event loop time, s), or None."""


@dataclass(eq=False)
class InhibitTable:
    """Determines whether the arm may move. `second`: another process has the same ROS names."""

    channel: Channel
    robot: RobotState
    gate: ArmGate
    stopper: Stopper
    state_timeout: float
    connects_later: Callable[[], bool]
    second: Inhibit | None = None
    goals: GoalQueue = field(init=False)  # set by the driver, as they ask this table
    servo: Servo = field(init=False)

    def __call__(self, purpose: Purpose, now: float) -> Inhibit | None:
        results = (check(self, now) for check, purposes in self.ROWS if purpose in purposes)
        return next((inhibit for inhibit in results if inhibit is not None), None)

    @property
    def _status(self) -> Status:
        return self.robot.status or Status()

    @property
    def _refusal(self) -> Inhibit | None:
        """Why the last attempt to enable failed, unless the key switch was the reason."""
        result = self.gate.refusal
        turned = self._status.mode == Mode.AUTO
        return None if result and result.cause is Cause.MANUAL_MODE and turned else result

    def _no_streams(self, _now: float) -> Inhibit | None:
        why = self.stopper.delivery.no_streams or self.goals.why_no_stream
        return _reported(Cause.NO_STREAMS, why or None)

    def _goal_runs(self, _now: float) -> Inhibit | None:
        text = 'another motion runs or waits: wait for its end, or cancel it first'
        return _reported(Cause.GOAL_RUNS, None if self.goals.idle else text)

    def _state_link_down(self, _now: float) -> Inhibit | None:
        return self._link_down(self.channel.state_link, Cause.NO_STATE_LINK)

    def _motion_link_down(self, _now: float) -> Inhibit | None:
        return self._link_down(self.channel.motion_link, Cause.NO_MOTION_LINK)

    def _link_down(self, link: Link, cause: Cause) -> Inhibit | None:
        if link.connected:
            return None
        state = link.state.value.replace('_', ' ')
        if cause is Cause.NO_MOTION_LINK and self.connects_later():
            state = 'waiting for joints, which show the byte order'
        remedy = link_remedy(link)
        if remedy is Remedy.END_CLIENT:
            state = f'{CLOSED} immediately: {TURNED_AWAY}'
        text = f'the {link.name} link to {link.host}:{link.port} is {state}'
        return Inhibit(cause, remedy, f'no link to the controller: {text}')

    def _no_joints(self, now: float) -> Inhibit | None:
        sample = self.robot.sample
        if self.robot.joints_unavailable:
            return None
        measured = None if sample is None else sample.measured
        return _silence(Cause.NO_JOINTS, 'joint state', now, measured, self.state_timeout)

    def _no_status(self, now: float) -> Inhibit | None:
        arrival = None if self.robot.status is None else self.robot.status_time
        return _silence(Cause.NO_STATUS, 'STATUS', now, arrival, STATUS_TIMEOUT_S)

    def _stop_fails(self, now: float) -> Inhibit | None:
        return None if self.stopper.over else self._stop_failed(now)

    def _stop_failed(self, _now: float) -> Inhibit | None:
        if self.stopper.alarm is None:
            return None
        text = f'STOP failed: {self.stopper.alarm}, {self.stopper.arm_state}'
        return Inhibit(Cause.STOP_FAILED, Remedy.KEEP_AWAY, text)

    def _condition(self, _now: float) -> Inhibit | None:
        """Return why the arm cannot be enabled: a second driver, or the controller's state."""
        if self.second is not None:
            return self.second
        status, errors = self._status, self.robot.errors
        result = status_inhibit(status, errors)
        if result is not None and result.cause is not Cause.MOTORS_OFF:
            return result
        return flags_inhibit(self.channel.state_link.flags, status.error_code, errors)

    def _not_enabled(self, _now: float) -> Inhibit | None:
        reason = self.gate.reason
        if reason is None:
            return None
        return manual_inhibit(self._status) or not_enabled(reason, self._refusal)

    def _closed(self, now: float) -> Inhibit | None:
        """Return why the arm was disabled, with what prevents enabling it now. None if enabled."""
        if self.gate.reason is None:
            return None
        reason, result = self.gate.reason, self(Purpose.REPORT, now)
        if result is None or result.cause is Cause.NOT_ENABLED:
            return not_enabled(reason, self._refusal)
        if result.reason in reason:
            text = not_enabled(reason.replace(result.reason, result.text)).text
        else:
            text = f'{not_enabled(reason).text}: {result.text}'
        return replace(result, text=text)

    def _motors_off(self, _now: float) -> Inhibit | None:
        return status_inhibit(self._status, self.robot.errors)

    def _stopping(self, _now: float) -> Inhibit | None:
        return _reported(Cause.STOPPING, None if self.stopper.over else 'the arm is being stopped')

    def _stop_requested(self, _now: float) -> Inhibit | None:
        return _reported(Cause.STOPPING, next(iter(self.goals.stops), None))

    def _stream(self, _now: float) -> Inhibit | None:
        return _reported(Cause.STREAM, self.servo.active_user(), Remedy.END_STREAM)

    def _no_pose(self, now: float) -> Inhibit | None:
        return _reported(Cause.NO_POSE, self.robot.why_not_ready(now))

    def _denied(self, _now: float) -> Inhibit | None:
        if self.robot.main_ended:
            return main_ended(self._status, self.robot.errors)
        return PAUSED if self.robot.paused else None

    def _denied_to_goals(self, now: float) -> Inhibit | None:
        return None if self.stopper.delivery.resumes else self._denied(now)

    def _ended(self, now: float) -> Inhibit | None:
        """Return the inhibit if the SPEL+ program ended during a motion, else None."""
        ended = self.robot.main_ended and (self.goals.busy or self.servo.active)
        return self._denied(now) if ended else None

    def _moves(self, _now: float) -> Inhibit | None:
        why = self.robot.why_not_at_rest(self.stopper.stopped_velocity)
        return _reported(
            Cause.MOVES, why and f'the arm is moving ({why}): wait until it is at rest'
        )

    _START = Purpose.START | Purpose.STREAM

    ROWS: ClassVar[tuple[tuple[Check, Purpose], ...]] = (
        (_no_streams, Purpose.STREAM),
        (_goal_runs, Purpose.STREAM | Purpose.ALONE),
        (_closed, Purpose.GOAL | Purpose.READY | _START | Purpose.FOLLOW | Purpose.LET_GO),
        (_state_link_down, Purpose.REPORT | Purpose.COMMAND | Purpose.OPEN),
        (_no_joints, Purpose.REPORT),
        (_no_status, Purpose.REPORT | Purpose.OPEN),
        (_stop_fails, Purpose.REPORT),
        (_motion_link_down, Purpose.REPORT | Purpose.COMMAND | Purpose.OPEN),
        (_condition, Purpose.REPORT | Purpose.ENABLE | Purpose.OPEN | Purpose.RUN),
        (_stop_failed, Purpose.REPORT),
        (_not_enabled, Purpose.REPORT),
        (_motors_off, Purpose.REPORT | Purpose.OPEN | Purpose.RUN),
        (_stopping, Purpose.STREAM | Purpose.FOLLOW | Purpose.RESUME),
        (_stop_requested, Purpose.GOAL | Purpose.READY | _START),
        (_stream, Purpose.GOAL | Purpose.READY | _START),
        (_no_pose, Purpose.OPEN | Purpose.READY | _START),
        (_ended, Purpose.RUN),
        (_denied, Purpose.REPORT | Purpose.FOLLOW | Purpose.LET_GO | Purpose.RESUME),
        (_denied_to_goals, Purpose.READY | _START),
        (_moves, _START),
    )
    """Pairs of a check and the purposes it inhibits, in the order in which to fix the causes."""


def link_remedy(link: Link) -> Remedy:
    failure = link.failure
    if isinstance(failure, RemoteError) and failure.number in _NEED_PASSWORD:
        return Remedy.FIX_LOGIN
    return Remedy.END_CLIENT if link.turned_away >= MAX_SHORT else Remedy.CONNECT


_NEED_PASSWORD = (RemoteErrorNumber.PASSWORD, RemoteErrorNumber.PASSWORD_NEEDED)


def _silence(
    cause: Cause, what: str, now: float, newest: float | None, timeout: float
) -> Inhibit | None:
    if newest is None:
        return Inhibit(cause, Remedy.CHECK_STATE_SERVER, f'no {what}')
    if now - newest < timeout:
        return None
    text = f'no {what} for {now - newest:.1f} s'
    return Inhibit(cause, Remedy.CHECK_STATE_SERVER, text)


def _reported(cause: Cause, text: str | None, remedy: Remedy = Remedy.NONE) -> Inhibit | None:
    return None if text is None else Inhibit(cause, remedy, text)
