# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller without its sockets and its clock.

What a person does (motors, E-stop, reset), what the motion client sends, and time all come in as
calls; state and reply bytes come out. The same calls give the same bytes.
"""

import copy
import logging
from collections.abc import Callable

import numpy as np

from epson_driver.controller.errors import ErrorNumber, ErrorRegister, Refusal
from epson_driver.controller.executor import Executor
from epson_driver.controller.motion_program import MotionProgram
from epson_driver.controller.point_to_point import PointToPoint
from epson_driver.controller.points import clipped
from epson_driver.controller.profile import ControllerProfile
from epson_driver.controller.states import (
    ESTOP_CONDITIONS,
    POWERED_CONDITIONS,
    Condition,
    Event,
    RefusedError,
    after,
)
from epson_driver.controller.streaming import Planner, Streaming
from epson_driver.controller.timing import Timing
from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.simple_message import (
    Dialect,
    FrameError,
    Framer,
    JointPosition,
    Packet,
    Status,
    TriState,
    encode,
    joint_data,
)

_log = logging.getLogger(__name__)

Send = Callable[[bytes], None]

_NO_MOTION = {
    Condition.MOTORS_OFF: Refusal(
        ErrorNumber.MOTORS_OFF, 'the motors are off: switch the motors on'
    ),
    Condition.STOPPING: Refusal(ErrorNumber.MOTORS_OFF, 'the motors are going off'),
    Condition.ESTOP_PRESSED: Refusal(
        ErrorNumber.TASK_ABORTED, 'the E-stop is pressed: release it, reset, motors on'
    ),
    Condition.ESTOP_LATCHED: Refusal(
        ErrorNumber.TASK_ABORTED, 'the E-stop is released but not reset: reset, motors on'
    ),
}
"""Why a point is refused in a condition; motion is possible in the one that is missing."""

_NO_PLANNER = Refusal(
    ErrorNumber.PLANNER_FAILED, 'the motion planner starts again: try again in a second'
)


class Controller:
    """Motors, E-stop, arm and motion program of one controller.

    `start` is where the arm stands at first, shape (n,), rad: zeros by default, or the nearest
    within the limits. With a `planner` the arm moves smoothly, without one point to point.
    `timing` counts what came too late. Raises ValueError for a start outside the limits.
    """

    def __init__(
        self,
        model: RobotModel,
        profile: ControllerProfile,
        start: Array | None = None,
        dialect: Dialect | None = None,
        planner: Planner | None = None,
    ) -> None:
        limits = model.limits
        if start is None:
            start = clipped(np.zeros(len(limits.names)), limits)
        self.profile = profile
        self.dialect = dialect or Dialect(profile.byte_order)
        self.condition = Condition.MOTORS_OFF
        self.timing = Timing()
        self._told = Timing()
        self._errors = ErrorRegister()
        self._planner = planner
        self._arm: Executor
        if planner is None:
            self._arm = PointToPoint(limits, start, profile.speed, profile.accel)
        else:
            self._arm = Streaming(
                limits,
                start,
                planner,
                self.timing,
                self.planner_failed,
                profile.look_ahead,
                profile.look_ahead_points,
            )
        self._program = MotionProgram(
            self._arm, profile.pending_limit, self._errors, self._motion_refusal, self._reply
        )
        self._framer: Framer | None = None
        self._send: Send | None = None

    # The person at the controller. Each raises RefusedError, which says why and what to do.

    def motors_on(self) -> None:
        """Switch the motors on."""
        self._apply(Event.MOTORS_ON)

    def motors_off(self) -> None:
        """Switch the motors off; an arm that moves brakes first."""
        self._apply(Event.MOTORS_OFF)

    def estop_press(self) -> None:
        """Press the E-stop: brake, motors off, motion task aborted."""
        self._apply(Event.ESTOP_PRESS)

    def estop_release(self) -> None:
        """Release the E-stop's button. It stays latched."""
        self._apply(Event.ESTOP_RELEASE)

    def reset(self) -> None:
        """Clear the error and a released E-stop. The motors stay as they are."""
        if self.condition is Condition.ESTOP_LATCHED and self.moving:
            raise RefusedError('the arm still brakes: try again when it stands')
        self._apply(Event.RESET)

    # The motion client: at most one.

    def connected(self, send: Send) -> None:
        """Listen to a new client, whose replies `send` takes.

        Raises RuntimeError if there is one already.
        """
        if self._send is not None:
            raise RuntimeError('there is a motion client already')
        self._framer = Framer(self.dialect.byte_order)
        self._send = send
        self._program.restart()

    def receive(self, data: bytes) -> None:
        """Take bytes from the client, in any segmentation.

        Raises FrameError when the position in the stream is lost: the client counts as lost then,
        and its connection must be closed.
        """
        if self._framer is None:
            raise RuntimeError('there is no motion client')
        self._framer.receive_data(data)
        try:
            while (frame := self._framer.next_frame()) is not None:
                self._program.receive(frame)
        except FrameError as error:
            self._errors.enter(Refusal(ErrorNumber.CORRUPT_MESSAGE, str(error)))
            self.disconnected()
            raise

    def disconnected(self) -> None:
        """Take note that the client is gone: brake, motors off."""
        if self._send is None:
            return
        self._apply(Event.CLIENT_LOST)
        self._framer = None
        self._send = None

    # Time and state.

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass."""
        moved = self.moving
        self._program.step(dt)
        if moved and not self._arm.moving:
            self._apply(Event.STANDSTILL)
            self._tell_timing()

    def planner_failed(self, reason: str) -> None:
        """Take note that nobody plans: brake and end the trajectory, without a planner's help."""
        self.timing.planner_failures += 1
        self._errors.enter(Refusal(ErrorNumber.PLANNER_FAILED, f'the motion planner: {reason}'))
        self._program.restart()

    @property
    def moving(self) -> bool:
        """Whether the arm moves, or is about to."""
        return self._arm.moving

    @property
    def error_number(self) -> ErrorNumber:
        """The error shown in STATUS; through an E-stop, that the motion task is aborted."""
        if self.condition in ESTOP_CONDITIONS:
            return ErrorNumber.TASK_ABORTED
        return self._errors.number

    def joint_position(self) -> JointPosition:
        """Return where the joints are now."""
        return JointPosition(0, joint_data(self._arm.position.tolist()))

    def status(self) -> Status:
        """Return what STATUS says now."""
        error = self.error_number
        return Status(
            drives_powered=_tri_state(self.condition in POWERED_CONDITIONS),
            e_stopped=_tri_state(self.condition in ESTOP_CONDITIONS),
            error_code=error,
            in_error=_tri_state(error is not ErrorNumber.NONE),
            in_motion=_tri_state(self.moving),
            mode=self.profile.mode,
            motion_possible=_tri_state(
                self.condition is Condition.MOTORS_ON and error is ErrorNumber.NONE
            ),
        )

    def _apply(self, event: Event) -> None:
        before = self.condition
        self.condition = after(before, event)
        if self.condition is not before:
            _log.info('%s: %s → %s', event.value, before.value, self.condition.value)
        if event is Event.ESTOP_PRESS:
            self._program.restart()
        elif before is Condition.MOTORS_ON and self.condition is not before:
            self._program.abort()
        if event is Event.RESET:
            self._errors.clear()
        elif event is Event.MOTORS_ON:
            self._errors.clear(ErrorNumber.MOTORS_OFF)
        if self.condition is Condition.STOPPING and not self.moving:
            self._apply(Event.STANDSTILL)

    def _motion_refusal(self) -> Refusal | None:
        if self._planner is not None and not self._planner.ready:
            return _NO_MOTION.get(self.condition, _NO_PLANNER)
        return _NO_MOTION.get(self.condition)

    def _tell_timing(self) -> None:
        """Log what came too late in the motion that has ended."""
        sentence = self.timing.since(self._told)
        if sentence:
            _log.warning('in this motion: %s', sentence)
            self._told = copy.copy(self.timing)

    def _reply(self, packet: Packet) -> None:
        if self._send is not None:
            self._send(encode(packet, self.dialect))


def _tri_state(value: bool) -> TriState:
    return TriState.TRUE if value else TriState.FALSE
