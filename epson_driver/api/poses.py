# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Poses, waypoints and tools as arguments of a Robot, and the named frames of the poses.

A ValueError names the argument (`field`), the invalid value and the allowed values.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.inputs import number
from epson_driver.motion import Array
from epson_driver.taught_points import EpsonPoint, plain
from epson_driver.tool_motion.joint_path import ShownFrame
from epson_driver.tool_motion.tool_pose import (
    PLACE,
    check_tool_distance,
    finite_numbers,
    homogeneous,
    pose_of_quaternion,
)

BASE_LINK, BASE, TOOL = 'base_link', 'base', 'tool'
"""The built-in frames: the arm's base_link, EPSON's world, and the current tool frame."""

ROUNDING = 1e-4
"""Maximum difference between R Rᵀ of a rotation matrix R and the unit matrix. An accepted matrix
is replaced by the nearest exact rotation."""

MM_SUSPICION = 10.0
"""Distance, in multiples of the arm's reach, above which a position is suspected to be in mm."""

Pose = npt.ArrayLike | EpsonPoint
"""x y z (m) and a quaternion x y z w (ROS order), a homogeneous matrix (m), or an EPSON point."""


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A pose in the path of `move_path`.

    * via: a point, x y z in m, through which the tool moves on an arc. None: it moves on a line.
    * blend: distance from the pose, m, within which the tool may cut the corner. 0: the tool stops
      at the pose. None: the blend of `move_path`.
    * frame: the frame of pose and via. None: the frame of `move_path`.
    """

    pose: 'Pose'
    via: 'npt.ArrayLike | None' = None
    blend: float | None = None
    frame: str | None = None


@dataclass(frozen=True, eq=False)
class Target:
    """A pose, shape (4, 4), m.

    It is in base_link or, if `in_tool`, in the tool frame at the start of the motion.
    """

    pose: Array
    in_tool: bool = False

    def in_base_link(self, tool: Array) -> Array:
        """Return the pose in base_link. tool: the pose of the tool at the start, shape (4, 4)."""
        return np.asarray(tool @ self.pose) if self.in_tool else self.pose


@dataclass(frozen=True, eq=False)
class Tool:
    """A tool: its pose in tool0, shape (4, 4), m, and its limits for lines and arcs.

    max_speed (m/s), max_acceleration (m/s²): None for no limit.
    """

    pose: Array
    max_speed: float | None = None
    max_acceleration: float | None = None

    def check(self, speed: float, acceleration: float) -> None:
        """Raise ValueError if `speed`, m/s, or `acceleration`, m/s², exceeds the tool's limits."""
        for name, value, maximum, unit in (
            ('speed', speed, self.max_speed, 'm/s'),
            ('acceleration', acceleration, self.max_acceleration, 'm/s²'),
        ):
            if maximum is not None and value > maximum:
                raise ValueError(f'{name} = {value:g} {unit}: the tool allows {maximum:g} {unit}')


def checked_tool(pose: Pose, max_speed: float | None, max_acceleration: float | None) -> Tool:
    """Return the tool for arguments of `set_tool`. Raises ValueError if one is invalid."""
    checked = checked_pose('pose', pose)
    check_tool_distance('pose', checked)
    limits = {'max_speed': max_speed, 'max_acceleration': max_acceleration}
    for name, value in limits.items():
        if value is not None:
            limits[name] = _LIMITS[name].checked(plain(value), name)
    return Tool(checked, **limits)


class Frames:
    """Named frames, stored as poses in base_link, shape (4, 4), m."""

    def __init__(self, base: Array, reach: float) -> None:
        """Store the pose of EPSON's world in base_link, shape (4, 4), and the arm's reach, m."""
        self._poses = {BASE_LINK: np.eye(4), BASE: base}
        self._reach = reach

    @property
    def poses(self) -> dict[str, Array]:
        """Copies of all frames except 'tool', by name."""
        return {name: pose.copy() for name, pose in self._poses.items()}

    def shown(self, frame: str | None, pose: Pose) -> ShownFrame:
        """Return the frame of `pose` for error texts. For the frame 'tool', it is base_link."""
        name = _frame_of(frame, pose)
        return ShownFrame() if name == TOOL else ShownFrame(name, np.linalg.inv(self._poses[name]))

    def set(self, name: str, pose: Pose, parent: str | None) -> None:
        """Set a frame by its pose in a parent frame. Raises ValueError for invalid arguments."""
        if not isinstance(name, str) or not name:
            raise ValueError(f'name = {name!r}: must be a string, not empty')
        if name in (BASE_LINK, BASE, TOOL):
            raise ValueError(f'name = {name!r}: this frame is built in, use another name')
        checked = checked_pose('pose', pose)
        self._poses[name] = self._pose_of(_frame_of(parent, pose), 'parent', []) @ checked

    def target(self, field: str, pose: Pose, frame: str | None) -> Target:
        """Return a pose in a frame as a Target. frame: None for the default of `_frame_of`."""
        return self._placed(checked_pose(field, pose), _frame_of(frame, pose), field)

    def point(self, field: str, xyz: npt.ArrayLike, frame: str | None, pose: Pose) -> Target:
        """Return a point, x y z in m, as a Target whose orientation has no meaning."""
        place = finite_numbers(field, xyz)
        if place.shape != (3,):
            raise ValueError(f'{field} has shape {place.shape}: must be (3,), x y z in m')
        return self._placed(homogeneous(np.eye(3), place), _frame_of(frame, pose), field)

    def pose_in(self, pose: Array, frame: str) -> Array:
        """Convert a pose from base_link to a frame. Raises ValueError if the frame is unknown."""
        return np.asarray(np.linalg.inv(self._pose_of(frame, 'frame', [])) @ pose)

    def _placed(self, pose: Array, frame: str, field: str) -> Target:
        in_tool = frame == TOOL
        placed = pose if in_tool else self._pose_of(frame, 'frame', [TOOL]) @ pose
        self._check_near(field, placed)
        return Target(placed, in_tool)

    def _pose_of(self, frame: str, where: str, more: list[str]) -> Array:
        """Return a frame's pose in base_link.

        where, more: argument name and further valid values for the text of the ValueError.
        """
        if not isinstance(frame, str) or frame not in self._poses:
            *names, last = [*self._poses, *more]
            raise ValueError(f'{where} = {frame!r}: must be {", ".join(names)} or {last}')
        return self._poses[frame]

    def _check_near(self, field: str, pose: Array) -> None:
        away = float(np.linalg.norm(pose[:3, 3]))
        if away > MM_SUSPICION * self._reach:
            raise ValueError(
                f'{field}: {away:.4g} m away, but the arm reaches {self._reach:.4g} m: '
                'positions are in m (in mm only in an EpsonPoint)'
            )


def checked_pose(field: str, values: Pose) -> Array:
    """Return a pose as a homogeneous matrix, shape (4, 4), m. Raises ValueError if invalid."""
    if isinstance(values, EpsonPoint):
        return values.pose
    array = finite_numbers(field, values, PLACE)
    if array.shape == (7,):
        return pose_of_quaternion(field, array)
    if array.shape != (4, 4):
        raise ValueError(
            f'{field} has shape {array.shape}: must be (4, 4), a homogeneous matrix, or (7,), x y '
            'z and a quaternion x y z w; for X Y Z U V W take an EpsonPoint'
        )
    turn = array[:3, :3]
    if (
        np.abs(turn @ turn.T - np.eye(3)).max() > ROUNDING
        or np.linalg.det(turn) < 0.0
        or np.abs(array[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9
    ):
        raise ValueError(
            f'{field}: must be a rotation and a position, with 0 0 0 1 in its last row'
        )
    u, _, vt = np.linalg.svd(turn)
    return homogeneous(u @ vt, array[:3, 3])


def is_pose(values: Pose, joints: int) -> bool:
    """Return whether values have the form of a pose, not of the positions of `joints` joints."""
    if isinstance(values, EpsonPoint):
        return True
    try:
        shape = np.shape(values)
    except ValueError:  # rows of different lengths
        return False
    return shape == (4, 4) or (shape == (7,) and joints != 7)


_LIMITS = {
    'max_speed': number(1e-5, 100.0, 'm/s'),
    'max_acceleration': number(1e-4, 1000.0, 'm/s²'),
}


def _frame_of(frame: str | None, pose: Pose) -> str:
    """Return the frame of a pose. Default: EPSON's world for an EpsonPoint, else base_link."""
    if frame is not None:
        return frame
    return BASE if isinstance(pose, EpsonPoint) else BASE_LINK
