# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The built-in program for JOINT_TRAJ_PT: it executes points in order and answers them.

The rules (REP-I0006 where specified, otherwise the thesis' program):
* A point is a JOINT_TRAJ_PT request. Its sequence is 0 for a new trajectory, or one more than the
  sequence of the last accepted point. -2 (START_TRAJECTORY_STREAMING) is equivalent to 0, but
  smooth motion follows the points as setpoints instead of planning through them. In
  point-to-point motion, the reply follows when the arm is at rest at the point. In smooth motion
  it follows when the look-ahead buffer has room for the point, which provides the flow control.
* Points that arrive before the arm can take them wait. All points are answered in the order of
  arrival.
* A refused point ends the motion. The arm brakes. All unanswered points get FAILURE, and finally
  so does the refused point. None of these points counts as accepted. In smooth motion, points that
  were already answered may be lost, too. The next point must then have sequence 0.
* After a STOP (sequence -4) in any condition, the arm brakes, all unanswered points get FAILURE,
  and the STOP gets SUCCESS. The next point must have sequence 0.
* A sequence of -1 starts a download (download.py). Points sent as requests are answered when the
  program has processed them. Points sent as topics are never answered. A streamed point during a
  download ends the download, but points still in motion are completed first.
* Replies are ignored, and topics that belong to no download are not answered. Otherwise two peers
  could answer each other forever.
* If a client stalls (ClientWatchdog), the arm stops as after a STOP. A PING reply with FAILURE is
  sent before the replies to the points. Each later point gets FAILURE until a STOP.
* During a pause the arm gets no points, and no point is answered. Invalid points are still
  refused, and STOP works.

`ProgramProfile` documents how a profile can change these rules.
"""

import logging
from collections.abc import Callable

from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.condition.errors import (
    ErrorNumber,
    Rejection,
    corrupt,
)
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports import UNANSWERED, Program, answer, failure
from epson_driver.sim_controller.programs.download import FIRST, LAST, Download
from epson_driver.sim_controller.programs.point_queue import (
    Entry,
    PointQueue,
    as_point_frame,
    limits_rejection,
    numbers_rejection,
    sequence_of,
    target_of,
)
from epson_driver.simple_message import (
    BodyError,
    CommType,
    Frame,
    HeaderError,
    JointPosition,
    JointTrajPt,
    Message,
    MessageType,
    Opaque,
    Packet,
    Real,
    ReplyCode,
    SpecialSequence,
    decode,
    reply,
)

REPLIES: dict[str, Callable[[int], Message]] = {
    'sequence': JointPosition,
    'header': lambda sequence: Opaque(MessageType.JOINT_TRAJ_PT),
}


STOP = SpecialSequence.STOP_TRAJECTORY
STREAMING = SpecialSequence.START_TRAJECTORY_STREAMING

POINT_BODY_BYTES = {Real.FLOAT32: 52, Real.FLOAT64: 100}


_log = logging.getLogger(__name__)


def _name(point: JointTrajPt) -> str:
    return f'JOINT_TRAJ_PT {point.sequence}'


class MotionProgram(Program):
    """The program for JOINT_TRAJ_PT.

    Its queue holds at most `motion.pending_limit` points, or one download.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._arm = controller.arm.executor
        self._real = controller.dialect.real
        self._limits = self._arm.limits
        self._profile = profile = controller.profile.program
        self._pending_limit = controller.profile.motion.pending_limit
        self._errors = controller.errors
        self._blocked = controller.motion_rejection
        self._send = controller.send_reply
        self._used = FieldsUsed(profile.uses)
        self._reply = REPLIES[profile.reply]
        self.download = Download(profile.download)
        self._accepted: int | None = None
        self._topics = False  # whether the client downloads by topics, which are not answered
        # Refuses each point after the client has stalled.
        self._silence_rejection: Rejection | None = None
        self.queue = PointQueue(controller, self._answer_success, self._fail)

    def receive(self, frame: Frame) -> None:
        point_frame = as_point_frame(frame, self._profile.accepts, POINT_BODY_BYTES[self._real])
        if point_frame is None or point_frame.comm_type == CommType.SERVICE_REPLY:
            _log.warning('not answered: message type %d', frame.msg_type)
            return
        try:
            packet = decode(point_frame)
        except (HeaderError, BodyError) as error:
            self._reject_corrupt(point_frame, error)
            return
        if packet.msg_type == MessageType.JOINT_TRAJ_PT:
            self._receive_point(packet)
        elif (response := answer(packet, {})) is not None:
            self._send(response)

    def step(self, dt: float) -> None:
        self.queue.step(dt)

    def abort(self) -> None:
        entries, lost = self.queue.flush()
        self.download.reject()
        sequences = [  # None stands for a point of a download
            None if entry.reply_to is None else entry.point.sequence
            for entry in entries
            if entry.point is not None
        ]
        if sequences and self._accepted is not None:
            self._accepted = sequences[0] - 1 if sequences[0] else None
        if lost or None in sequences:
            self._accepted = None
        for entry in entries:
            self._answer(entry.reply_to, ReplyCode.FAILURE)

    def restart(self) -> None:
        self.abort()
        self.download.clear()
        self._accepted = None
        if self._silence_rejection is not None:
            self._errors.clear(self._silence_rejection.number)
            self._silence_rejection = None

    def client_silent(self, seconds: float) -> None:
        if not (self._arm.moving or len(self.queue) or len(self.download)):
            return
        self._send(failure(MessageType.PING))
        self.restart()
        sentence = f'the motion client was silent for {seconds:g} s: the arm was stopped'
        self._silence_rejection = Rejection(ErrorNumber.CLIENT_SILENT, sentence)
        self._errors.enter(self._silence_rejection)

    def detach(self) -> None:
        self.queue.detach()
        self.download.clear()
        self._topics = False
        self._accepted = None

    def pause(self) -> None:
        self.queue.paused = True

    def resume(self) -> None:
        self.queue.paused = False
        self.queue.advance()

    # Points.

    def _receive_point(self, packet: Packet) -> None:
        point = packet.message
        if not isinstance(point, JointTrajPt) or packet.dialect.real is not self._real:
            size = POINT_BODY_BYTES[self._real]
            sequence = 0 if packet.comm_type is CommType.SERVICE_REQUEST else None
            self._reject(sequence, corrupt(f'JOINT_TRAJ_PT: the body must be {size} bytes'))
        elif self._is_ignored(point.sequence):
            _log.warning('%s is not supported: ignored', _name(point))
        elif self._silence_rejection is not None and point.sequence != STOP:
            sequence = point.sequence if packet.comm_type is CommType.SERVICE_REQUEST else None
            self._reject(sequence, self._silence_rejection.about(_name(point)))
        elif point.sequence != STOP and self.download.concerns(point.sequence, packet.comm_type):
            self._receive_download(point, packet.comm_type)
        elif packet.comm_type is CommType.TOPIC and self._topics:
            self._errors.enter(corrupt('no download is active').about(_name(point)))
        elif packet.comm_type is CommType.TOPIC:
            if point.sequence == STOP and self._profile.accepts != 'exact':
                self._stop(None)
            else:
                self._reject(None, corrupt('JOINT_TRAJ_PT must be a request, not a topic'))
        elif point.sequence == STOP:
            self._stop(point.sequence)
        else:
            self._receive_request(point)

    def _is_ignored(self, sequence: int) -> bool:
        return sequence < 0 and self._profile.special_sequences == 'stop' and sequence != STOP

    def _stop(self, sequence: int | None) -> None:
        self.restart()
        self._answer(sequence, ReplyCode.SUCCESS)

    def _receive_request(self, point: JointTrajPt) -> None:
        self.download.clear()
        outside = limits_rejection(point, self._limits)
        late = self._profile.late_failure or not self._profile.check_limits
        rejection = (
            self._blocked()
            or self._sequence_rejection(point)
            or numbers_rejection(point, self._used)
            or (None if late else outside)
            or self._queue_rejection()
        )
        if rejection is not None:
            self._reject(point.sequence, rejection.about(_name(point)))
            return
        self._errors.clear()
        self._topics = False
        sequence = max(point.sequence, 0)
        starts = sequence == 0 or self._accepted is None
        self._accepted = sequence
        reason = None if outside is None else outside.about(_name(point))
        self.queue.append(Entry(self._point(point, sequence), point.sequence, starts, reason))
        self.queue.advance()

    def _sequence_rejection(self, point: JointTrajPt) -> Rejection | None:
        if point.sequence == LAST:
            return corrupt('no download is active')
        if point.sequence < 0 and point.sequence != STREAMING:
            return corrupt('a negative sequence must be -1 to -4')
        following = None if self._accepted is None else self._accepted + 1
        if point.sequence in (0, STREAMING, following) or not self._profile.check_sequence:
            return None
        expected = '0' if following is None else f'{following}, or 0 for a new trajectory'
        return corrupt(f'out of sequence: it must be {expected}')

    def _queue_rejection(self) -> Rejection | None:
        if len(self.queue) < self._pending_limit:
            return None
        return corrupt(f'{len(self.queue)} points are already pending, the maximum')

    def _point(self, point: JointTrajPt, sequence: int) -> Point:
        velocity = point.velocity if self._used.velocity else 0.0
        duration = point.duration if self._used.duration else 0.0
        setpoint = point.sequence == STREAMING
        target = target_of(point, self._limits)
        return Point(sequence, target, velocity, duration, setpoint=setpoint)

    # Downloads.

    def _receive_download(self, point: JointTrajPt, comm_type: CommType) -> None:
        reply_to = point.sequence if comm_type is CommType.SERVICE_REQUEST else None
        if point.sequence == FIRST:
            self.download.start(comm_type)
            self._topics = comm_type is CommType.TOPIC
            self._accepted = None
        refused = self.download.rejected
        if not refused and (rejection := self._download_rejection(point, reply_to)) is not None:
            self._errors.enter(rejection.about(_name(point)))
            self.abort()
            refused = True
        points = self.download.end() if point.sequence == LAST else []
        if refused:
            self._answer(reply_to, ReplyCode.FAILURE)
            return
        self._errors.clear()
        if reply_to is not None:
            self.queue.append(Entry(reply_to=reply_to, ready_at=self.download.busy_until))
        self._execute(points)
        self.queue.advance()

    def _download_rejection(self, point: JointTrajPt, reply_to: int | None) -> Rejection | None:
        check = self._profile.check_limits
        return (
            self._blocked()
            or numbers_rejection(point, self._used)
            or (limits_rejection(point, self._limits) if check else None)
            or (self._queue_rejection() if reply_to is not None else None)
            or self.download.add(point, self._controller.clock.now)
            or (self._room_rejection() if point.sequence == LAST else None)
        )

    def _room_rejection(self) -> Rejection | None:
        maximum = max(self._pending_limit, self._profile.download.buffer)
        if len(self.queue) + len(self.download) <= maximum:
            return None
        return corrupt(
            f'{len(self.queue)} points are already pending, at most {maximum} are possible'
        )

    def _execute(self, points: list[JointTrajPt]) -> None:
        """Queue the points of a download. The arm executes them once all are processed."""
        for index, point in enumerate(points):
            outside = limits_rejection(point, self._limits)
            reason = None if outside is None else outside.about(_name(point))
            target = self._point(point, index)
            self.queue.append(Entry(target, None, index == 0, reason, self.download.busy_until))

    # Replies.

    def _reject_corrupt(self, frame: Frame, error: HeaderError | BodyError) -> None:
        rejection = corrupt(f'message type {frame.msg_type}: {error}')
        answered = frame.comm_type not in UNANSWERED
        if frame.msg_type == MessageType.JOINT_TRAJ_PT:
            self._reject(sequence_of(frame) if answered else None, rejection)
            return
        self._errors.enter(rejection)
        if not answered:
            return
        if frame.msg_type > 0:
            self._send(failure(frame.msg_type))
        else:  # a reply with an invalid type would be invalid too
            self._answer(0, ReplyCode.FAILURE)

    def _reject(self, sequence: int | None, rejection: Rejection) -> None:
        self._errors.enter(rejection)
        self.abort()
        self._answer(sequence, ReplyCode.FAILURE)

    def _fail(self, entry: Entry, rejection: Rejection) -> None:
        self._errors.enter(rejection)
        if not self._profile.late_failure:
            self.abort()
            return
        self._answer(entry.reply_to, ReplyCode.FAILURE)
        self.queue.drop()
        self.detach()
        self._controller.clients.disconnect_after_flush('motion')

    def _answer_success(self, entry: Entry) -> None:
        self._answer(entry.reply_to, ReplyCode.SUCCESS)

    def _answer(self, sequence: int | None, code: ReplyCode) -> None:
        if sequence is not None:
            self._send(reply(self._reply(sequence), code))
