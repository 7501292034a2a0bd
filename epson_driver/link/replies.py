# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Which request a reply answers, for controllers that answer in different ways.

* FANUC copies the request's sequence into a JOINT_POSITION; EPSON's program leaves it zero; ABB
  sends a header of the request's own type and no body. A sequence that is one of those waiting
  decides; otherwise the oldest request that the reply's type can answer.
* FANUC also sends a second, negative reply for a point that it has acknowledged and then could not
  reach. A sequence that was answered a moment ago does not answer the next request.
* Motoman repeats in a MOTION_REPLY which command it answers, or that it answers a point.
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


@dataclass(frozen=True, slots=True)
class Statement(Message):
    """SPEL+ statements that move the arm, as `$Execute` takes them.

    They are answered when they are over, however long that takes: `duration`, s, is no bound.
    """

    text: str
    duration: float = float('inf')


@dataclass(frozen=True, slots=True)
class StatementReply(Message):
    """The answer to a Statement or to `$Abort`. `why` they failed, as a clause, or ''."""

    why: str = ''


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
"""Types of reply per type of request; a type that is not listed is answered by itself."""

STOP = int(SpecialSequence.STOP_TRAJECTORY)

MAX_ANSWERED = 16

MAX_PENDING = 64
"""One point and a STOP wait, rarely more. Beyond this the oldest is given up."""

MAX_REPLY_AGE_S = 1.0
"""When a trajectory begins, the one before it has ended: a reply to it that is still missing this
long after its request, s, will not come. Otherwise it would take the place of the next one."""


@dataclass(slots=True, eq=False)
class PendingRequest:
    """A request without its reply. `sent` is the loop's time, s.

    `command` is that of a MOTION_CTRL; a MOTION_REPLY to any other request has its type there.
    """

    msg_type: int
    sequence: int | None
    sent: float
    on_reply: Callable[[Packet, float], None]
    command: int | None = None

    def may_be_answered_by(self, reply: Packet) -> bool:
        """Return whether the reply is of a kind that answers this request."""
        if reply.msg_type not in ANSWERED_BY.get(self.msg_type, (self.msg_type,)):
            return False
        message = reply.message
        expected = self.msg_type if self.command is None else self.command
        return not isinstance(message, MotionReply) or message.command == expected


class PendingReplies:
    """The requests on one link that wait for their reply, oldest first."""

    def __init__(self) -> None:
        self._waiting: deque[PendingRequest] = deque(maxlen=MAX_PENDING)
        self._answered: deque[int] = deque(maxlen=MAX_ANSWERED)

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, waiting: PendingRequest) -> None:
        """Remember a request that is being sent."""
        if waiting.sequence in self._answered:  # a new trajectory counts from 0 again
            self._answered.clear()
        if waiting.sequence == 0:
            while self._waiting and waiting.sent - self._waiting[0].sent > MAX_REPLY_AGE_S:
                self._waiting.popleft()
        if waiting.sequence == STOP:  # a reply to any STOP is one to all
            self._waiting = deque(
                (
                    each
                    for each in self._waiting
                    if each.sequence != waiting.sequence
                    or waiting.sent - each.sent <= MAX_REPLY_AGE_S
                ),
                MAX_PENDING,
            )
        self._waiting.append(waiting)

    def take(self, reply: Packet) -> PendingRequest | None:
        """Remove and return the request that the reply answers, or None if it answers none."""
        found = self._find(reply)
        if found is not None:
            self._waiting.remove(found)
            if found.sequence:
                self._answered.append(found.sequence)
        return found

    def give_up(self, waiting: PendingRequest) -> None:
        """Forget one request, and let a late reply with its sequence answer no other one."""
        if waiting in self._waiting:
            self._waiting.remove(waiting)
            if waiting.sequence:
                self._answered.append(waiting.sequence)

    def clear(self) -> None:
        """Forget all: the link is gone, no reply will come."""
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
