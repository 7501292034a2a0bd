# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts lines and arcs of the tool to a joint trajectory.

The whole motion is checked before execution: each joint must respect its velocity, acceleration
and jerk limits everywhere. Near a singularity, a joint would have to be very fast for a short
distance. Such a motion is refused, or slowed down near the singularity if requested.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.joint_path import BASE_LINK, Checkpoint, ShownFrame, joint_path
from epson_driver.tool_motion.path_timing import TimedRun, joined, timed
from epson_driver.tool_motion.pose_path import PosePath, Run, size_of
from epson_driver.tool_motion.speed_profile import PartLimits

JERK_PER_ACCELERATION = 10.0
"""Default ratio of the tool's jerk to its acceleration, 1/s. A ramp of the acceleration then takes
0.1 s."""

SIDEWAYS_FRACTION = 0.8
"""Maximum fraction of the acceleration limit that a bend uses. A fraction of 0.6 remains for
changes of speed, because their acceleration is at right angles to the acceleration in the bend."""

TINY = 1e-12
"""Lower bound of a derivative, which avoids divisions by 0."""

BEND_SAMPLES = 33


@dataclass(frozen=True, slots=True)
class ToolLimits:
    """Limits of the tool's motion, in m/s and m/s², and of its turn, in rad/s and rad/s².

    The speed is reduced in bends to respect the acceleration limit. accuracy: maximum distance of
    the tool from the path between two sent points, m. slow: whether to slow down where a joint
    limit requires it. jerk_ratio: ratio of the jerk to the acceleration limit, 1/s.
    """

    speed: float = 0.1
    acceleration: float = 1.0
    turn_speed: float = 1.0
    turn_acceleration: float = 10.0
    accuracy: float = 1e-4
    slow: bool = False
    jerk_ratio: float = JERK_PER_ACCELERATION

    def tightened_with(self, other: 'ToolLimits') -> 'ToolLimits':
        minimum = [min(pair) for pair in zip(astuple(self), astuple(other), strict=True)]
        return ToolLimits(*minimum)


def trajectory_along_runs(
    kinematics: Kinematics,
    start: Array,
    path: Sequence[Run],
    tool: ToolLimits,
    checkpoint: Checkpoint = lambda: None,
    frame: ShownFrame = BASE_LINK,
) -> Trajectory:
    """Return a timed trajectory with velocities along a path, with a rest after each run.

    checkpoint: called at every step of planning. It may raise to cancel. frame: for error texts.
    Raises PathError if the motion is impossible, or KinematicsError if the arm has no closed-form
    inverse kinematics.
    """
    result: list[TimedRun] = []
    tools = [tool] * (path[-1].last + 1)
    for run in path:
        name = 'the way' if len(path) == 1 else f'the path to points[{run.last}]'
        first = result[-1].positions[-1] if result else start
        result.append(timed_run(kinematics, first, run, tools, name, checkpoint, frame))
    return joined(kinematics.model.limits.names, result)[0]


def timed_run(
    kinematics: Kinematics,
    start: Array,
    run: Run,
    tools: Sequence[ToolLimits],
    name: str = 'the way',
    checkpoint: Checkpoint = lambda: None,
    frame: ShownFrame = BASE_LINK,
) -> TimedRun:
    """Return the timed points along a run that starts at the joint positions `start`.

    tools: limits of the tool in each segment. A blend respects the limits of both segments. name:
    for error texts. Raises the errors of `trajectory_along_runs`.
    """
    limits = []
    for part, owners in zip(run.parts, run.segments, strict=True):
        limits.append(_part_limits(part, tools[owners[0]].tightened_with(tools[owners[-1]])))
    used = tools[run.segments[0][0] : run.last + 1]
    return timed(
        joint_path(kinematics, start, run, name, checkpoint, frame),
        limits,
        run.ends,
        accuracy=min(tool.accuracy for tool in used),
        slow=all(tool.slow for tool in used),
    )


def _part_limits(part: PosePath, tool: ToolLimits) -> PartLimits:
    """Return the limits along a part of a path with which the tool respects its own limits."""
    size = size_of(part)
    powers = size ** np.arange(1, 4)[:, None]
    samples = np.array(
        [
            part.derivatives(fraction) / powers
            for fraction in np.linspace(0.0, 1.0, BEND_SAMPLES).tolist()
        ]
    )
    # derivatives of the tool's position and of its turn, per m (rad) of the path, its square, cube
    upper = np.linalg.norm(samples.reshape(BEND_SAMPLES, 3, 2, 3), axis=-1).max(axis=0)
    upper = np.maximum(upper, TINY)
    speed_limits = np.array([tool.speed, tool.turn_speed])
    acceleration_limits = np.array([tool.acceleration, tool.turn_acceleration])
    speed = float(
        np.min(
            [
                speed_limits / upper[0],
                np.sqrt(SIDEWAYS_FRACTION * acceleration_limits / upper[1]),
                np.cbrt(tool.jerk_ratio * acceleration_limits / upper[2]),
            ]
        )
    )
    sideways = min(float(np.max(speed**2 * upper[1] / acceleration_limits)), SIDEWAYS_FRACTION)
    acceleration = float(np.min(acceleration_limits / upper[0])) * np.sqrt(1.0 - sideways**2)
    return PartLimits(size, speed, acceleration, tool.jerk_ratio * acceleration)
