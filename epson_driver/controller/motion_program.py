# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The program on the motion port: points in, one move after the other, replies out.

The rules (REP-I0006 where it says something, the thesis' program otherwise):

* A point is a JOINT_TRAJ_PT request. Its sequence is 0, a new trajectory, or one more than the
  last point accepted. Point to point, the reply comes when the arm has come to rest at the point.
  In smooth motion it comes when there is room for the point in the look-ahead buffer; that is the
  flow control.
* Points that arrive before that wait; all are answered in the order they came.
* A refused point ends the motion: the arm brakes, all points that are not answered yet get
  FAILURE, then the refused one. A point answered with FAILURE does not count as accepted.
  If points that were answered already are lost with that, which only happens in smooth motion,
  the trajectory is over: the next point must have sequence 0, so that none is skipped.
* STOP (sequence -4) does the same in every condition, is answered with SUCCESS, and ends the
  trajectory: the next point must have sequence 0.
"""

from collections import deque
from collections.abc import Callable

from epson_driver.controller.errors import ErrorNumber, ErrorRegister, Refusal
from epson_driver.controller.executor import Executor, Point
from epson_driver.controller.points import limits_refusal, numbers_refusal, target_of
from epson_driver.controller.requests import answer, failure
from epson_driver.simple_message import (
    BodyError,
    CommType,
    Frame,
    HeaderError,
    JointPosition,
    JointTrajPt,
    MessageType,
    Packet,
    Real,
    ReplyCode,
    SpecialSequence,
    decode,
    reply,
)


class MotionProgram:
    """Has the points of one client executed, one after the other, and answers them.

    At most `pending_limit` points wait. `blocked` returns why the controller's condition forbids
    motion, or None; `send` takes the replies.
    """

    def __init__(
        self,
        arm: Executor,
        pending_limit: int,
        errors: ErrorRegister,
        blocked: Callable[[], Refusal | None],
        send: Callable[[Packet], None],
    ) -> None:
        self._arm = arm
        self._pending_limit = pending_limit
        self._errors = errors
        self._blocked = blocked
        self._send = send
        self._accepted: int | None = None
        self._current: Point | None = None
        self._waiting: deque[Point] = deque()

    def receive(self, frame: Frame) -> None:
        """Obey, queue or refuse one frame."""
        try:
            packet = decode(frame)
        except (HeaderError, BodyError) as error:
            self._refuse_corrupt(frame, error)
            return
        if packet.msg_type == MessageType.JOINT_TRAJ_PT:
            self._receive_point(packet)
        elif (response := answer(packet, {})) is not None:
            self._send(response)

    def step(self, dt: float) -> None:
        """Let `dt` s pass: the arm moves on, and from point to point without a pause."""
        left: float | None = dt
        while left is not None:
            left = self._arm.step(left)
            self._advance()
            if not self._arm.moving:
                return

    def abort(self) -> None:
        """Brake, and answer all points that are not answered yet with FAILURE."""
        lost = self._arm.stop()
        points = [] if self._current is None else [self._current]
        points += self._waiting
        self._current = None
        self._waiting.clear()
        if points:
            first = points[0].sequence
            self._accepted = first - 1 if first > 0 else None
        if lost:
            self._accepted = None
        for point in points:
            self._answer(point.sequence, ReplyCode.FAILURE)

    def restart(self) -> None:
        """Abort, and forget the trajectory: the next point must have sequence 0."""
        self.abort()
        self._accepted = None

    def _receive_point(self, packet: Packet) -> None:
        point = packet.message
        if not isinstance(point, JointTrajPt) or packet.dialect.real is not Real.FLOAT32:
            self._refuse(0, _corrupt('JOINT_TRAJ_PT: the body must be 52 bytes'))
        elif packet.comm_type is not CommType.SERVICE_REQUEST:
            sentence = f'JOINT_TRAJ_PT must be a request, not a {packet.comm_type.name.lower()}'
            self._refuse(point.sequence, _corrupt(sentence))
        elif point.sequence == SpecialSequence.STOP_TRAJECTORY:
            self.restart()
            self._answer(point.sequence, ReplyCode.SUCCESS)
        else:
            self._receive_request(point)

    def _receive_request(self, point: JointTrajPt) -> None:
        refusal = (
            self._blocked()
            or self._sequence_refusal(point)
            or numbers_refusal(point)
            or limits_refusal(point, self._arm.limits)
            or self._queue_refusal()
        )
        if refusal is not None:
            sentence = f'JOINT_TRAJ_PT {point.sequence}: {refusal.sentence}'
            self._refuse(point.sequence, Refusal(refusal.number, sentence))
            return
        self._errors.clear()
        self._accepted = point.sequence
        target = target_of(point, self._arm.limits)
        self._waiting.append(Point(point.sequence, target, point.velocity, point.duration))
        self._advance()

    def _sequence_refusal(self, point: JointTrajPt) -> Refusal | None:
        if point.sequence < 0:
            return _corrupt('of the negative sequences only -4 (STOP) is supported')
        following = None if self._accepted is None else self._accepted + 1
        if point.sequence in (0, following):
            return None
        expected = '0' if following is None else f'{following}, or 0 for a new trajectory'
        return _corrupt(f'out of sequence: it must be {expected}')

    def _queue_refusal(self) -> Refusal | None:
        if len(self._waiting) < self._pending_limit:
            return None
        return _corrupt(f'{len(self._waiting)} points wait already, the most that can')

    def _advance(self) -> None:
        """Answer the point that is done, and give the arm the next ones that it has room for."""
        while self._current is None or self._arm.done:
            if self._current is not None:
                self._answer(self._current.sequence, ReplyCode.SUCCESS)
                self._current = None
            if not self._waiting or not self._arm.has_room:
                return
            self._current = self._waiting.popleft()
            self._arm.take(self._current)

    def _refuse_corrupt(self, frame: Frame, error: HeaderError | BodyError) -> None:
        refusal = _corrupt(f'message type {frame.msg_type}: {error}')
        if frame.msg_type == MessageType.JOINT_TRAJ_PT:
            self._refuse(_sequence_of(frame), refusal)
            return
        self._errors.enter(refusal)
        if frame.msg_type > 0:
            self._send(failure(frame.msg_type))
        else:  # a reply of that type would be as invalid
            self._answer(0, ReplyCode.FAILURE)

    def _refuse(self, sequence: int, refusal: Refusal) -> None:
        self._errors.enter(refusal)
        self.abort()
        self._answer(sequence, ReplyCode.FAILURE)

    def _answer(self, sequence: int, code: ReplyCode) -> None:
        self._send(reply(JointPosition(sequence), code))


def _corrupt(sentence: str) -> Refusal:
    return Refusal(ErrorNumber.CORRUPT_MESSAGE, sentence)


def _sequence_of(frame: Frame) -> int:
    """Return the sequence in a JOINT_TRAJ_PT with a wrong header, 0 if the body is wrong too."""
    try:
        request = Frame(frame.msg_type, CommType.SERVICE_REQUEST, 0, frame.body, frame.byte_order)
        message = decode(request).message
    except BodyError:
        return 0
    return message.sequence if isinstance(message, JointTrajPt) else 0
