# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A whole pick and place: three motions from rest to rest, with the gripper's work between them.

Every motion is judged as the controller will execute it: the points that are sent go through the
smoother as they will there, and each sample of what comes out must keep its distance.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.smoothed import smoothed
from epson_driver.motion.smoother import Mode
from epson_driver.planning.path import dense, line, rounded, thinned
from epson_driver.planning.path_search import find_path
from epson_driver.planning.scene import OBSTACLE_MARGIN_M, SELF_MARGIN_M, Check, Scene
from epson_driver.planning.task import Task, quarter_turns, raised
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics

LIMIT_SHARE = 0.6
"""The share of the joints' limits of velocity, acceleration and jerk that a plan uses."""

RANGE_MARGIN_RAD = 0.02
"""So far from the ends of their ranges the joints stay, rad (m: by Workspace.metric)."""

STRAIGHT_STEP_M = 0.004
"""Straight down and up is followed in steps of so much, m."""

MAX_STEP_RAD = 0.2
"""Joints that change more than this within such a step, rad, have jumped to another solution."""

POINT_SPACING_RAD = 0.12
"""Points for the smoother are so far apart, rad (over all joints, Euclidean)."""

MOTION_MARGIN_M = 0.005
"""The motion itself keeps so much away from obstacles, m, and its SELF_MARGIN_M from itself."""

POINT_PERIODS_S = (0.1, 0.06, 0.03)
"""Points that are sent are so far apart in time, s; the later ones if the motion through the
first ones comes too near to something.
"""

LOOK_AHEAD_S = 1.0
"""What the simulated controller knows ahead of the arm, s (its profile's motion.look_ahead)."""

MAX_SEARCHES = 5
"""So many ways are searched for one motion."""

MAX_GOALS = 3
"""So many of the joint positions for a pose are tried, the nearest first."""


class PlanningError(RuntimeError):
    """No plan was found. The text says which part of it failed."""


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion from rest to rest: the trajectory to send, and the arm's motion.

    `standing`: where the part stands meanwhile, as the pose of the hand that grips it; None: it
    is held. `reaches`: the pose that the hand has at the end, None for home.
    """

    name: str
    sent: Trajectory
    expected: Trajectory
    standing: Array | None
    reaches: Array | None


@dataclass(frozen=True, eq=False)
class Plan:
    """The motions of a task: the part is gripped after the first and let go after the second."""

    task: Task
    scene: Scene
    motions: tuple[Motion, ...]

    @property
    def duration(self) -> float:
        """How long the arm moves, s."""
        return sum(motion.sent.duration for motion in self.motions)


def plan_task(task: Task, model: RobotModel, tell: Callable[[str], object] = str) -> Plan:
    """Return a plan, the same for the same task. Raises PlanningError if there is none.

    `tell` hears what is being worked on.
    """
    return _Planner(task, model, tell).plan()


class _Planner:
    """Finds the paths of one task, from straight pieces and searches between them."""

    def __init__(self, task: Task, model: RobotModel, tell: Callable[[str], object]) -> None:
        self._task, self._tell = task, tell
        self._limits = model.limits
        self._scene = Scene(model, task.obstacles, task.part, task.supports)
        work = self._scene.workspace
        self._home, self._metric = work.home, work.metric
        self._approach, self._straight_step = work.approach, work.size * STRAIGHT_STEP_M
        margin = RANGE_MARGIN_RAD / self._metric
        self._inside = replace(
            model.limits,
            position_min=model.limits.position_min + margin,
            position_max=model.limits.position_max - margin,
        )
        self._gentle = replace(
            self._inside,
            velocity=LIMIT_SHARE * model.limits.velocity,
            acceleration=LIMIT_SHARE * model.limits.acceleration,
            jerk=LIMIT_SHARE * model.limits.jerk,
        )
        self._arm = Kinematics(model, work.hand.frame)
        self._searches = 0

    def plan(self) -> Plan:
        pick, place = self._task.pick, self._task.place
        home = self._home[None, :]
        if not self._check(pick).valid(home[0]):
            raise PlanningError('the arm would collide where it begins')
        failed = 'the part is out of reach'
        for down in self._descents(pick, home[0]):
            there = self._motion('to the part', home, down, standing=pick, reaches=pick)
            failed = 'no way to the part'
            if there is None:
                continue
            failed = 'the place is out of reach'
            for lower in self._descents(place, down[0]):
                carried = self._motion(
                    'to its place', down[::-1], lower, standing=None, reaches=place
                )
                failed = 'no way from the part to its place'
                if carried is None:
                    continue
                back = self._motion('home', lower[::-1], home, standing=place, reaches=None)
                failed = 'no way home'
                if back is not None:
                    return Plan(self._task, self._scene, (there, carried, back))
        raise PlanningError(failed)

    def _check(self, standing: Array | None, *, touching: bool = True) -> Check:
        return self._scene.check(
            standing, margin=OBSTACLE_MARGIN_M, self_margin=SELF_MARGIN_M, touching=touching
        )

    def _descents(self, pose: Array, near: Array) -> Iterator[Array]:
        """Yield straight paths down to a pose of tool0, shape (k, n), the nearest first.

        The arm may go each of them with the part in its hand and with the part standing there.
        """
        checks = self._check(None), self._check(pose)
        above = [
            (joints, turned)
            for turned in quarter_turns(pose)
            for joints in self._arm.inverse(raised(turned, self._approach), near)
        ]
        above.sort(key=lambda each: float(np.abs((each[0] - near) * self._metric).max()))
        found = 0
        for joints, turned in above:
            way = self._straight(joints, turned)
            if way is not None and all(check.path_valid(way) for check in checks):
                yield way
                found += 1
                if found == MAX_GOALS:
                    return

    def _straight(self, joints: Array, pose: Array) -> Array | None:
        """Return joint positions straight down to a pose, or None if the arm cannot go there."""
        way = [joints]
        steps = ceil(self._approach / self._straight_step)
        for height in np.linspace(self._approach, 0.0, steps + 1)[1:]:
            solutions = self._arm.inverse(raised(pose, float(height)), way[-1])
            if not len(solutions) or np.abs(solutions[0] - way[-1]).max() > MAX_STEP_RAD:
                return None
            way.append(solutions[0])
        inside = (way > self._inside.position_min) & (way < self._inside.position_max)
        return np.array(way) if inside.all() else None

    def _motion(
        self,
        name: str,
        begin: Array,
        end: Array,
        *,
        standing: Array | None,
        reaches: Array | None,
    ) -> Motion | None:
        """Return the motion along `begin`, a path, and `end`, each of shape (k, n), or None."""
        free = self._check(standing, touching=False)
        near = self._check(standing)
        metric = self._metric
        begin, end = begin * metric, end * metric
        range_ = replace(
            self._inside,
            position_min=self._inside.position_min * metric,
            position_max=self._inside.position_max * metric,
        )
        for _ in range(MAX_SEARCHES):
            self._searches += 1
            self._tell(f'{name}: search {self._searches}')
            seed = 1000 * self._task.seed + self._searches
            corners = find_path(
                begin[-1], end[0], range_, lambda joints: free.valid(joints / metric), seed
            )
            if corners is None:
                continue
            pieces = [piece for piece in (begin,) if len(piece) > 1]
            pieces += [line(one, other) for one, other in pairwise(corners)]
            pieces += [piece for piece in (end,) if len(piece) > 1]
            path = rounded(pieces, lambda piece: near.path_valid(piece / metric))
            knots = thinned(path, POINT_SPACING_RAD) / metric
            times = np.arange(len(knots), dtype=float)  # these do not count
            fast = smoothed(
                Trajectory(self._limits.names, times, knots),
                self._gentle,
                Mode.TIME_OPTIMAL,
                refine=False,  # as near to the path that was checked as the spline is
            )
            for period in POINT_PERIODS_S:
                sent = _every(fast, period)
                expected = smoothed(sent, self._limits, Mode.TIME_PRESERVING, LOOK_AHEAD_S)
                if self._keeps_away(expected, standing):
                    return Motion(name, sent, expected, standing, reaches)
        return None

    def _keeps_away(self, motion: Trajectory, standing: Array | None) -> bool:
        check = self._scene.check(standing, margin=MOTION_MARGIN_M, self_margin=SELF_MARGIN_M / 2)
        inside = (motion.positions >= self._limits.position_min) & (
            motion.positions <= self._limits.position_max
        )
        return bool(inside.all()) and check.path_valid(dense(motion.positions, self._metric))


def _every(motion: Trajectory, period: float) -> Trajectory:
    """Return points of a motion about `period` s apart, and its end."""
    count = max(round(motion.duration / period), 1)
    chosen = np.linspace(0, len(motion.times) - 1, count + 1).round().astype(int)
    assert motion.velocities is not None  # noqa: S101 - for the type checker
    velocities = motion.velocities[chosen]
    velocities[-1] = 0.0  # at rest but for rounding
    return Trajectory(
        motion.joint_names, motion.times[chosen], motion.positions[chosen], velocities
    )
