# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Jogging: joint velocities while a button is pressed, and the trajectory of a single step.

An axis is a joint, by number, or an axis of EPSON's world frame or of the tool frame: X, Y, Z for
translation along it, and U, V, W for rotation about Z, Y, X.
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
"""Axis → 1 for a rotation or 0 for a translation, and the direction of the axis in the frame."""

JOINT_FRACTION = 0.25  # full speed / velocity limit of a joint: the default of `servo.scale`
TOOL_M_S, TOOL_RAD_S = 0.25, 0.8  # full jog speeds of the tool (0.25 m/s: ISO 10218-1)
MAX_TWIST_ERROR = 0.02
"""Maximum relative error of the tool's velocity. A jog with a larger error is refused."""

END = 0.005  # distance from an end of its range at which a joint's jog ends, rad or m
STEP_FRACTION = 0.2  # used fraction of velocity and acceleration limits in a step at full speed
MAX_STEP_M, MAX_STEP_RAD = 0.1, np.radians(30.0)
MIN_STEP_S = 0.3  # minimum duration of a step, s
POINT_PERIOD_S = 0.05  # time between the points of a step's trajectory, s
PEAK_VELOCITY, PEAK_ACCELERATION = 1.875, 5.774
"""Peak velocity and peak acceleration of a quintic polynomial from rest to rest. They are for a
distance of 1 unit in 1 s."""

MAX_ITERATIONS = 20
MAX_POSE_ERROR = 1e-7  # tolerance of the inverse kinematics, m and rad


class Jog:
    """Computes the jog motions of one model. Joints have the shape (n,), rad or m.

    Methods raise RequestError if the motion is impossible.
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self.kinematics = Kinematics(model)
        self.axes = self._axes()  # the axes of the tool that this arm can move

    def velocities(self, joints: Array, axis: str, frame: str, fraction: float) -> Array:
        """Return the joint velocities of a jog, shape (n,), rad/s or m/s.

        * axis: the number of a joint from 1, or one of TOOL_AXES.
        * frame: WORLD or TOOL, the frame of a tool axis.
        * fraction: fraction of full speed, -1 … 1.
        """
        limits = self.model.limits
        if (index := self._joint(axis)) is not None:
            result = np.zeros(len(joints))
            result[index] = fraction * JOINT_FRACTION * limits.velocity[index]
        else:
            result = fraction * self._joint_velocities(joints, self._twist(joints, axis, frame))
            allowed = JOINT_FRACTION * limits.velocity
            result /= max(1.0, float(np.max(np.abs(result) / allowed)))  # keeps the direction
        out = (result > 0.0) & (joints > limits.position_max - END)
        self._refuse(out | ((result < 0.0) & (joints < limits.position_min + END)))
        return result

    def step(
        self, joints: Array, axis: str, frame: str, size: float, fraction: float
    ) -> Trajectory:
        """Return the trajectory of a step of a joint, or of the tool on a straight line.

        * axis, frame: as in `velocities`.
        * size: the displacement, rad or m.
        * fraction: fraction of full speed, (0, 1].
        """
        index = self._joint(axis)
        turns = DIRECTIONS[axis][0] if index is None else self.model.limits.units[index] != 'm'
        maximum = MAX_STEP_RAD if turns else MAX_STEP_M
        if not 0.0 < abs(size) <= maximum:
            raise RequestError(f'step = {size:g}: must be within {maximum:.3g} rad or m')
        if index is not None:
            goal = joints.copy()
            goal[index] += size
            return self.straight(joints, goal, fraction)
        velocity = self._twist(joints, axis, frame)
        length = float(np.linalg.norm(velocity[:3]) or np.linalg.norm(velocity[3:]))
        return self.along(self._line(joints, velocity / length * size), fraction)

    def straight(self, joints: Array, goal: Array, fraction: float = 1.0) -> Trajectory:
        """Return the straight trajectory in joint space from `joints` to `goal`."""
        return self.along(np.linspace(joints, goal, 9), fraction)

    def joints_at(self, point: Array, near: Array) -> Array:
        """Return the joint positions nearest to `near` that bring the tool to a point.

        `point`: X, Y, Z, mm, and U, V, W, degrees, in EPSON's world frame, shape (6,).
        """
        pose = np.eye(4)
        pose[:3, :3] = rotation_of_uvw(np.radians(point[3:]))
        pose[:3, 3] = point[:3] / 1e3
        try:
            result = self.kinematics.inverse(self.kinematics.from_base(pose), near)
        except KinematicsError as error:
            raise RequestError(f'cannot compute joint positions for this pose: {error}') from error
        if not len(result):
            raise RequestError('the point is out of reach: no joint positions lead to it')
        return np.asarray(result[0])

    def along(self, path: Array, fraction: float) -> Trajectory:
        """Return a trajectory along a joint path that starts and ends at rest.

        `path`: shape (k, n). `fraction`: fraction of full speed, (0, 1].
        """
        limits = self.model.limits
        path = limits.settled(path)  # an arm at its limit may be measured slightly beyond it
        self._refuse(np.any((path < limits.position_min) | (path > limits.position_max), axis=0))
        places = np.linspace(0.0, 1.0, len(path))
        slope = np.gradient(path, places, axis=0)
        fastest, change = np.abs(slope).max(axis=0), np.abs(path[-1] - path[0])
        used = fraction * STEP_FRACTION
        coasting = PEAK_VELOCITY * fastest / (used * limits.velocity)
        speeding = PEAK_ACCELERATION * np.maximum(fastest, change) / (used * limits.acceleration)
        duration = max(MIN_STEP_S, float(np.max(coasting)), float(np.sqrt(np.max(speeding))))
        s = np.linspace(0.0, 1.0, max(3, round(duration / POINT_PERIOD_S) + 1))
        along = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = 30.0 * (s * (1.0 - s)) ** 2 / duration
        positions, slopes, _ = Interpolation(places, path, slope).at(along)
        names = self.model.joint_names
        return Trajectory(names, duration * s, positions, slopes * rate[:, None])

    def _axes(self) -> tuple[str, ...]:
        """Return the axes of the tool that the arm can move. A SCARA has no V and W."""
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
        """Return the tool's velocity at full speed in base_link, m/s and rad/s, shape (6,)."""
        turns, direction = DIRECTIONS[axis]
        pose = self.kinematics.forward(joints) if frame == TOOL else self.model.base.matrix
        turned = pose[:3, :3] @ direction
        if turns:
            return np.concatenate([np.zeros(3), TOOL_RAD_S * turned])
        return np.concatenate([TOOL_M_S * turned, np.zeros(3)])

    def _joint_velocities(self, joints: Array, twist: Array) -> Array:
        jacobian = self.kinematics.jacobian(joints)
        result = np.linalg.lstsq(jacobian, twist, rcond=1e-6)[0]
        if np.linalg.norm(jacobian @ result - twist) > MAX_TWIST_ERROR * np.linalg.norm(twist):
            raise RequestError(
                'the tool cannot move in this direction from here: move a joint first'
            )
        return np.asarray(result)

    def _line(self, joints: Array, displacement: Array) -> Array:
        """Return joint positions along a straight path of the tool from `joints`, shape (k, n).

        `displacement`: translation, m, and rotation vector, rad, in base_link, shape (6,).
        """
        start = self.kinematics.forward(joints)
        angle = float(np.linalg.norm(displacement[3:]))
        result = [joints]
        for fraction in np.linspace(0.0, 1.0, 17)[1:]:
            pose = start.copy()
            pose[:3, 3] += fraction * displacement[:3]
            if angle:
                turn = rotation_about(displacement[3:] / angle, fraction * angle)
                pose[:3, :3] = turn @ start[:3, :3]
            result.append(self._joints_at(pose, result[-1]))
        return np.array(result)

    def _joints_at(self, pose: Array, near: Array) -> Array:
        """Return joint positions, shape (n,), that bring the tool to a pose.

        The positions are found by iteration from `near`.
        """
        joints = near
        for _ in range(MAX_ITERATIONS):
            now = self.kinematics.forward(joints)
            turn = pose[:3, :3] @ now[:3, :3].T
            skew = 0.5 * np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            )
            error = np.concatenate([pose[:3, 3] - now[:3, 3], skew])
            if np.abs(error).max() < MAX_POSE_ERROR:
                return joints
            jacobian = self.kinematics.jacobian(joints)
            joints = joints + np.linalg.lstsq(jacobian, error, rcond=1e-6)[0]
        raise RequestError(
            'the tool cannot reach this pose on a straight line: move a joint first'
        )

    def _refuse(self, out: npt.NDArray[np.bool_]) -> None:
        if np.any(out):
            name = self.model.joint_names[int(np.argmax(out))]
            raise RequestError(f'{name} is at the end of its range in this direction')
