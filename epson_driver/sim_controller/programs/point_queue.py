# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of the points for `MotionProgram`, and the queue of points for the arm."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.clock import Timer
from epson_driver.sim_controller.condition.errors import (
    Rejection,
    angles_rejection,
    clipped,
    corrupt,
)
from epson_driver.sim_controller.core import Controller
from epson_driver.simple_message import (
    BodyError,
    CommType,
    Frame,
    JointTrajPt,
    MessageType,
    ReplyCode,
    decode,
)

MIN_VELOCITY = 1e-6
"""Smallest valid velocity of a point, except 0 (not specified). A slower move would take days."""

MAX_DURATION_S = 86_400.0  # a day


POINT_REALS = 12  # ten joints, velocity and duration


def as_point_frame(frame: Frame, accepts: str, size: int) -> Frame | None:
    """Return a frame as the program interprets it, or None if it is too short for a point.

    `accepts` is the profile's `program.accepts`: 'any' interprets every frame as a point, and
    'longer' drops surplus bytes of a point. `size`: size of the body of a JOINT_TRAJ_PT, bytes.
    """
    minimum = size - size // POINT_REALS * 2  # velocity and duration may be missing
    if accepts == 'any':
        if len(frame.body) < minimum:
            return None
        body = frame.body[:size].ljust(size, b'\0')
        point, request = MessageType.JOINT_TRAJ_PT, CommType.SERVICE_REQUEST
        return Frame(point, request, ReplyCode.INVALID, body, frame.byte_order)
    if accepts == 'longer' and frame.msg_type == MessageType.JOINT_TRAJ_PT:
        return frame._replace(body=frame.body[:size])
    return frame


def numbers_rejection(point: JointTrajPt, used: FieldsUsed = FieldsUsed.BOTH) -> Rejection | None:
    """Return why a number of a point is invalid, or None.

    Missing joints are checked, too. `used`: the fields to check.
    """
    for index, angle in enumerate(point.joints):
        if not np.isfinite(angle):
            return corrupt(f'joints[{index}] = {angle} is not finite')
    velocity = _number_rejection('velocity', point.velocity) if used.velocity else None
    if velocity is not None:
        return velocity
    return _number_rejection('duration', point.duration) if used.duration else None


def _number_rejection(name: str, value: float) -> Rejection | None:
    if not np.isfinite(value):
        return corrupt(f'{name} = {value} is not finite')
    if value < 0.0:
        return corrupt(f'{name} = {value:g} is negative')
    if name == 'duration':
        if value > MAX_DURATION_S:
            return corrupt(f'duration = {value:g} s is above {MAX_DURATION_S:g} s')
    elif value > 1.0:
        return corrupt(f'velocity = {value:g} is above 1, the fraction of the maximum joint speed')
    elif 0.0 < value < MIN_VELOCITY:
        return corrupt(f'velocity = {value:g} is below {MIN_VELOCITY:g}')
    return None


def limits_rejection(point: JointTrajPt, limits: JointLimits) -> Rejection | None:
    return angles_rejection(np.array(point.joints[: len(limits.names)]), limits)


def target_of(point: JointTrajPt, limits: JointLimits) -> Array:
    return clipped(np.array(point.joints[: len(limits.names)]), limits)


def sequence_of(frame: Frame) -> int:
    """Return the sequence of a JOINT_TRAJ_PT whose header is invalid.

    The result is 0 if the body is invalid, too.
    """
    try:
        request = Frame(frame.msg_type, CommType.SERVICE_REQUEST, 0, frame.body, frame.byte_order)
        message = decode(request).message
    except BodyError:
        return 0
    return message.sequence if isinstance(message, JointTrajPt) else 0


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """An entry of the queue: a point for the arm, or only a reply to send.

    * `point`: point to which the arm moves (None: the entry is only a reply).
    * `reply_to`: sequence of the request to answer (None: the point was not a request, so it needs
      no reply).
    * `starts_trajectory`: whether a trajectory starts with the point.
    * `rejection`: why the point must not be executed (None: it may). The motion ends before it.
    * `ready_at`: earliest time of the controller at which the entry is processed, s.
    """

    point: Point | None = None
    reply_to: int | None = None
    starts_trajectory: bool = False
    rejection: Rejection | None = None
    ready_at: float = 0.0


ROUNDING_S = 1e-9


class PointQueue:
    """Supplies points to the arm in order, and triggers the replies.

    `answered` is called with a completed entry. An entry with a rejection waits until the arm is
    at rest at the previous point. Then `failed` is called with the entry, before the entry is
    removed. If the profile has `program.late_failure`, an entry with a rejection does not wait: it
    is passed to `answered`, removed, and passed to `failed`, while the arm continues to earlier
    points.

    The controller is notified of a trajectory before the arm accepts its first point. This point
    is skipped if each joint is within `program.skip_first`, rad or m, of its current position. Any
    of the callbacks may flush the queue.
    """

    def __init__(
        self,
        controller: Controller,
        answered: Callable[[Entry], None],
        failed: Callable[[Entry, Rejection], None],
    ) -> None:
        self._arm = controller.arm.executor
        self._clock = controller.clock
        self._answers_early = controller.profile.program.late_failure
        self._answered = answered
        self._failed = failed
        self._trajectory_starts = controller.trajectory_starts
        self._skip_first = controller.profile.program.skip_first
        self._current: Entry | None = None
        self._waiting: deque[Entry] = deque()
        self._timer: Timer | None = None
        self.paused = False

    def __len__(self) -> int:
        return len(self._waiting)

    def append(self, entry: Entry) -> None:
        self._waiting.append(entry)

    def flush(self) -> tuple[list[Entry], bool]:
        """Empty the queue. Return the unanswered entries, and whether answered points are lost."""
        lost = self._arm.stop()
        entries = [] if self._current is None else [self._current]
        entries += self._waiting
        self._current = None
        self._waiting.clear()
        return entries, lost

    def drop(self) -> None:
        self._waiting.clear()

    def detach(self) -> None:
        """Discard all pending replies, and the waiting points that need a reply."""
        if self._current is not None:
            self._current = replace(self._current, reply_to=None)
        self._waiting = deque(entry for entry in self._waiting if entry.reply_to is None)

    def step(self, dt: float) -> None:
        time_left: float | None = dt
        while time_left is not None:
            time_left = self._arm.step(time_left)
            self.advance()
            if not self._arm.moving:
                return

    def advance(self) -> None:
        while not self.paused:
            if (current := self._current) is not None:
                if not self._done(current):
                    return
                self._finish(current)
            elif not self._waiting or not self._has_turn(self._waiting[0]):
                return
            else:
                self._start(self._waiting.popleft())

    def _has_turn(self, entry: Entry) -> bool:
        room = entry.point is None or self._arm.has_room
        return room and self._is_ready(entry.ready_at)

    def _is_ready(self, ready_at: float) -> bool:
        """Return whether the time `ready_at`, s, has been reached.

        If not, schedule `advance` for this time.
        """
        if ready_at <= self._clock.now + ROUNDING_S:
            return True
        timer = self._timer
        if timer is None or timer.action is None or timer.due > ready_at:
            if timer is not None:
                timer.cancel()
            self._timer = self._clock.after(ready_at - self._clock.now, self.advance)
        return False

    def _start(self, entry: Entry) -> None:
        self._current = entry
        if entry.point is None:
            return
        if entry.rejection is not None:
            if self._answers_early:
                self._answered(entry)
            return
        if entry.starts_trajectory:
            self._trajectory_starts()
        if self._current is not entry:  # flushed by the callback
            return
        if self._is_skipped(entry, entry.point):
            self._current = replace(entry, point=None)
        else:
            self._arm.take(entry.point)

    def _is_skipped(self, entry: Entry, point: Point) -> bool:
        if not entry.starts_trajectory or self._skip_first == 0.0 or self._arm.moving:
            return False
        return bool(np.all(np.abs(point.target - self._arm.position) < self._skip_first))

    def _done(self, entry: Entry) -> bool:
        if entry.rejection is not None:
            return self._answers_early or not self._arm.moving
        return entry.point is None or self._arm.done

    def _finish(self, entry: Entry) -> None:
        if entry.rejection is not None:
            if self._answers_early:
                self._current = None
            self._failed(entry, entry.rejection)
            return
        self._current = None
        self._answered(entry)
