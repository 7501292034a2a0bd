# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One slow motion of a real arm, point by point, with measured times.

The controller is used directly, without the driver, so the measurements show the controller's
behaviour alone. Only small, slow motions inside the limits are sent, and a STOP ends every motion
that fails.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from epson_driver.doctor.listening import Conversation, ReceivedTraffic
from epson_driver.doctor.state_facts import is_joints, latest_joints, latest_status
from epson_driver.driver.delivery.statements import StatementDelivery
from epson_driver.driver.inhibit import seen_inhibit
from epson_driver.error_texts import ErrorTexts
from epson_driver.link.remote_link import RemoteLink
from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.simple_message import (
    JointFeedback,
    JointPosition,
    JointTrajPt,
    ReplyCode,
    SpecialSequence,
    Status,
    joint_data,
)

MOVED = 5e-4
"""Minimum displacement that counts as motion, rad or m."""

CBRT_MOVED = float(np.cbrt(MOVED))

REST_S = 0.5
"""Time without motion after which the arm counts as at rest, s."""

REST_TIMEOUT_S = 15.0
REPLY_TIMEOUT_S = 5.0
"""Maximum time from the planned end of a motion to a reply, s."""

MAX_SPEED = 0.1

MIN_VELOCITY = 0.01
"""Minimum velocity of a point, as a fraction of the maximum, because SPEL+ needs at least 1 %."""

FIRST_DURATION_S = 0.1
"""Duration of the first point, s. This point is at the current position."""

STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)


class NotMovedError(Exception):
    """The arm was not moved, or its motion was abandoned. The text is the reason."""


@dataclass
class TrialMove:
    """Records of one motion. Times: s on the loop's clock.

    * sent: when each point was sent.
    * answers: time and code of the reply to each point, or None without a reply.
    * stopped: when a STOP was sent, or None.
    * times, positions: data of the joint states, shape (k,), and shape (k, n), rad or m.
    * statuses: each STATUS with its time.
    """

    sent: list[float] = field(default_factory=list)
    answers: list[tuple[float, ReplyCode] | None] = field(default_factory=list)
    stopped: float | None = None
    times: Array = field(default_factory=lambda: np.empty(0))
    positions: Array = field(default_factory=lambda: np.empty((0, 0)))
    statuses: list[tuple[float, Status]] = field(default_factory=list)
    measured: bool = True
    """Whether joint states arrived during the motion. If none arrived, only the start and the end
    of the motion are known."""
    lateness: float = 0.0
    """Maximum delay of a timer on this machine, s, which is the uncertainty of the times."""

    @property
    def start(self) -> float | None:
        """Start time of the motion, or None if the arm did not move.

        The cube root of the distance is interpolated, because it is linear in time at constant
        jerk.
        """
        away = np.cbrt(np.abs(self.positions - self.positions[0]).max(axis=1))
        moved = np.flatnonzero(away > CBRT_MOVED)
        if not moved.size or not self.measured:
            return float(self.times[0]) if moved.size else None
        pair = slice(moved[0] - 1, moved[0] + 1)
        return float(np.interp(CBRT_MOVED, away[pair], self.times[pair]))

    @property
    def end(self) -> float:
        """Time when the arm came to rest, interpolated as in `start`."""
        away = np.cbrt(np.abs(self.positions - self.positions[-1]).max(axis=1))
        moved = np.flatnonzero(away > CBRT_MOVED)
        if not moved.size or not self.measured:
            return float(self.times[0 if self.measured else -1])
        pair = slice(moved[-1], moved[-1] + 2)
        return float(np.interp(-CBRT_MOVED, -away[pair], self.times[pair]))

    @property
    def moved(self) -> Array:
        return np.asarray(self.positions[-1] - self.positions[0])

    def since(self, true: Callable[[Status], bool]) -> float | None:
        return next((time for time, status in self.statuses if true(status)), None)


async def move_and_record(
    state: Conversation,
    motion: Conversation,
    model: RobotModel,
    errors: ErrorTexts,
    targets: Sequence[Array],
    durations: Sequence[float],
    stop_after: float | None = None,
) -> TrialMove:
    """Move to each target within its duration, and wait until the arm rests.

    `targets` have the shape (n,), rad or m, and `durations` are in s. `stop_after`: time from the
    first point with motion to a STOP, s. Raises NotMovedError before anything is sent if the arm
    cannot move, or if a target is outside the limits or too fast.
    """
    clock = asyncio.get_running_loop().time
    here = await _here(state, model, errors)
    _check(here, targets, durations, model)
    first = len(state.traffic.packets)
    made = TrialMove()
    motion.link.dialect = state.traffic.packets[-1][1].dialect
    stopping: asyncio.Task[None] | None = None
    try:
        points = [(here, FIRST_DURATION_S), *zip(targets, durations, strict=True)]
        before = here
        for sequence, (target, duration) in enumerate(points):
            speed = np.abs(target - before).max() / duration
            fraction = speed / float(model.limits.velocity.min())
            velocity = min(max(fraction, MIN_VELOCITY), 1.0)
            point = JointTrajPt(sequence, joint_data(target.tolist()), velocity, duration)
            made.sent.append(clock())
            if sequence == 1 and stop_after is not None:
                stopping = asyncio.create_task(_stop_after(motion, stop_after, made))
            reply = await motion.ask(point, REPLY_TIMEOUT_S + float(sum(durations)))
            made.answers.append(None if reply is None else (clock(), reply.reply_code))
            if reply is None or reply.reply_code is ReplyCode.FAILURE or made.stopped:
                break
            before = target
        if stopping is not None:
            await stopping
        if made.answers[-1] is None:
            motion.post(STOP)
        await _rest(state, len(model.joint_names))
    except BaseException:
        motion.post(STOP)
        raise
    finally:
        if stopping is not None:
            stopping.cancel()
    _take_over(made, state, first, len(model.joint_names))
    return made


async def move_by_statements(
    state: Conversation,
    moves: StatementDelivery,
    model: RobotModel,
    errors: ErrorTexts,
    targets: Sequence[Array],
    durations: Sequence[float],
    stop_after: float | None = None,
) -> TrialMove:
    """Move through the targets, with one Remote Ethernet statement for each target.

    Arguments and exceptions: see `move_and_record`. The controller replies to a statement when the
    arm is at its target. Before this reply, no joint states arrive.
    """
    clock, link = asyncio.get_running_loop().time, state.link
    assert isinstance(link, RemoteLink)  # noqa: S101 - for the type checker
    here = before = await _here(state, model, errors)
    _check(here, targets, durations, model)
    first, made = len(state.traffic.packets), TrialMove(sent=[clock()], measured=False)
    try:
        async with asyncio.timeout(REST_TIMEOUT_S + float(sum(durations))):
            for target, duration in zip(targets, durations, strict=True):
                needed = float(np.max(np.abs(target - before) / model.limits.velocity)) / duration
                made.sent.append(clock())
                reply = _moving(link, moves.joints(target, max(needed, MIN_VELOCITY), 0.1))
                if stop_after is not None:
                    await asyncio.wait([reply], timeout=stop_after)
                    made.stopped = clock()
                    link.abort(lambda _: None)
                code = (
                    ReplyCode.FAILURE if isinstance(await reply, Exception) else ReplyCode.SUCCESS
                )
                made.answers.append((clock(), code))
                before = target
                if code is ReplyCode.FAILURE:
                    break
    except TimeoutError:
        raise NotMovedError('no reply to a statement') from None
    finally:
        if link.connected and link.moving:
            link.abort(lambda _: None)
    count, ended = len(state.traffic.packets), clock()
    await state.wait_for_traffic(lambda traffic: _joints_after(traffic, count), REST_S * 4.0)
    _take_over(made, state, first, len(model.joint_names))
    after = latest_joints(state.traffic)
    there = here if after is None else np.array(after[: len(here)])
    made.times, made.positions = np.array([made.sent[1], ended]), np.array([here, there])
    return made


def _moving(link: RemoteLink, statement: str) -> asyncio.Future[str | Exception]:
    reply: asyncio.Future[str | Exception] = asyncio.get_running_loop().create_future()
    link.move(statement, lambda value: None if reply.done() else reply.set_result(value))
    return reply


def _joints_after(traffic: ReceivedTraffic, count: int) -> bool:
    return any(is_joints(packet) for _, packet in traffic.packets[count:])


async def _stop_after(motion: Conversation, seconds: float, made: TrialMove) -> None:
    await asyncio.sleep(seconds)
    made.stopped = asyncio.get_running_loop().time()
    motion.post(STOP)


async def _here(state: Conversation, model: RobotModel, errors: ErrorTexts) -> Array:
    if not await state.wait_for_traffic(
        lambda traffic: latest_status(traffic) and latest_joints(traffic), 5
    ):
        raise NotMovedError('no joint states or no STATUS received within 5 s')
    await _rest(state, len(model.joint_names))
    joints, status = latest_joints(state.traffic), latest_status(state.traffic)
    assert joints is not None  # noqa: S101 - both were waited for
    assert status is not None  # noqa: S101
    result = seen_inhibit(status, errors)
    if result is not None:
        raise NotMovedError(result.text)
    return np.array(joints[: len(model.joint_names)])


def _check(
    here: Array, targets: Sequence[Array], durations: Sequence[float], model: RobotModel
) -> None:
    low, high = model.limits.position_min, model.limits.position_max
    before = here
    for target, duration in zip(targets, durations, strict=True):
        speed = np.abs(target - before).max() / duration
        if not np.all(np.isfinite(target)) or (target < low).any() or (target > high).any():
            raise NotMovedError(f'a target is outside the limits of a {model.name}')
        if speed > MAX_SPEED:
            raise NotMovedError(f'speed = {speed:.3f} rad/s: must be at most {MAX_SPEED:g}')
        before = target


async def _rest(state: Conversation, joints: int) -> None:
    """Wait until the arm has been at rest for REST_S, or until `state` ends.

    Raises NotMovedError after a timeout.
    """
    clock = asyncio.get_running_loop().time
    until = clock() + REST_TIMEOUT_S
    while clock() < until:
        before = len(state.traffic.packets)
        ended = await state.ended_within(REST_S)
        seen = _positions(state, before, joints)[1]
        if ended or (len(seen) and np.abs(seen - seen[-1]).max() < MOVED):
            return
    raise NotMovedError(f'the arm did not come to rest within {REST_TIMEOUT_S:g} s')


def _positions(state: Conversation, first: int, joints: int) -> tuple[Array, Array]:
    seen = [
        (
            time,
            item.message.joints
            if isinstance(item.message, JointPosition)
            else item.message.positions,
        )
        for time, item in state.traffic.packets[first:]
        if isinstance(item.message, JointPosition | JointFeedback)
    ]
    return np.array([time for time, _ in seen]), np.array([item[:joints] for _, item in seen])


def _take_over(made: TrialMove, state: Conversation, first: int, joints: int) -> None:
    made.lateness = state.traffic.lateness
    made.times, made.positions = _positions(state, max(first - 1, 0), joints)
    made.statuses = [
        (time, item.message)
        for time, item in state.traffic.packets[first:]
        if isinstance(item.message, Status)
    ]


def ahead(made: TrialMove, joint: int, delay: float) -> float:
    """Return how many points were at most acknowledged but not yet reached by the arm.

    `joint`: the joint that moved. `delay`: the delay of replies, s.
    """
    if made.start is None:
        return 0.0
    distances = np.abs(made.positions[:, joint] - made.positions[0, joint])
    fraction = distances / distances[-1] * (len(made.sent) - 1)
    counts = [
        number - float(np.interp(answer[0] - delay, made.times, fraction))
        for number, answer in enumerate(made.answers)
        if answer is not None and answer[0] < made.end
    ]
    return max(counts, default=0.0)


def rests(made: TrialMove) -> int:
    if made.start is None:
        return 0
    inside = (made.times >= made.start) & (made.times <= made.end)
    times, positions = made.times[inside], made.positions[inside]
    slow = [
        np.abs(b - a).max() < 1e-5 and t - s > 0.0
        for (s, a), (t, b) in pairwise(zip(times, positions, strict=True))
    ]
    return sum(now and not before for before, now in pairwise([True, *slow]))
