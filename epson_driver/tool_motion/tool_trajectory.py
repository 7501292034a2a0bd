# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From lines and arcs of the tool to a trajectory of the joints, or why there is none.

The whole motion is looked at before any of it is sent: each joint must keep its velocity,
acceleration and jerk limits all the way. Near a singularity some joint would have to be very fast
for a short distance: that is refused with the joint and the place, or slow there if asked.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.joint_path import Look, joint_path
from epson_driver.tool_motion.path_timing import TimedRun, joined, timed
from epson_driver.tool_motion.pose_path import PosePath, Run, size_of
from epson_driver.tool_motion.speed_profile import PartLimits

JERK_PER_ACCELERATION = 10.0
"""The usual jerk of the tool as a multiple of its acceleration, 1/s: a ramp of 0.1 s."""

SIDEWAYS_SHARE = 0.8
"""How much of the acceleration a bend may take at most. At right angles to it, 0.6 are left for
speeding up and slowing down."""

TINY = 1e-12
"""Less of a derivative counts as this much."""

BEND_LOOKS = 33
"""At how many places of a part its bend is looked at."""


@dataclass(frozen=True, slots=True)
class ToolLimits:
    """How the tool may move, in m/s and m/s², and turn, in rad/s and rad/s².

    Both are kept in bends as well, where the speed is less for it.

    accuracy: how far the straight line in joint space between two points that are sent may be from
    the path, m. slow: go slower where a joint limit asks for it. jerk_ratio: the jerk, of the turn
    too, as a multiple of the acceleration, 1/s.
    """

    speed: float = 0.1
    acceleration: float = 1.0
    turn_speed: float = 1.0
    turn_acceleration: float = 10.0
    accuracy: float = 1e-4
    slow: bool = False
    jerk_ratio: float = JERK_PER_ACCELERATION

    def beside(self, other: 'ToolLimits') -> 'ToolLimits':
        """Return the tighter of these limits and others, for a blend between two motions."""
        least = [min(pair) for pair in zip(astuple(self), astuple(other), strict=True)]
        return ToolLimits(*least)


def runs_trajectory(
    kinematics: Kinematics,
    start: Array,
    path: Sequence[Run],
    tool: ToolLimits,
    look: Look = lambda: None,
) -> Trajectory:
    """Return a trajectory along the runs of a path, with a rest after each.

    It begins where the joints `start`, shape (n,), are, has velocities, and begins and ends at
    rest. Raises PathError that says what is in the way, at which place and for which joint; and
    as `joint_path`.
    """
    found: list[TimedRun] = []
    tools = [tool] * (path[-1].last + 1)
    for run in path:
        name = 'the way' if len(path) == 1 else f'the way to points[{run.last}]'
        begin = found[-1].positions[-1] if found else start
        found.append(timed_run(kinematics, begin, run, tools, name, look))
    return joined(kinematics.model.limits.names, found)[0]


def timed_run(
    kinematics: Kinematics,
    start: Array,
    run: Run,
    tools: Sequence[ToolLimits],
    name: str = 'the way',
    look: Look = lambda: None,
) -> TimedRun:
    """Return the points along a run. tools: how the tool may move in each segment, by index.

    In a blend it keeps the limits of both. Raises as `runs_trajectory`.
    """
    limits = []
    for part, owners in zip(run.parts, run.segments, strict=True):
        limits.append(_part_limits(part, tools[owners[0]].beside(tools[owners[-1]])))
    used = tools[run.segments[0][0] : run.last + 1]
    return timed(
        joint_path(kinematics, start, run, name, look),
        limits,
        run.ends,
        accuracy=min(tool.accuracy for tool in used),
        slow=all(tool.slow for tool in used),
    )


def _part_limits(part: PosePath, tool: ToolLimits) -> PartLimits:
    """Return the limits along a part, so that tool and turn keep theirs in bends."""
    size = size_of(part)
    powers = size ** np.arange(1, 4)[:, None]
    looks = np.array(
        [part.derivatives(share) / powers for share in np.linspace(0.0, 1.0, BEND_LOOKS).tolist()]
    )
    # per m (rad) of the path, its square and its cube: of the tool's position, and of its turn
    most = np.linalg.norm(looks.reshape(BEND_LOOKS, 3, 2, 3), axis=-1).max(axis=0)
    most = np.maximum(most, TINY)
    speed_limits = np.array([tool.speed, tool.turn_speed])
    urges = np.array([tool.acceleration, tool.turn_acceleration])
    speed = float(
        np.min(
            [
                speed_limits / most[0],
                np.sqrt(SIDEWAYS_SHARE * urges / most[1]),
                np.cbrt(tool.jerk_ratio * urges / most[2]),
            ]
        )
    )
    sideways = min(float(np.max(speed**2 * most[1] / urges)), SIDEWAYS_SHARE)
    acceleration = float(np.min(urges / most[0])) * np.sqrt(1.0 - sideways**2)
    return PartLimits(size, speed, acceleration, tool.jerk_ratio * acceleration)
