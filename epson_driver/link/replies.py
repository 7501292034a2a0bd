# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Matches replies to requests, for controllers that reply in different formats.

* FANUC copies the request's sequence into a JOINT_POSITION. EPSON's program leaves it zero. ABB
  sends a header of the request's type without a body. A sequence of a pending request identifies
  that request. Otherwise the reply matches the oldest pending request of a compatible type.
* FANUC also sends a second, negative reply for a point that it has acknowledged but cannot reach.
  A recently answered sequence therefore does not match the next request.
* Motoman's MOTION_REPLY repeats the command that it answers, or marks the reply to a point.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from epson_driver.simple_message import (
    Message,
    MessageType,
    MotionCtrl,
    MotionReply,
    Packet,
    SpecialSequence,
)

ANSWERED_BY: dict[int, frozenset[int]] = {
    MessageType.JOINT_TRAJ_PT: frozenset({MessageType.JOINT_TRAJ_PT, MessageType.JOINT_POSITION}),
    MessageType.JOINT_TRAJ_PT_FULL: frozenset(
        {
            MessageType.JOINT_TRAJ_PT_FULL,
            MessageType.JOINT_POSITION,
            MessageType.MOTION_REPLY,
        }
    ),
    MessageType.MOTION_CTRL: frozenset({MessageType.MOTION_REPLY}),
    **{
        asked: frozenset({answered, MessageType.IOCTRL_REPLY})
        for asked, answered in (
            (MessageType.READ_IO_BIT, MessageType.READ_IO_BIT_REPLY),
            (MessageType.WRITE_IO_BIT, MessageType.WRITE_IO_BIT_REPLY),
            (MessageType.READ_IO_GROUP, MessageType.READ_IO_GROUP_REPLY),
            (MessageType.WRITE_IO_GROUP, MessageType.WRITE_IO_GROUP_REPLY),
        )
    },
}
"""Types of reply per type of request. An unlisted type is answered by the same type."""

STOP = int(SpecialSequence.STOP_TRAJECTORY)

MAX_ANSWERED = 16

MAX_PENDING = 64
"""Maximum number of pending requests. Usually one point and a STOP are pending. The oldest is
dropped beyond this."""

MAX_REPLY_AGE_S = 1.0
"""Maximum age of a pending request at the start of a new trajectory, s. The previous trajectory
has ended, so an older reply will not arrive, and would otherwise take the place of a later one."""


@dataclass(slots=True, eq=False)
class PendingRequest:
    """A request without its reply. `sent`: loop time, s.

    `command`: of a MOTION_CTRL. A MOTION_REPLY to any other request has the request's type in its
    command field.
    """

    msg_type: int
    sequence: int | None
    sent: float
    on_reply: Callable[[Packet, float], None]
    command: int | None = None

    def may_be_answered_by(self, reply: Packet) -> bool:
        """Return whether the reply has a type that answers this request."""
        if reply.msg_type not in ANSWERED_BY.get(self.msg_type, (self.msg_type,)):
            return False
        message = reply.message
        expected = self.msg_type if self.command is None else self.command
        return not isinstance(message, MotionReply) or message.command == expected


class PendingReplies:
    """The pending requests of one link, oldest first."""

    def __init__(self) -> None:
        self._waiting: deque[PendingRequest] = deque(maxlen=MAX_PENDING)
        self._answered: deque[int] = deque(maxlen=MAX_ANSWERED)

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, waiting: PendingRequest) -> None:
        """Add a request that is being sent."""
        if waiting.sequence in self._answered:  # a new trajectory counts from 0 again
            self._answered.clear()
        if waiting.sequence == 0:
            while self._waiting and waiting.sent - self._waiting[0].sent > MAX_REPLY_AGE_S:
                self._waiting.popleft()
        if waiting.sequence == STOP:  # a reply to one STOP answers them all
            self._waiting = deque(
                (
                    item
                    for item in self._waiting
                    if item.sequence != waiting.sequence
                    or waiting.sent - item.sent <= MAX_REPLY_AGE_S
                ),
                MAX_PENDING,
            )
        self._waiting.append(waiting)

    def take(self, reply: Packet) -> PendingRequest | None:
        """Remove and return the request that the reply answers, or None."""
        result = self._find(reply)
        if result is not None:
            self._waiting.remove(result)
            if result.sequence:
                self._answered.append(result.sequence)
        return result

    def give_up(self, waiting: PendingRequest) -> None:
        """Drop one request. A late reply with its sequence does not match another one."""
        if waiting in self._waiting:
            self._waiting.remove(waiting)
            if waiting.sequence:
                self._answered.append(waiting.sequence)

    def clear(self) -> None:
        """Drop all requests, because the link is lost."""
        self._waiting.clear()
        self._answered.clear()

    def _find(self, reply: Packet) -> PendingRequest | None:
        sequence = sequence_of(reply.message)
        oldest = None
        for waiting in self._waiting:
            if waiting.may_be_answered_by(reply):
                if sequence and waiting.sequence == sequence:
                    return waiting
                oldest = oldest or waiting
        return None if sequence and sequence in self._answered else oldest


def sequence_of(message: Message) -> int | None:
    """Return a message's sequence, or an I/O message's message_id, or None if it has neither."""
    sequence: int | None = getattr(message, 'sequence', None)
    if sequence is None:
        sequence = getattr(message, 'message_id', None)
    return sequence


def command_of(message: Message) -> int | None:
    """Return the command of a MOTION_CTRL, None for any other message."""
    return message.command if isinstance(message, MotionCtrl) else None
