# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port: the state sent by the clock, in every condition, and requests answered."""

from collections.abc import Callable, Iterator
from itertools import cycle
from typing import Protocol

from epson_driver.motion import Array
from epson_driver.profiles.profile import StateProfile
from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection
from epson_driver.sim_controller.condition.states import (
    REGIONS,
    Condition,
    EStop,
    Fault,
    Mode,
    Motors,
    Tasks,
)
from epson_driver.sim_controller.ports import Answers, Send, answer_frame
from epson_driver.simple_message import (
    Dialect,
    Framer,
    GetVersion,
    JointFeedback,
    JointPosition,
    Message,
    MessageType,
    Status,
    TriState,
    ValidFields,
    encode,
    joint_data,
    topic,
)
from epson_driver.simple_message import Mode as StatusMode

NO_MOTION: dict[EStop | Fault | Tasks | Mode | Motors, Rejection] = {
    EStop.PRESSED: Rejection(
        ErrorNumber.TASK_ABORTED, 'the E-stop is pressed: release it, reset, motors on'
    ),
    EStop.LATCHED: Rejection(
        ErrorNumber.TASK_ABORTED, 'the E-stop is released but not reset: reset, motors on'
    ),
    Fault.CRITICAL: Rejection(
        ErrorNumber.TASK_ABORTED, 'a critical error aborted the motion task: boot the controller'
    ),
    Fault.ERROR: Rejection(
        ErrorNumber.TASK_ABORTED, 'an error aborted the motion task: reset, motors on'
    ),
    Tasks.STOPPED: Rejection(ErrorNumber.TASK_ABORTED, 'the motion task is stopped: start it'),
    Mode.MANUAL: Rejection(
        ErrorNumber.MOTORS_OFF, 'the key switch is at MANUAL: turn it to AUTO, motors on'
    ),
    Motors.OFF: Rejection(ErrorNumber.MOTORS_OFF, 'the motors are off: switch the motors on'),
    Motors.BRAKING: Rejection(ErrorNumber.MOTORS_OFF, 'the motors are going off'),
}
"""Why a point is refused, the first that applies; points that come in a pause wait."""

_MODES = {Mode.AUTO: StatusMode.AUTO, Mode.MANUAL: StatusMode.MANUAL}


def motion_rejection(condition: Condition) -> Rejection | None:
    """Return why the condition forbids motion, or None."""
    states = {getattr(condition, region) for region in REGIONS}
    return next((rejection for state, rejection in NO_MOTION.items() if state in states), None)


def joint_position(position: Array) -> JointPosition:
    """Return the message that the joints are at `position`, shape (n,), rad."""
    return JointPosition(0, joint_data(position.tolist()))


def joint_feedback(position: Array, velocity: Array, now: float | None) -> JointFeedback:
    """Return the JOINT_FEEDBACK of positions and velocities.

    position, velocity: shape (n,), rad, rad/s; now: the controller's time, s; None: not told.
    """
    fields = ValidFields.POSITION | ValidFields.VELOCITY
    return JointFeedback(
        0,
        fields if now is None else fields | ValidFields.TIME,
        0.0 if now is None else now,
        joint_data(position.tolist()),
        joint_data(velocity.tolist()),
    )


def status(
    condition: Condition,
    error: int,
    told: StateProfile,
    *,
    in_motion: bool,
    accepts_points: bool,
) -> Status:
    """Return the status of a controller that shows `error`.

    accepts_points: whether it would take a point in its condition. What the profile does not tell
    is UNKNOWN.
    """
    none = error == ErrorNumber.NONE
    possible = condition.tasks is Tasks.RUNNING and none and accepts_points
    return Status(
        drives_powered=_tri_state(condition.powered),
        e_stopped=_tri_state(condition.estopped),
        error_code=error,
        in_error=_tri_state(not none),
        in_motion=_tri_state(in_motion) if told.in_motion else TriState.UNKNOWN,
        mode=_MODES[condition.mode],
        motion_possible=_tri_state(possible) if told.motion_possible else TriState.UNKNOWN,
    )


def _tri_state(value: bool) -> TriState:
    return TriState.TRUE if value else TriState.FALSE


MAX_CATCH_UP_SLOTS = 200
"""So many slots are made up for at once when the process was not scheduled, 1 s at 200 Hz.

A controller measures in each of its cycles; what its simulation sends late is still the state of
the slot's own time. A process that stood still for longer leaves out what is older: a client
needs none of it, and sending it keeps the process from other things, 0.1 ms for each slot.
"""

_Slot = tuple[Callable[[], Message], ...]
"""What is sent in one slot of time."""


class StateSource(Protocol):
    """The controller, as the state port needs it."""

    def joint_position(self) -> JointPosition:
        """Return where the encoders say that the joints are."""

    def joint_feedback(self) -> JointFeedback:
        """Return where the joints are and how fast."""

    def status(self) -> Status:
        """Return the present STATUS."""

    def version(self) -> GetVersion:
        """Return which version the program is."""


class StateSession:
    """Sends one client the joints every `period` s, and a STATUS after some.

    What it sends is the state at that very time, also when the process gets there late.

    `profile` says which message has the joints, how many of them come before each STATUS, and
    whether that has a slot of its own.
    """

    def __init__(
        self,
        source: StateSource,
        profile: StateProfile,
        period: float,
        dialect: Dialect,
        clock: Clock,
        send: Send,
    ) -> None:
        self._dialect = dialect
        self._send = send
        self._framer = Framer(dialect.byte_order)
        feedback = profile.message == 'joint_feedback'
        joints = source.joint_feedback if feedback else source.joint_position
        self._answers: Answers = {
            MessageType.JOINT_POSITION: source.joint_position,
            MessageType.STATUS: source.status,
            MessageType.GET_VERSION: source.version,
        }
        slots: list[_Slot] = [(joints,)] * profile.joint_positions_per_status
        if profile.status_with_joints:
            slots[-1] = (joints, source.status)
        else:
            slots.append((source.status,))
        self._slots: Iterator[_Slot] = cycle(slots)
        self._timer = clock.every(period, self._tick, catch_up=MAX_CATCH_UP_SLOTS)
        self._open = True

    def receive(self, data: bytes) -> None:
        """Answer requests for the messages that are also sent by the clock. Raises FrameError."""
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            reply = answer_frame(frame, self._answers)
            if reply is not None:
                self._send(encode(reply, self._dialect))

    def closed(self) -> None:
        """Send nothing any more."""
        self._open = False
        self._timer.cancel()

    def _tick(self) -> None:
        for message in next(self._slots):
            self._send(encode(topic(message()), self._dialect))
