# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The messages of a recording, in both directions and in the recorded order.

They are frames of simple message, or messages of Real-time Motion Control.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto

from epson_driver.link.connection import WireEvent
from epson_driver.rtmc.messages import RtmcError, RtmcMessage, split, starts
from epson_driver.simple_message import CommType, Frame, FrameError, Framer, MessageType
from epson_driver.trace.recording import Step

USUAL_PORTS = {11000: 'motion', 11002: 'state', 11003: 'io', 50240: 'motion', 50241: 'state'}
"""Usual port → role of a port with this number if its messages do not reveal the role."""

ROLES = ('motion', 'state', 'io')

ROLE_OF_TYPE = {
    MessageType.JOINT_POSITION: 'state',
    MessageType.JOINT_FEEDBACK: 'state',
    MessageType.STATUS: 'state',
    MessageType.JOINT_TRAJ_PT: 'motion',
    MessageType.JOINT_TRAJ: 'motion',
    MessageType.JOINT_TRAJ_PT_FULL: 'motion',
    MessageType.MOTION_CTRL: 'motion',
    MessageType.IO_INFO: 'io',
    MessageType.IO_READ: 'io',
    MessageType.IO_WRITE: 'io',
    MessageType.IO_STREAM_SUB: 'io',
}
"""Message type → role of the port that sends it (a topic) or receives it (a request)."""


class MessagesError(ValueError):
    """A recording does not contain the messages of exactly one controller.

    The text is the reason.
    """


class Kind(Enum):
    """Type of an entry of a recording.

    OPEN and REQUEST come from the driver, and SEND, END and RESET from the controller.
    """

    OPEN = auto()
    REQUEST = auto()
    SEND = auto()
    END = auto()
    RESET = auto()


@dataclass(frozen=True, slots=True)
class Entry:
    """One event. `time`: s from the start of the recording, never before the previous entry."""

    time: float
    kind: Kind
    connection: int
    data: bytes = b''
    frame: Frame | RtmcMessage | None = None  # the data as a message, or None if it is not one


@dataclass(frozen=True)
class Messages:
    began: float  # start time, s since 1970
    entries: tuple[Entry, ...]
    roles: dict[int, str]  # role of each connection, one of ROLES or 'rtmc'


class Splitter:
    """Splits the bytes of one direction into messages."""

    def __init__(self) -> None:
        self._framer = Framer()
        self._bytes = bytearray()
        self._broken = False
        self._real_time = False

    def split(self, data: bytes) -> Iterator[tuple[bytes, Frame | RtmcMessage | None]]:
        """Yield each message with its bytes.

        After an invalid message, yield all remaining bytes with None.
        """
        self._bytes += data
        self._real_time |= not self._broken and starts(self._bytes)
        if self._real_time and not self._broken:
            try:
                for message in split(self._bytes):
                    yield message.encode(), message
            except RtmcError:
                self._broken = True
                yield from self.rest()
            return
        self._framer.receive_data(data)
        while not self._broken:
            try:
                frame = self._framer.next_frame()
            except FrameError:
                self._broken = True
                break
            if frame is None:
                return
            yield self._taken(16 + len(frame.body)), frame
        yield from self.rest()

    def rest(self) -> Iterator[tuple[bytes, None]]:
        """Yield the bytes that remain after the last frame, if any, with None."""
        if self._bytes:
            yield self._taken(len(self._bytes)), None

    def _taken(self, count: int) -> bytes:
        data = bytes(self._bytes[:count])
        del self._bytes[:count]
        return data


def messages_of(steps: Sequence[Step], controller: str | None = None) -> Messages:
    """Return the messages of a recording, without connections of another protocol.

    `controller`: the controller's IP address, needed if the recording contains several
    controllers. Raises MessagesError if no controller or no unique one is found, or if two ports
    have the same role.
    """
    steps = _of_one_controller(steps, controller)
    if not steps:
        raise MessagesError('it contains no connection to a controller')
    entries = list(_entries(steps))
    port_of = {step.number: step.server[1] for step in steps}
    by_port = _roles(entries, port_of)
    roles = {number: by_port[port] for number, port in port_of.items() if port in by_port}
    entries = [entry for entry in entries if entry.connection in roles]
    return Messages(min(step.time for step in steps), tuple(entries), roles)


def _of_one_controller(steps: Sequence[Step], controller: str | None) -> list[Step]:
    speaks: dict[int, bool] = {}
    for number in {step.number for step in steps}:
        data = [b.data for b in steps if b.number == number and b.event is WireEvent.RECEIVED]
        speaks[number] = not data or any(
            isinstance(frame, RtmcMessage)
            or (frame is not None and 0 < frame.comm_type <= CommType.SERVICE_REPLY)
            for _, frame in Splitter().split(b''.join(data))
        )
    chosen = [
        step for step in steps if speaks[step.number] and controller in (None, step.server[0])
    ]
    addresses = sorted({step.server[0] for step in chosen})
    if len(addresses) > 1:
        raise MessagesError(f'controllers {", ".join(addresses)} are in the recording: select one')
    return chosen


def _entries(steps: Sequence[Step]) -> Iterator[Entry]:
    splitters: dict[tuple[int, WireEvent], Splitter] = defaultdict(Splitter)
    kinds = {
        WireEvent.OPENED: Kind.OPEN,
        WireEvent.ENDED: Kind.END,
        WireEvent.RESET: Kind.RESET,
        WireEvent.SENT: Kind.REQUEST,
        WireEvent.RECEIVED: Kind.SEND,
    }
    start = now = steps[0].time
    for step in steps:
        now = max(now, step.time)
        if step.event is WireEvent.CLOSED:
            continue
        time, kind = now - start, kinds[step.event]
        if step.event in (WireEvent.SENT, WireEvent.RECEIVED):
            pieces = splitters[step.number, step.event].split(step.data)
            for data, frame in pieces:
                heartbeat = frame is None or (isinstance(frame, Frame) and frame.heartbeat)
                if kind is Kind.SEND or not heartbeat:
                    yield Entry(time, kind, step.number, data, frame)
            continue
        if kind is not Kind.OPEN:
            for data, _ in splitters[step.number, WireEvent.RECEIVED].rest():
                yield Entry(time, Kind.SEND, step.number, data)
        yield Entry(time, kind, step.number)


def _roles(entries: Sequence[Entry], port_of: dict[int, int]) -> dict[int, str]:
    """Return the role of each port. Raises MessagesError if two ports have the same role."""
    roles: dict[int, str] = {}
    for entry in entries:
        expected = CommType.TOPIC if entry.kind is Kind.SEND else CommType.SERVICE_REQUEST
        if isinstance(entry.frame, RtmcMessage):
            roles[port_of[entry.connection]] = 'rtmc'
        elif entry.frame is not None and entry.frame.comm_type == expected:
            role = ROLE_OF_TYPE.get(entry.frame.msg_type)  # type: ignore[call-overload]
            if role is not None:
                roles.setdefault(port_of[entry.connection], role)
    for port in sorted(set(port_of.values()) - set(roles)):
        free = [role for role in ROLES if role not in roles.values()]
        usual = USUAL_PORTS.get(port)
        if free:
            roles[port] = usual if usual in free else free[0]
    if len(set(roles.values())) < len(roles):
        text = ', '.join(f'{port} ({role})' for port, role in sorted(roles.items()))
        raise MessagesError(f'the recording has two ports with the same role: {text}')
    return roles
