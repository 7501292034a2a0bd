# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""By hand: how fast the joints turn while a button is held, and the way of one step.

Axes are joints by number, or those of the tool: X Y Z along, U V W about Z, Y and X, of EPSON's
world or of the tool.
"""

import numpy as np
import numpy.typing as npt

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.panel.robot_state import RequestError
from epson_driver.robots import RobotModel
from epson_driver.robots.chain import rotation_about
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.robots.opw import KinematicsError

WORLD, TOOL = FRAMES = ('world', 'tool')

TOOL_AXES = ('X', 'Y', 'Z', 'U', 'V', 'W')

DIRECTIONS = {
    'X': (0, np.array([1.0, 0.0, 0.0])),
    'Y': (0, np.array([0.0, 1.0, 0.0])),
    'Z': (0, np.array([0.0, 0.0, 1.0])),
    'U': (1, np.array([0.0, 0.0, 1.0])),
    'V': (1, np.array([0.0, 1.0, 0.0])),
    'W': (1, np.array([1.0, 0.0, 0.0])),
}
"""Whether an axis turns, and about or along which direction of its frame."""

JOINT_SHARE = 0.25
"""Of a joint's velocity limit at full speed: the driver's `servo.scale`."""

TOOL_M_S, TOOL_RAD_S = 0.25, 0.8
"""Of the tool at full speed: the first is ISO 10218-1's reduced speed."""

NOT_REACHED = 0.02
"""Of a motion of the tool that joints of an arm do not make, as a share: it is refused."""

END = 0.005
"""So near to the end of its range, rad or m, a joint is not jogged outwards."""

STEP_SHARE = 0.2
"""Of the joints' velocity and acceleration limits, in a step at full speed."""

MAX_STEP_M, MAX_STEP_RAD = 0.1, np.radians(30.0)
MIN_STEP_S = 0.3
POINT_PERIOD_S = 0.05

PEAK_VELOCITY, PEAK_ACCELERATION = 1.875, 5.774
"""Of the polynomial of fifth degree that rests at both ends, for a way of 1 in 1 s."""

MAX_TURNS = 20
SAME_POSE = 1e-7
"""How near inverse kinematics come, m and rad."""


class Jog:
    """Motion by hand of one model. Joints have shape (n,), rad or m.

    All raise RequestError that says why the arm cannot go there.
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self.kinematics = Kinematics(model)
        self.axes = self._axes()
        """The axes of the tool that this arm has."""

    def velocities(self, joints: Array, axis: str, frame: str, share: float) -> Array:
        """Return the joints' velocities, shape (n,), for `share` of full speed, -1 … 1.

        axis: a joint's number from 1, or one of TOOL_AXES.
        """
        limits = self.model.limits
        if (index := self._joint(axis)) is not None:
            found = np.zeros(len(joints))
            found[index] = share * JOINT_SHARE * limits.velocity[index]
        else:
            found = share * self._joint_velocities(joints, self._twist(joints, axis, frame))
            allowed = JOINT_SHARE * limits.velocity
            found /= max(1.0, float(np.max(np.abs(found) / allowed)))  # the direction stays
        self._check_ends(joints, found)
        return found

    def step(self, joints: Array, axis: str, frame: str, size: float, share: float) -> Trajectory:
        """Return the way of a step: of a joint or of the tool, rad or m, straight in its space.

        share: of full speed, (0, 1].
        """
        index = self._joint(axis)
        turns = DIRECTIONS[axis][0] if index is None else self.model.limits.units[index] != 'm'
        most = MAX_STEP_RAD if turns else MAX_STEP_M
        if not 0.0 < abs(size) <= most:
            raise RequestError(f'a step of {size:g} is not within {most:.3g} rad or m')
        if index is not None:
            goal = joints.copy()
            goal[index] += size
            return self.way(np.linspace(joints, goal, 9), share)
        velocity = self._twist(joints, axis, frame)
        length = float(np.linalg.norm(velocity[:3]) or np.linalg.norm(velocity[3:]))
        return self.way(self._line(joints, velocity / length * size), share)

    def straight(self, joints: Array, goal: Array, share: float = 1.0) -> Trajectory:
        """Return the way to joint positions, straight in joint space."""
        return self.way(np.linspace(joints, goal, 9), share)

    def joints_at(self, point: Array, near: Array) -> Array:
        """Return the joints nearest to `near` at X Y Z U V W, shape (6,), mm and degrees."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_of_uvw(np.radians(point[3:]))
        pose[:3, 3] = point[:3] / 1e3
        try:
            found = self.kinematics.inverse(self.kinematics.from_base(pose), near)
        except KinematicsError as error:
            raise RequestError(f'its joints cannot be computed: {error}') from error
        if not len(found):
            raise RequestError('the arm does not reach it')
        return np.asarray(found[0])

    def way(self, path: Array, share: float) -> Trajectory:
        """Return how a path of joints, shape (k, n), is driven slowly, resting at both ends."""
        limits = self.model.limits
        path = limits.settled(path)  # an arm on its limit may be measured a rounding beyond it
        self._check_range(path)
        places = np.linspace(0.0, 1.0, len(path))
        slope = np.gradient(path, places, axis=0)
        fastest, change = np.abs(slope).max(axis=0), np.abs(path[-1] - path[0])
        duration = max(
            MIN_STEP_S,
            float(np.max(PEAK_VELOCITY * fastest / (share * STEP_SHARE * limits.velocity))),
            float(
                np.sqrt(
                    np.max(
                        PEAK_ACCELERATION
                        * np.maximum(fastest, change)
                        / (share * STEP_SHARE * limits.acceleration)
                    )
                )
            ),
        )
        s = np.linspace(0.0, 1.0, max(3, round(duration / POINT_PERIOD_S) + 1))
        along = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = 30.0 * (s * (1.0 - s)) ** 2 / duration
        positions, slopes, _ = Interpolation(places, path, slope).at(along)
        names = self.model.joint_names
        return Trajectory(names, duration * s, positions, slopes * rate[:, None])

    def _axes(self) -> tuple[str, ...]:
        """Return the axes along which the tool can move: of a SCARA, not V and W."""
        limits = self.model.limits
        joints = 0.5 * (limits.position_min + limits.position_max) + 0.3
        jacobian = self.kinematics.jacobian(joints)
        turned = np.linalg.matrix_rank(jacobian[3:], 1e-6) == 3
        return TOOL_AXES if turned else TOOL_AXES[:4]

    def _joint(self, axis: str) -> int | None:
        if axis in self.axes:
            return None
        if axis.isdecimal() and 1 <= int(axis[:3]) <= len(self.model.joint_names):
            return int(axis) - 1
        raise RequestError(f'{self.model.name} has no axis {axis[:20]}')

    def _twist(self, joints: Array, axis: str, frame: str) -> Array:
        """Return the tool's velocity at full speed, m/s and rad/s in base_link, shape (6,)."""
        turns, direction = DIRECTIONS[axis]
        pose = self.kinematics.forward(joints) if frame == TOOL else self.model.base.matrix
        turned = pose[:3, :3] @ direction
        if turns:
            return np.concatenate([np.zeros(3), TOOL_RAD_S * turned])
        return np.concatenate([TOOL_M_S * turned, np.zeros(3)])

    def _joint_velocities(self, joints: Array, twist: Array) -> Array:
        jacobian = self.kinematics.jacobian(joints)
        found = np.linalg.lstsq(jacobian, twist, rcond=1e-6)[0]
        if np.linalg.norm(jacobian @ found - twist) > NOT_REACHED * np.linalg.norm(twist):
            raise RequestError('the tool cannot move so from here: turn a joint first')
        return np.asarray(found)

    def _line(self, joints: Array, way: Array) -> Array:
        """Return joints along a straight way of the tool, shape (k, n), from where they are."""
        start = self.kinematics.forward(joints)
        angle = float(np.linalg.norm(way[3:]))
        found = [joints]
        for share in np.linspace(0.0, 1.0, 17)[1:]:
            pose = start.copy()
            pose[:3, 3] += share * way[:3]
            if angle:
                pose[:3, :3] = rotation_about(way[3:] / angle, share * angle) @ start[:3, :3]
            found.append(self._joints_at(pose, found[-1]))
        return np.array(found)

    def _joints_at(self, pose: Array, near: Array) -> Array:
        """Return the joints that bring the tool to a pose near by."""
        joints = near
        for _ in range(MAX_TURNS):
            now = self.kinematics.forward(joints)
            turn = pose[:3, :3] @ now[:3, :3].T
            skew = 0.5 * np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            )
            missing = np.concatenate([pose[:3, 3] - now[:3, 3], skew])
            if np.abs(missing).max() < SAME_POSE:
                return joints
            joints = (
                joints + np.linalg.lstsq(self.kinematics.jacobian(joints), missing, rcond=1e-6)[0]
            )
        raise RequestError('the tool cannot go there on a straight line')

    def _check_ends(self, joints: Array, velocities: Array) -> None:
        limits = self.model.limits
        out = (velocities > 0.0) & (joints > limits.position_max - END)
        out |= (velocities < 0.0) & (joints < limits.position_min + END)
        self._refuse(out)

    def _check_range(self, path: Array) -> None:
        limits = self.model.limits
        self._refuse(np.any((path < limits.position_min) | (path > limits.position_max), axis=0))

    def _refuse(self, out: npt.NDArray[np.bool_]) -> None:
        if np.any(out):
            name = self.model.joint_names[int(np.argmax(out))]
            raise RequestError(f'{name} is at the end of its range there')
