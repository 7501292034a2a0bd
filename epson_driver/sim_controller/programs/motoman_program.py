# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's program on the motion port: MOTION_CTRL commands and JOINT_TRAJ_PT_FULL points.

The rules (MotoROS 1.9):
* Every message except a reply is answered immediately with a MOTION_REPLY. Its header contains
  SUCCESS, and its `result` the outcome. PING has a separate reply. STATUS, JOINT_FEEDBACK and
  MOTION_REPLY, which MotoROS does not serve at this port, end the connection.
* Points are only accepted in trajectory mode. START_TRAJ_MODE turns it on, resets an alarm and
  switches the servos on. The E-stop, a pause and the key switch need an operator. The mode ends
  with STOP_TRAJ_MODE and when the servos switch off, but not with the connection.
* Without a client the arm stops. The servos, the mode and the points accepted by the arm remain.
  Only waiting points are discarded. The arm resumes when the next client connects.
* Point 0 must match the current position, and moves nothing. Each later point has the next
  sequence and a later time, at which the arm reaches the point. All points need time, position and
  velocity.
* BUSY: the queue has no room for the point. It has no effect, and the client sends it again.
* INVALID: the point is wrong and has no effect. The arm completes the points before it.
* STOP_MOTION brakes and discards all points, in every condition. The mode remains. The next point
  must be a point 0, sent when the arm is at rest.

Differences from MotoROS:

* MotoROS interpolates position and velocity. Here the arm moves through the positions as in any
  other profile. Velocities are only checked against the limits, and accelerations are ignored.
* CHECK_QUEUE_CNT counts the waiting points, plus one while the arm moves, instead of the
  interpolation steps. It is 0 when the motion is complete.
* STOP_SERVOS is answered immediately. MotoROS waits until the power is off.
* After a pause the arm continues to the same points. MotoROS needs START_TRAJ_MODE again.
* Only group 0 exists. Sequences that skip or repeat, which MotoROS does not check, are INVALID,
  and so are messages that are not requests.
* RESET_ALARM also resets an E-stop that was released, like a reset of this controller.
"""

import logging
from collections import deque
from collections.abc import Callable
from typing import Literal

import numpy as np

from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.condition.errors import clipped
from epson_driver.sim_controller.condition.states import Event, Fault, RejectedError
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports import Program, answer
from epson_driver.sim_controller.programs.motoman_points import (
    InvalidReason,
    TrajectoryMode,
    invalid_form,
    invalid_next,
    invalid_start,
)
from epson_driver.simple_message import (
    BodyError,
    ByteOrder,
    CommType,
    Frame,
    HeaderError,
    JointTrajPtFull,
    MessageType,
    MotionCtrl,
    MotionReply,
    Packet,
    Real,
    ReplyCode,
    decode,
    reply,
)
from epson_driver.simple_message.motoman import Command, Invalid, Result


def success(packet: Packet) -> MotionReply:
    """Return the reply to a message, with SUCCESS and the message's group, sequence and command.

    If the message has no command, the reply contains the message type instead. A missing group or
    sequence is -1.
    """
    message = packet.message
    if isinstance(message, MotionCtrl):
        return MotionReply(message.robot_id, message.sequence, message.command, Result.SUCCESS)
    if isinstance(message, JointTrajPtFull):
        return MotionReply(message.robot_id, message.sequence, packet.msg_type, Result.SUCCESS)
    return unreadable(packet.msg_type)


def unreadable(msg_type: int) -> MotionReply:
    return MotionReply(-1, -1, msg_type, Result.SUCCESS)


def too_short(frame: Frame) -> MotionReply:
    """Return the SUCCESS reply to a message whose body is too short. Missing fields are 0."""
    if frame.msg_type not in (MessageType.MOTION_CTRL, MessageType.JOINT_TRAJ_PT_FULL):
        return unreadable(frame.msg_type)
    order: Literal['big', 'little'] = 'big' if frame.byte_order is ByteOrder.BIG else 'little'
    words = frame.body[:12].ljust(12, b'\0')
    group, sequence, command = (
        int.from_bytes(words[offset : offset + 4], order, signed=True) for offset in (0, 4, 8)
    )
    if frame.msg_type == MessageType.JOINT_TRAJ_PT_FULL:
        command = frame.msg_type
    return MotionReply(group, sequence, command, Result.SUCCESS)


def outcome(reply: MotionReply, result: Result, subcode: int = 0) -> MotionReply:
    return MotionReply(reply.robot_id, reply.sequence, reply.command, result, subcode)


def invalid(reply: MotionReply, reason: InvalidReason) -> MotionReply:
    name = reason.subcode.name
    _log.warning('refused (%d, INVALID %s): %s', reason.subcode, name, reason.sentence)
    return outcome(reply, Result.INVALID, reason.subcode)


_log = logging.getLogger(__name__)

_NOT_SERVED = (MessageType.STATUS, MessageType.JOINT_FEEDBACK, MessageType.MOTION_REPLY)
"""Types of messages that end the connection, because MotoROS does not serve them here."""

_Command = Callable[[MotionReply], MotionReply | None]
"""Function that executes a command.

Its argument is the reply for success. It returns the reply to send, or None.
"""


class MotomanProgram(Program):
    """The program of a Motoman controller.

    If `motion.pending_limit` points are waiting, further points get BUSY.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._arm = controller.arm.executor
        self._pending_limit = controller.profile.motion.pending_limit
        self._send = controller.send_reply
        self._mode = TrajectoryMode(controller)
        self.paused = False
        # The sequence and the time of the last accepted point, or None before a point 0.
        self._last: tuple[int, float] | None = None
        self._waiting: deque[Point] = deque()
        self._commands: dict[int, _Command] = {
            Command.CHECK_MOTION_READY: self._check_motion_ready,
            Command.CHECK_QUEUE_CNT: self._check_queue_count,
            Command.STOP_MOTION: self._stop_motion,
            Command.START_SERVOS: self._start_servos,
            Command.STOP_SERVOS: self._stop_servos,
            Command.RESET_ALARM: self._reset_alarm,
            Command.START_TRAJ_MODE: self._start_trajectory_mode,
            Command.STOP_TRAJ_MODE: self._stop_trajectory_mode,
            Command.DISCONNECT: self._disconnect,
        }

    @property
    def ready(self) -> bool:
        return self._mode.missing() is None

    def receive(self, frame: Frame) -> None:
        try:
            packet = decode(frame)
        except (HeaderError, BodyError) as error:
            self._reject_corrupt(frame, error)
            return
        if packet.comm_type is CommType.SERVICE_REPLY:
            return
        if packet.msg_type == MessageType.PING:
            response = answer(packet, {})
            if response is not None:
                self._send(response)
        elif packet.msg_type in _NOT_SERVED:
            _log.warning('message type %d is not served: disconnected', packet.msg_type)
            self._controller.clients.hang_up('motion')
        else:
            self._answer(self._execute(packet))

    def step(self, dt: float) -> None:
        time_left: float | None = dt
        while time_left is not None:
            time_left = self._arm.step(time_left)
            self._feed()
            if not self._arm.moving:
                return

    def abort(self) -> None:
        self._stop()
        self._mode.end()

    def restart(self) -> None:
        self.abort()

    def detach(self) -> None:
        """Discard the waiting points. The mode and the points accepted by the arm remain."""
        self._waiting.clear()

    def pause(self) -> None:
        """Supply no more points to the arm. New points get NOT_READY, HOLD."""
        self.paused = True

    def resume(self) -> None:
        self.paused = False
        self._feed()

    def _execute(self, packet: Packet) -> MotionReply | None:
        message, done = packet.message, success(packet)
        if not isinstance(message, MotionCtrl | JointTrajPtFull):
            sentence = f'message type {packet.msg_type} is unknown to this program'
            return invalid(done, InvalidReason(Invalid.MSGTYPE, sentence))
        if packet.comm_type is not CommType.SERVICE_REQUEST:
            sentence = f'it must be a request, not a {packet.comm_type.name.lower()}'
            return invalid(done, InvalidReason(Invalid.MSGHEADER, sentence))
        if packet.dialect.real is not Real.FLOAT32:
            return invalid(done, InvalidReason(Invalid.MSGSIZE, 'its reals must be float32'))
        if isinstance(message, MotionCtrl):
            return self._commands.get(message.command, _unknown)(done)
        return self._receive_point(message, done)

    # Points.

    def _receive_point(self, point: JointTrajPtFull, done: MotionReply) -> MotionReply:
        missing = self._mode.missing()
        if missing is not None:
            return outcome(done, Result.NOT_READY, missing)
        reason = invalid_form(point) or self._invalid_sequence(point.sequence)
        if reason is not None:
            return invalid(done, reason)
        if point.sequence == 0 or self._last is None:
            return self._start_trajectory(point, done)
        if not self._arm.has_room and len(self._waiting) >= self._pending_limit:
            return outcome(done, Result.BUSY)
        return self._append(point, self._last[1], done)

    def _invalid_sequence(self, sequence: int) -> InvalidReason | None:
        following = None if self._last is None else self._last[0] + 1
        if sequence in (0, following):
            return None
        expected = '0' if following is None else f'{following}, or 0 for a new trajectory'
        return InvalidReason(Invalid.SEQUENCE, f'sequence = {sequence}: must be {expected}')

    def _start_trajectory(self, point: JointTrajPtFull, done: MotionReply) -> MotionReply:
        if self._arm.moving:
            return invalid(done, InvalidReason(Invalid.DATA_START_POS, 'the arm is still moving'))
        reason = invalid_start(point, self._arm.position, self._arm.limits)
        if reason is not None:
            return invalid(done, reason)
        self._last = (0, point.time)
        self._controller.trajectory_starts()
        return done

    def _append(self, point: JointTrajPtFull, before: float, done: MotionReply) -> MotionReply:
        limits = self._arm.limits
        reason = invalid_next(point, before, limits)
        if reason is not None:
            return invalid(done, reason)
        self._last = (point.sequence, point.time)
        target = clipped(np.array(point.positions[: len(limits.names)]), limits)
        self._waiting.append(Point(point.sequence, target, 0.0, point.time - before))
        self._feed()
        return done

    def _feed(self) -> None:
        while self._waiting and not self.paused and self._arm.has_room:
            self._arm.take(self._waiting.popleft())

    def _stop(self) -> None:
        self._arm.stop()
        self._waiting.clear()
        self._last = None

    # Commands. Each gets a reply with SUCCESS, and returns the reply to send.

    def _check_motion_ready(self, done: MotionReply) -> MotionReply:
        missing = self._mode.missing()
        return done if missing is None else outcome(done, Result.FAILURE, missing)

    def _check_queue_count(self, done: MotionReply) -> MotionReply:
        if done.robot_id != 0:
            return outcome(done, Result.FAILURE, -1)
        return outcome(done, Result.SUCCESS, len(self._waiting) + self._arm.moving)

    def _stop_motion(self, done: MotionReply) -> MotionReply:
        self._stop()
        return done

    def _start_servos(self, done: MotionReply) -> MotionReply:
        return self._apply(Event.MOTORS_ON, done)

    def _stop_servos(self, done: MotionReply) -> MotionReply:
        self._stop()
        return self._apply(Event.MOTORS_OFF, done)

    def _reset_alarm(self, done: MotionReply) -> MotionReply:
        self._controller.errors.clear()
        condition = self._controller.condition
        if condition.fault is Fault.NONE and not condition.estopped:
            return done
        return self._apply(Event.RESET, done)

    def _start_trajectory_mode(self, done: MotionReply) -> MotionReply:
        missing = self._mode.start()
        return done if missing is None else outcome(done, Result.NOT_READY, missing)

    def _stop_trajectory_mode(self, done: MotionReply) -> MotionReply:
        if self._arm.moving or self._waiting:
            return outcome(done, Result.FAILURE)
        self.abort()
        return done

    def _disconnect(self, done: MotionReply) -> MotionReply | None:
        response = self._stop_trajectory_mode(done)
        if response.result != Result.SUCCESS:
            return response
        self._controller.clients.hang_up('motion')
        return None

    def _apply(self, event: Event, done: MotionReply) -> MotionReply:
        try:
            self._controller.apply(event)
        except RejectedError as error:
            _log.warning('%s: %s', Command(done.command).name, error)
            return outcome(done, Result.FAILURE)
        return done

    # Replies.

    def _reject_corrupt(self, frame: Frame, error: HeaderError | BodyError) -> None:
        if frame.comm_type == CommType.SERVICE_REPLY:
            return
        done, subcode = too_short(frame), Invalid.MSGSIZE
        if isinstance(error, HeaderError):
            done = unreadable(frame.msg_type)
            subcode = Invalid.MSGTYPE if error.field == 'msg_type' else Invalid.MSGHEADER
        self._answer(invalid(done, InvalidReason(subcode, str(error))))

    def _answer(self, response: MotionReply | None) -> None:
        if response is not None:
            self._send(reply(response, ReplyCode.SUCCESS))


def _unknown(done: MotionReply) -> MotionReply:
    return invalid(done, InvalidReason(Invalid.COMMAND, f'command = {done.command} is unknown'))
