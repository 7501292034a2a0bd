# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads a run from a trace of the driver (docs/report.md), or from a capture of tcpdump."""

import math
from collections import defaultdict
from dataclasses import replace
from enum import IntEnum
from pathlib import Path

import numpy as np

from epson_driver.driver.state.plausibility import DEFAULT_MARGINS, JointBounds
from epson_driver.error_texts import ErrorTexts
from epson_driver.inputs import printable
from epson_driver.link.replies import PendingReplies, PendingRequest
from epson_driver.motion import JointLimits
from epson_driver.report.rtmc_conversation import RtmcConversation
from epson_driver.report.run import (
    FLAGS,
    NANOSECONDS,
    NO,
    UNKNOWN,
    YES,
    Arrival,
    Condition,
    Event,
    Plan,
    Reply,
    Run,
    RunError,
    Traffic,
    array,
    condition_events,
    sent_times,
)
from epson_driver.rtmc.conditions import sentence
from epson_driver.rtmc.messages import Request, RtmcError, RtmcMessage
from epson_driver.simple_message import (
    CommType,
    Frame,
    JointFeedback,
    JointPosition,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    MessageType,
    MotionCtrl,
    MotionReply,
    Packet,
    ReplyCode,
    SimpleMessageError,
    SpecialSequence,
    Status,
    ValidFields,
    decode,
    topic,
)
from epson_driver.simple_message.motoman import Command, Result
from epson_driver.trace.messages import Entry, Kind, MessagesError, messages_of
from epson_driver.trace.pcap import PcapError
from epson_driver.trace.recording import DamagedError, read_recording

SILENCE_S = 0.3  # maximum interval between joint states on a connected port, s

LINK_LOST = (
    'check cable, network and controller. The driver reconnects automatically. Then call ~/enable'
)
NO_FRAME = 'check the port for other users, and the network for devices that alter data'
IMPLAUSIBLE = (
    'check robot model and units (--robot), the encoder, and the network for altered data'
)
WIRE_NOTE = (
    'from the network traffic, without the remote port. Names and order of the joints are taken '
    'from the robot model'
)
NO_REPLY = 'check the program on the controller: it may be stuck or have ended'

COMMANDS = {
    Command.STOP_MOTION: ('warning', 'STOP sent'),
    Command.START_SERVOS: ('info', 'motors on requested'),
    Command.STOP_SERVOS: ('info', 'motors off requested'),
    Command.RESET_ALARM: ('info', 'reset requested'),
}


def read_trace(
    path: Path, limits: JointLimits, texts: ErrorTexts, controller: str | None = None
) -> Run:
    """Return the run in a pcap file. The run ends where the file is damaged.

    Joint states that the arm cannot reach within `limits` are omitted, and reported as an event.
    `controller`: the controller's address, needed if the file contains several controllers. Raises
    RunError if the file contains no run, InputError if it is unreadable.
    """
    damage: list[str] = []
    try:
        try:
            steps = read_recording(path, damage)
        except DamagedError as error:
            steps, damage = error.steps, [f'{error}: the data after it is missing']
        messages = messages_of(steps, controller)
    except (PcapError, MessagesError) as error:
        raise RunError(printable(f'{path}: {error}')) from error
    reader = _Reader(limits, messages.roles)
    for entry in messages.entries:
        reader.take(entry)
    if not reader.times:
        raise RunError(printable(f'{path}: it contains no joint states'))
    began = round(messages.began * NANOSECONDS)
    run = reader.run(path.name, began, limits.names, texts)
    return replace(run, notes=[*damage, *run.notes])


class _Reader:
    def __init__(self, limits: JointLimits, role_of: dict[int, str]) -> None:
        self._joints = joints = len(limits.names)
        self._bounds = JointBounds(joints, limits, DEFAULT_MARGINS)
        self._doubtful = False
        self._role_of = role_of
        self.times: list[float] = []
        self._positions: list[tuple[float, ...]] = []
        self._velocities: list[tuple[float, ...]] = []
        self._conditions: list[Condition] = []
        self._events: list[Event] = []
        self._traffic: dict[tuple[str, str], list[float]] = defaultdict(list)
        self._replies: list[Reply] = []
        self._links: list[tuple[float, str, bool]] = []
        self._pending: dict[int, PendingReplies] = defaultdict(PendingReplies)
        self._plans = _Plans(joints)
        self._rtmc = RtmcConversation(limits.units)
        self._asked = 0.0  # time of the last request of Real-time Motion Control, s
        self._refused: dict[int, int] = {}  # request → its reason for the last refusal
        self._silent_since: float | None = None
        self._arrivals: dict[int, list[Arrival]] = defaultdict(list)
        self._broken: set[int] = set()
        self._end = 0.0

    def take(self, entry: Entry) -> None:
        self._end = entry.time
        role = self._role_of[entry.connection]
        if entry.kind is Kind.OPEN:
            self._links.append((entry.time, role, True))
            self._event(entry, 'info', f'{role} port connected')
        elif entry.kind in (Kind.END, Kind.RESET):
            self._links.append((entry.time, role, False))
            how = 'closed' if entry.kind is Kind.END else 'broken off'
            self._event(entry, 'error', f'{role} port {how} by the controller', LINK_LOST)
            self._pending.pop(entry.connection, None)
            self._silent_since = None
        elif entry.frame is None:
            if entry.connection not in self._broken:
                self._broken.add(entry.connection)
                text = f'{role} port: {len(entry.data)} bytes that are no message'
                self._event(entry, 'error', text, NO_FRAME)
        elif isinstance(entry.frame, RtmcMessage):
            try:
                self._take_rtmc(entry, entry.frame)
            except RtmcError as error:
                self._event(entry, 'error', f'an unreadable message: {error}', NO_FRAME)
        else:
            self._take_frame(entry, entry.frame)

    def _take_rtmc(self, entry: Entry, message: RtmcMessage) -> None:
        name = _name(message.number, Request)
        if entry.kind is Kind.REQUEST:
            self._traffic[name, 'driver'].append(entry.time)
            self._asked = entry.time
            for sent in self._rtmc.sent(message, entry.time):
                self._take_request(entry, topic(sent))
            return
        notice = message.number <= Request.JOINTS_NOTICE
        self._traffic[name if notice else f'{name} reply', 'controller'].append(entry.time)
        if not notice:
            self._replies.append(Reply(self._asked, entry.time - self._asked, name))
            if not message.high:  # a polling driver repeats refused requests
                if self._refused.get(message.number) != message.low:
                    why = sentence(message.number, message.low)
                    self._event(entry, 'error', f'the controller refused {name}: {why}')
                self._refused[message.number] = message.low
                return
            self._refused.pop(message.number, None)
        for received in self._rtmc.received(message):
            self._take_topic(entry.time, received, self._arrivals[entry.connection])

    def _take_frame(self, entry: Entry, frame: Frame) -> None:
        try:
            packet = decode(frame)
        except SimpleMessageError as error:
            self._event(entry, 'error', f'an unreadable message: {error}', NO_FRAME)
            return
        sender = 'driver' if entry.kind is Kind.REQUEST else 'controller'
        name = _name(packet.msg_type)
        if packet.comm_type is CommType.SERVICE_REPLY:
            name += ' reply'
        self._traffic[name, sender].append(entry.time)
        if entry.kind is Kind.REQUEST:
            self._take_request(entry, packet)
        elif packet.comm_type is CommType.SERVICE_REPLY:
            self._take_reply(entry, packet)
        else:
            self._take_topic(entry.time, packet.message, self._arrivals[entry.connection])

    def _take_topic(self, time: float, message: Message, arrivals: list[Arrival]) -> None:
        if isinstance(message, JointPosition):
            arrivals.append(Arrival(time, joints=self._state(time, message.joints, ())))
        elif isinstance(message, JointFeedback) and message.valid_fields & ValidFields.POSITION:
            measured = message.valid_fields & ValidFields.VELOCITY
            timed = message.valid_fields & ValidFields.TIME
            velocities = message.velocities if measured else ()
            joints = self._state(time, message.positions, velocities)
            stamp = message.time if timed else None
            arrivals.append(Arrival(time, joints=joints, stamp=stamp))
        elif isinstance(message, Status):
            arrivals.append(Arrival(time, joints=False))
            codes = (message.error_code,) if message.error_code else ()
            values = [getattr(message, name) for name in FLAGS]
            flags = tuple(value if value in (NO, YES) else UNKNOWN for value in values)
            mode = message.mode if message.mode in (1, 2) else -1
            self._conditions.append(Condition(time, flags, mode, codes))

    def _state(
        self, time: float, positions: tuple[float, ...], velocities: tuple[float, ...]
    ) -> bool:
        """Store a joint state if it is plausible. Return whether it is plausible."""
        since = self._silent_since
        if since is not None and time - since > SILENCE_S:
            text = f'no joint state for {time - since:.2f} s'
            remedy = "check the controller's state task and the network"
            self._events.append(Event(since, 'warning', text, remedy))
        self._silent_since = time
        why = self._why_not(time, positions, velocities)
        if why is not None:
            if not self._doubtful:
                text = f'implausible joint states: {why}'
                self._events.append(Event(time, 'warning', text, IMPLAUSIBLE))
            self._doubtful = True
            return False
        self._doubtful = False
        if self.times and time <= self.times[-1]:  # several arrived together: make them ascend
            time = self.times[-1] + 1e-6
        self.times.append(time)
        self._positions.append(positions[: self._joints])
        self._velocities.append(velocities[: self._joints])
        return True

    def _why_not(
        self, time: float, positions: tuple[float, ...], velocities: tuple[float, ...]
    ) -> str | None:
        """Return why a joint state is implausible, or None.

        Position limits are not checked, because the signs of the joints are unknown.
        """
        here = positions[: self._joints]
        if not all(math.isfinite(value) for value in (*here, *velocities[: self._joints])):
            return 'values are not finite'
        if not self.times:
            return None
        elapsed = max(time - self.times[-1], 0.0)
        return self._bounds.why_not_from(self._positions[-1], here, elapsed)

    def _take_request(self, entry: Entry, packet: Packet) -> None:
        message = packet.message
        if packet.comm_type is CommType.SERVICE_REQUEST:
            pending = PendingRequest(message, entry.time, lambda _packet, _time: None)
            self._pending[entry.connection].add(pending)
        if isinstance(message, JointTrajPt | JointTrajPtFull | JointTraj):
            points = message.points if isinstance(message, JointTraj) else (message,)
            for point in points:
                if point.sequence == SpecialSequence.STOP_TRAJECTORY:
                    self._event(entry, 'warning', 'STOP sent')
                    self._plans.end()
                elif self._plans.take(entry.time, point):
                    self._event(entry, 'info', 'a trajectory starts')
        elif isinstance(message, MotionCtrl) and message.command in COMMANDS:
            self._event(entry, *COMMANDS[Command(message.command)])

    def _take_reply(self, entry: Entry, packet: Packet) -> None:
        request = self._pending[entry.connection].take(packet)
        if request is None and packet.msg_type == MessageType.PING:
            text = 'the controller stopped the arm: it received nothing from the driver'
            remedy = 'find the cause of the delay in the driver or the network'
            self._event(entry, 'error', text, remedy)
            return
        if request is None:
            self._event(entry, 'warning', f'a reply without a request ({_name(packet.msg_type)})')
            return
        name = _name(request.msg_type)
        if request.sequence == SpecialSequence.STOP_TRAJECTORY:
            name = 'STOP'
        elif isinstance(request.message, MotionCtrl):
            name = _name(request.message.command, Command, 'command')
        self._replies.append(Reply(request.sent, entry.time - request.sent, name))
        reply = packet.message
        refused = packet.reply_code == ReplyCode.FAILURE
        if isinstance(reply, MotionReply):
            refused = reply.result not in (Result.SUCCESS, Result.BUSY)
        if refused:
            numbered = request.sequence is not None and request.sequence >= 0
            text = f'the controller refused {name}' + (f' {request.sequence}' * numbered)
            self._event(entry, 'error', text, 'see the next error of the controller')

    def _event(self, entry: Entry, level: str, text: str, remedy: str = '') -> None:
        self._events.append(Event(entry.time, level, text, remedy))

    def run(self, source: str, began: int, joint_names: tuple[str, ...], texts: ErrorTexts) -> Run:
        sent = [time for arrival in self._arrivals.values() for time in sent_times(arrival)]
        measured = all(len(row) == self._joints for row in self._velocities)
        for pending in self._pending.values():
            if len(pending):
                text = f'{len(pending)} requests without a reply'
                self._events.append(Event(self._end, 'warning', text, NO_REPLY))
        notes = [WIRE_NOTE]
        if not measured:
            notes.append('the controller sends no velocities, so they are computed')
        events = [*self._events, *condition_events(self._conditions, texts)]
        return Run(
            source=source,
            began=began,
            joint_names=joint_names,
            times=array(self.times),
            positions=array(self._positions, self._joints),
            velocities=array(self._velocities, self._joints) if measured else None,
            sent=np.maximum.accumulate(array(sent)),
            conditions=self._conditions,
            plans=self._plans.finished(),
            events=sorted(events, key=lambda event: event.time),
            traffic=[
                Traffic(name, sender, array(times))
                for (name, sender), times in sorted(self._traffic.items())
            ],
            replies=self._replies,
            links=self._links,
            notes=notes,
            ended=self._end,
        )


class _Plans:
    def __init__(self, joints: int) -> None:
        self._joints = joints
        self._done: list[Plan] = []
        self._sent = 0.0
        self._last = -1
        self._times: list[float] = []
        self._points: list[tuple[float, ...]] = []

    def take(self, time: float, point: JointTrajPt | JointTrajPtFull) -> bool:
        """Add a point, unless it is a repetition. Return whether it is the first of a new plan."""
        starts_stream = point.sequence == SpecialSequence.START_TRAJECTORY_STREAMING
        sequence = 0 if starts_stream else point.sequence
        if sequence < 0 or (sequence == self._last and sequence):
            return False  # a special sequence, or a repeated point
        if isinstance(point, JointTrajPtFull):
            positions, seconds = point.positions, point.time
        else:
            positions, seconds = point.joints, point.duration
        if not all(map(math.isfinite, (*positions, seconds))):
            return False
        again = len(self._points) == 1 and self._same(point)
        first = not self._points or (sequence == 0 and not again)
        if first:
            self.end()
            self._sent = time
        elif sequence == 0:
            return False
        if not isinstance(point, JointTrajPtFull):  # relative to the previous point
            seconds = 0.0 if first else self._times[-1] + seconds
        self._times.append(seconds)
        self._last = sequence
        self._points.append(positions[: self._joints])
        return first

    def _same(self, point: JointTrajPt | JointTrajPtFull) -> bool:
        """Return whether a point repeats the first one, which a busy controller has refused."""
        positions = point.positions if isinstance(point, JointTrajPtFull) else point.joints
        return isinstance(point, JointTrajPtFull) and positions[: self._joints] == self._points[0]

    def end(self) -> None:
        if self._points:
            times = array(self._times)
            latest = np.maximum.accumulate(times)
            keep = np.concatenate([[True], times[1:] > latest[:-1]])
            positions = array(self._points, self._joints)
            self._done.append(Plan(self._sent, times[keep] - times[0], positions[keep]))
        self._times, self._points, self._last = [], [], -1

    def finished(self) -> list[Plan]:
        self.end()
        return self._done


def _name(number: int, kind: type[IntEnum] = MessageType, otherwise: str = 'message type') -> str:
    try:
        return kind(number).name
    except ValueError:
        return f'{otherwise} {number}'
