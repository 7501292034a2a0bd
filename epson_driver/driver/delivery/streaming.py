# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming interface: each point is a request, and the next one is sent after its reply.

Messages are created shortly before they are sent. Therefore the first message is available
immediately, even for a long trajectory, and only one block of messages is in memory.
"""

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar, overload

import numpy as np
import numpy.typing as npt

from epson_driver.driver.delivery.delivery import (
    Delivery,
    DeliveryRules,
    OnReply,
    PreparedTrajectory,
)
from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.simple_message import (
    JointTrajPt,
    JointTrajPtFull,
    Message,
    MotionCtrl,
    MotionReply,
    Packet,
    SpecialSequence,
    ValidFields,
    joint_data,
)
from epson_driver.simple_message.motoman import Command, Result

Float32Array = npt.NDArray[np.float32]

FIRST_POINT_VELOCITY_FRACTION = 0.1  # for moving to a first point at 0 s, as in ROS-Industrial
MIN_DURATION_S = 1e-3  # minimum duration that is sent, s. Controllers may refuse 0
START_MARGIN_RAD = 1e-4  # within it a plan starts at the arm's position

LIMIT_MARGIN_RAD = 1e-6
"""Distance that is kept from the position limits, rad. It absorbs rounding errors of the
conversion to another joint convention."""

FULL_POINT_FIELDS = ValidFields.TIME | ValidFields.POSITION | ValidFields.VELOCITY
"""Fields of a JOINT_TRAJ_PT_FULL. Motoman requires these three, and does not use accelerations."""

BLOCK_POINTS = 256
"""Number of messages created together. This takes about 0.5 ms, hardly more than to create a few.
The first message is created separately, because the arm waits for it."""

STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)


MIN_VELOCITY = 1e-3  # minimum that is sent, a fraction or rad/s: controllers may refuse 0


def trajectory_points(
    trajectory: Trajectory,
    start: Array,
    limits: JointLimits,
    mapping: JointMapping,
    uses: FieldsUsed = FieldsUsed.BOTH,
    *,
    first: int = 0,
    end: int | None = None,
) -> list[JointTrajPt]:
    """Return the messages for the points `first` to `end` - 1 of a checked trajectory.

    `start`: position of the arm, shape (n,), rad. By default all points are converted.

    The field `duration` of a message is the duration of the segment that ends at its point. The
    field `velocity` is the speed of the fastest joint in this segment, as a fraction of its
    limit. This speed is the highest of the mean speed and the velocities at both ends. If the
    controller uses only the velocity (`uses`), it is the mean speed, so that the segment takes its
    planned time. A first point at 0 s is close to the arm, which moves to it at
    FIRST_POINT_VELOCITY_FRACTION.

    Both fields are always filled. A controller that uses a field contrary to its profile is then
    not faster than planned.
    """
    rows, times = trajectory.positions[first:end], trajectory.times[first:end]
    if first:
        before = slice(first - 1, first - 1 + len(rows))
        origins, start_times = trajectory.positions[before], trajectory.times[before]
    else:
        origins = np.concatenate([start[None, :], rows[:-1]])
        start_times = np.concatenate([[0.0], times[:-1]])
    steps = mapping.velocities_to_controller(rows - origins)
    durations = times - start_times
    timed = np.maximum(durations, MIN_DURATION_S)
    speeds = np.abs(steps) / timed[:, None]
    if trajectory.velocities is not None and uses is not FieldsUsed.VELOCITY:
        from_row = max(first - 1, 0)  # includes the velocity at the start of the first segment
        final = np.abs(mapping.velocities_to_controller(trajectory.velocities[from_row:end]))
        initial = final if first else np.vstack([np.zeros_like(final[:1]), final])
        speeds = np.maximum(np.maximum(speeds, final[-len(rows) :]), initial[: len(rows)])
    untimed = first == 0 and durations[0] == 0.0
    if untimed:
        distance = float(np.max(np.abs(steps[0]) / limits.velocity))
        timed[0] = max(distance / FIRST_POINT_VELOCITY_FRACTION, MIN_DURATION_S)
    velocities = np.max(speeds / limits.velocity, axis=1)
    if untimed:
        velocities[0] = FIRST_POINT_VELOCITY_FRACTION
    velocities = np.clip(velocities, MIN_VELOCITY, 1.0)
    values = zip(
        _to_wire(rows, limits, mapping).tolist(),
        velocities.tolist(),
        timed.tolist(),
        strict=True,
    )
    return [
        JointTrajPt(sequence, joint_data(point), velocity, duration)
        for sequence, (point, velocity, duration) in enumerate(values, first)
    ]


def full_points(
    trajectory: Trajectory,
    limits: JointLimits,
    mapping: JointMapping,
    *,
    first: int = 0,
    end: int | None = None,
) -> list[JointTrajPtFull]:
    """Return the points `first` to `end` - 1 of a trajectory with velocities."""
    if trajectory.velocities is None:
        raise ValueError('the trajectory has no velocities')
    block = slice(first, end)
    velocities = np.clip(trajectory.velocities[block], -limits.velocity, limits.velocity)
    rows = zip(
        trajectory.times[block].tolist(),
        _to_wire(trajectory.positions[block], limits, mapping).tolist(),
        mapping.velocities_to_controller(velocities).tolist(),
        strict=True,
    )
    return [
        JointTrajPtFull(
            0,
            sequence,
            FULL_POINT_FIELDS,
            time,
            joint_data(positions),
            joint_data(point_velocities),
        )
        for sequence, (time, positions, point_velocities) in enumerate(rows, first)
    ]


def from_standing(trajectory: Trajectory, start: Array, limits: JointLimits) -> Trajectory:
    """Return a trajectory whose first point, at 0 s, is the arm's position.

    `start`: position of the arm at rest, shape (n,), rad. A first point at 0 s within
    START_MARGIN_RAD of the arm is replaced by the arm's position. Otherwise the arm's position is
    inserted. If the trajectory starts at 0 s, all of its points are then delayed, so that the arm
    moves to the first of them at FIRST_POINT_VELOCITY_FRACTION of the velocity limits.
    """
    positions, times = trajectory.positions, trajectory.times
    if times[0] == 0.0:
        offset = np.abs(positions[0] - start)
        if offset.max() <= START_MARGIN_RAD:
            exact = positions.copy()
            exact[0] = start
            return Trajectory(
                trajectory.joint_names,
                times,
                exact,
                trajectory.velocities,
                trajectory.accelerations,
            )
        times = times + float(np.max(offset / limits.velocity)) / FIRST_POINT_VELOCITY_FRACTION
    rest = np.zeros((1, len(start)))
    velocities, accelerations = (
        None if values is None else np.vstack([rest, values])
        for values in (trajectory.velocities, trajectory.accelerations)
    )
    return Trajectory(
        trajectory.joint_names,
        np.concatenate([[0.0], times]),
        np.vstack([start[None, :], positions]),
        velocities,
        accelerations,
    )


def with_velocities(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory with velocities. Existing velocities are unchanged.

    A new velocity is 0 at both ends and where a joint reverses. At every other point it is the
    harmonic mean of the mean speeds before and after the point, so that a cubic interpolation does
    not overshoot.
    """
    if trajectory.velocities is not None:
        return trajectory
    positions, times = trajectory.positions, trajectory.times
    velocities = np.zeros_like(positions)
    slopes = np.diff(positions, axis=0) / np.diff(times)[:, None]
    before, after = slopes[:-1], slopes[1:]
    same = before * after > 0.0
    with np.errstate(divide='ignore', invalid='ignore'):
        velocities[1:-1] = np.where(same, 2.0 / (1.0 / before + 1.0 / after), 0.0)
    return Trajectory(trajectory.joint_names, times, positions, velocities)


def _to_wire(positions: Array, limits: JointLimits, mapping: JointMapping) -> Array:
    """Return positions in the controller's convention, as float32 values within the limits."""
    if mapping.identity:
        return to_float32_inside(positions, limits)
    inside = np.clip(
        positions, limits.position_min + LIMIT_MARGIN_RAD, limits.position_max - LIMIT_MARGIN_RAD
    )
    return mapping.positions_to_controller(inside).astype(np.float32).astype(np.float64)


def to_float32_inside(positions: Array, limits: JointLimits) -> Array:
    """Return positions rounded to float32 values within the position limits."""
    low, high = _float32_range(limits)
    return np.clip(positions.astype(np.float32), low, high).astype(np.float64)


@lru_cache(maxsize=16)
def _float32_range(limits: JointLimits) -> tuple[Float32Array, Float32Array]:
    low = limits.position_min.astype(np.float32)
    low = np.where(low < limits.position_min, np.nextafter(low, np.float32(np.inf)), low)
    high = limits.position_max.astype(np.float32)
    high = np.where(high > limits.position_max, np.nextafter(high, np.float32(-np.inf)), high)
    return low, high


M = TypeVar('M', bound=Message)


class LazyPoints(Sequence[M]):
    """A sequence of `count` messages that `make(first, end)` creates on access, in blocks."""

    def __init__(self, count: int, make: Callable[[int, int], Sequence[M]]) -> None:
        self._count = count
        self._make = make
        self._first = 0
        self._made: Sequence[M] = ()

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> M: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[M]: ...

    def __getitem__(self, index: int | slice) -> M | Sequence[M]:
        if isinstance(index, slice):
            return [self[item] for item in range(*index.indices(self._count))]
        offset = index - self._first
        if not 0 <= offset < len(self._made):
            offset = self._make_block(range(self._count)[index])
        return self._made[offset]

    def _make_block(self, index: int) -> int:
        """Create the block that contains message `index`. Return the message's index in it."""
        self._first = index - index % BLOCK_POINTS
        end = self._first + (BLOCK_POINTS if index else 1)
        self._made = self._make(self._first, min(end, self._count))
        return index - self._first


class Streaming(Delivery):
    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        def make(first: int, end: int) -> list[JointTrajPt]:
            return trajectory_points(
                trajectory,
                start,
                self._limits,
                self._mapping,
                self._rules.uses,
                first=first,
                end=end,
            )

        return PreparedTrajectory(trajectory, LazyPoints(len(trajectory.times), make))

    def setpoint(self, step: Trajectory, sequence: int) -> Message:
        if self.no_streams:
            return super().setpoint(step, sequence)
        velocities = None if step.velocities is None else step.velocities[1:]
        target = Trajectory(
            step.joint_names, step.times[1:] - step.times[0], step.positions[1:], velocities
        )
        (point,) = trajectory_points(
            target, step.positions[0], self._limits, self._mapping, self._rules.uses
        )
        if not sequence and self._rules.announces_streams:
            sequence = SpecialSequence.START_TRAJECTORY_STREAMING
        return replace(point, sequence=sequence)

    def post(self, message: Message, on_reply: OnReply) -> None:
        self._link.post(message, on_reply)


class FullStreaming(Streaming):
    no_streams = (  # an arm that is interpolated by time stops abruptly if a point is late
        'with point_message: joint_traj_pt_full the arm follows no setpoint streams, because the '
        'controller stops abruptly if a point is late: send trajectories'
    )

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return a message for the arm's position, and a message for each later point."""
        executed = with_velocities(from_standing(trajectory, start, self._limits))

        def make(first: int, end: int) -> list[JointTrajPtFull]:
            return full_points(executed, self._limits, self._mapping, first=first, end=end)

        return PreparedTrajectory(executed, LazyPoints(len(executed.times), make))


BUSY_RETRY_PERIOD_S = 0.01  # wait before a point is sent again, s. MotoROS' cycle is 4 ms


class MotomanDelivery(FullStreaming):
    """Points and STOP for a controller with MotoROS.

    * START_TRAJ_MODE switches the trajectory mode on. It is sent before the first point.
    * A point with the reply BUSY had no effect. It is sent again after BUSY_RETRY_PERIOD_S, until
      it is accepted or the goal is stopped.
    * STOP is sent as STOP_MOTION. The trajectory mode stays on.
    * MotoROS keeps its points when the client is lost, and executes them when a client connects
      again. The driver therefore sends STOP_MOTION first on each connection.
    """

    resumes = True
    keeps_points = True

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, rules)
        self._trajectory = 0  # number of trajectories and stops: older points are not sent again

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a point or STOP. START_TRAJ_MODE precedes the first point."""
        if message == STOP:
            self._trajectory += 1
            self._link.post(_command(Command.STOP_MOTION), on_reply)
        elif isinstance(message, JointTrajPtFull) and message.sequence == 0:
            self._trajectory += 1
            self._start(message, on_reply)
        else:
            self._post_point(message, on_reply)

    def _start(self, first: JointTrajPtFull, on_reply: OnReply) -> None:
        trajectory = self._trajectory

        def on_mode(packet: Packet, now: float) -> None:
            if reply_rejection(packet) is not None:
                on_reply(packet, now)
            elif trajectory == self._trajectory:
                with contextlib.suppress(ConnectionError):  # the lost link ends the goal
                    self._post_point(first, on_reply)

        self._link.post(_command(Command.START_TRAJ_MODE), on_mode)

    def _post_point(self, point: Message, on_reply: OnReply) -> None:
        trajectory = self._trajectory

        def again() -> None:
            if trajectory == self._trajectory:
                with contextlib.suppress(ConnectionError):
                    self._post_point(point, on_reply)

        def on_answer(packet: Packet, now: float) -> None:
            answer = packet.message
            if isinstance(answer, MotionReply) and answer.result == Result.BUSY:
                asyncio.get_running_loop().call_later(BUSY_RETRY_PERIOD_S, again)
            else:
                on_reply(packet, now)

        self._link.post(point, on_answer)


def _command(command: Command) -> MotionCtrl:
    return MotionCtrl(0, 0, command)
