# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Matching of replies to pending requests, for controllers with different formats of replies.

* FANUC replies with a JOINT_POSITION that has the request's sequence number. EPSON's
  JOINT_POSITION has the sequence number 0. ABB replies with the request's type and no body. A
  reply with the number of a pending request matches that request. Any other reply matches the
  oldest pending request of a compatible type.
* FANUC also sends a second, negative reply for a point that it has acknowledged but cannot reach.
  Therefore a reply with a recently answered sequence number does not match another request.
* Motoman's MOTION_REPLY contains the command of its MOTION_CTRL, or the message type of its point.
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
    request,
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
        asked: frozenset({answer, MessageType.IOCTRL_REPLY})
        for asked, answer in (
            (MessageType.READ_IO_BIT, MessageType.READ_IO_BIT_REPLY),
            (MessageType.WRITE_IO_BIT, MessageType.WRITE_IO_BIT_REPLY),
            (MessageType.READ_IO_GROUP, MessageType.READ_IO_GROUP_REPLY),
            (MessageType.WRITE_IO_GROUP, MessageType.WRITE_IO_GROUP_REPLY),
        )
    },
}
"""Types of the replies to each request type. The reply to an unlisted type has the same type."""

STOP = int(SpecialSequence.STOP_TRAJECTORY)

MAX_ANSWERED = 16  # number of recently answered sequences that are remembered

MAX_PENDING = 64
"""Maximum number of pending requests. If there are more, the oldest request is dropped. Usually at
most one point and a STOP are pending."""

MAX_REPLY_AGE_S = 1.0
"""Age, s, after which a pending request is dropped when a new trajectory starts. Its reply will
not arrive any more, and the request would otherwise match a later reply."""


@dataclass(slots=True, eq=False)
class PendingRequest:
    message: Message
    sent: float  # loop time of sending, s
    on_reply: Callable[[Packet, float], None]

    @property
    def msg_type(self) -> int:
        return request(self.message).msg_type

    @property
    def sequence(self) -> int | None:
        return sequence_of(self.message)

    def may_be_answered_by(self, reply: Packet) -> bool:
        msg_type, asked, answer = self.msg_type, self.message, reply.message
        if reply.msg_type not in ANSWERED_BY.get(msg_type, (msg_type,)):
            return False
        expected = asked.command if isinstance(asked, MotionCtrl) else msg_type
        return not isinstance(answer, MotionReply) or answer.command == expected


class PendingReplies:
    """The pending requests of one link, oldest first."""

    def __init__(self) -> None:
        self._waiting: deque[PendingRequest] = deque(maxlen=MAX_PENDING)
        self._answered: deque[int] = deque(maxlen=MAX_ANSWERED)

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, waiting: PendingRequest) -> None:
        """Add a request, and remove requests whose replies will not arrive any more."""
        if waiting.sequence in self._answered:  # a new trajectory counts from 0 again
            self._answered.clear()
        if waiting.sequence == 0:
            while self._waiting and waiting.sent - self._waiting[0].sent > MAX_REPLY_AGE_S:
                self._waiting.popleft()
        if waiting.sequence == STOP:  # older STOPs will not be answered any more
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
        result = self._find(reply)
        if result is not None:
            self._waiting.remove(result)
            if result.sequence:
                self._answered.append(result.sequence)
        return result

    def give_up(self, waiting: PendingRequest) -> None:
        """Remove a request. A late reply with its sequence does not match another request."""
        if waiting in self._waiting:
            self._waiting.remove(waiting)
            if waiting.sequence:
                self._answered.append(waiting.sequence)

    def clear(self) -> None:
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
    sequence: int | None = getattr(message, 'sequence', None)
    if sequence is None:
        sequence = getattr(message, 'message_id', None)
    return sequence
