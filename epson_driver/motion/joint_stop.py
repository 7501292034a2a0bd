# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest stop of every joint separately, for an arm that does not move on a line.

A joint that moves within its limits can always stop within them if it may reverse, because maximum
braking never goes farther than the current motion. A stop without reversal may go farther, since
its deceleration must end with it. If that would pass a position limit, the joint reverses.
"""

import numpy as np
from ruckig import ControlInterface, InputParameter
from ruckig import Trajectory as RuckigTrajectory

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.point_to_point import calculated, solve

MAX_ATTEMPTS = 40
"""Number of reversals that are tried, each twice as long as the last, from `MIN_WAY_BACK`."""

MIN_WAY_BACK = 1e-9
POSITION_TOLERANCE = 1e-12
"""Tolerance of the position limits, rad."""


class JointStop:
    """A stop as a function of the time since its start. `duration` is in s, `end` in rad."""

    def __init__(self, trajectories: list[RuckigTrajectory]) -> None:
        self.trajectories = trajectories
        self.duration: float = max(trajectory.duration for trajectory in trajectories)
        self.end: Array = np.array(
            [trajectory.at_time(trajectory.duration)[0][0] for trajectory in trajectories]
        )

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration of each joint at `time` ≥ 0, shapes (n,)."""
        if time >= self.duration:
            zeros = np.zeros_like(self.end)
            return self.end.copy(), zeros, zeros.copy()
        states = np.array(
            [
                trajectory.at_time(min(max(time, 0.0), trajectory.duration))
                for trajectory in self.trajectories
            ]
        )
        return states[:, 0, 0], states[:, 1, 0], states[:, 2, 0]


def stop_joints(
    limits: JointLimits, position: Array, velocity: Array, acceleration: Array
) -> JointStop:
    """Return the stop of joints that move within the limits, in shapes (n,)."""
    states = zip(position, velocity, acceleration, strict=True)
    return JointStop([_stop(limits, joint, state) for joint, state in enumerate(states)])


def _stop(limits: JointLimits, joint: int, state: tuple[float, float, float]) -> RuckigTrajectory:
    low = min(limits.position_min[joint], state[0]) - POSITION_TOLERANCE
    high = max(limits.position_max[joint], state[0]) + POSITION_TOLERANCE
    inp = InputParameter(1)
    inp.max_velocity = [limits.velocity[joint]]
    inp.max_acceleration = [limits.acceleration[joint]]
    inp.max_jerk = [limits.jerk[joint]]
    (inp.current_position, inp.current_velocity, inp.current_acceleration) = (
        [value] for value in state
    )
    inp.target_velocity = [0.0]
    inp.control_interface = ControlInterface.Velocity
    trajectory = solve(inp)
    if _within(trajectory, low, high):
        return trajectory
    end = trajectory.at_time(trajectory.duration)[0][0]
    limit, inward = (high, -1.0) if end > high or state[1] > 0.0 else (low, 1.0)
    inp.control_interface = ControlInterface.Position
    for attempt in range(MAX_ATTEMPTS):
        target = limit + inward * MIN_WAY_BACK * 2.0**attempt
        if not low <= target <= high:
            break
        inp.target_position = [target]
        back = calculated(inp)
        if back is not None and _within(back, low, high):
            return back
    return trajectory


def _within(trajectory: RuckigTrajectory, low: float, high: float) -> bool:
    (extrema,) = trajectory.position_extrema
    return bool(extrema.min >= low and extrema.max <= high)
