# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The members of a Robot that do not move the arm: measured state, tool, frames and poses."""

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from epson_driver.api import moves
from epson_driver.api.errors import PathError, checked_arguments, checked_timeout
from epson_driver.api.ownership import Unique
from epson_driver.api.poses import BASE, Frames, Pose, Tool, checked_tool
from epson_driver.api.status import RobotStatus, Sample
from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics
from epson_driver.taught_points import EpsonPoint, Posture, taught
from epson_driver.tool_motion.tool_pose import finite_numbers, quaternion_pose

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.driver.delivery.statements import Load
    from epson_driver.setup.setup import Setup

T = TypeVar('T')

MAX_ECCENTRICITY_M = 1.0
"""Distance of a payload's center from the flange axis. EPSON's arms allow 0.15 to 0.2 m."""


class Arm(Unique):
    """Measured state, tool and frames of an arm. Robot inherits all of these members."""

    def __init__(self, setup: 'Setup') -> None:
        from epson_driver.api.connection import Connection

        self._setup = setup
        self._connection = Connection(setup)
        self._kinematics = Kinematics(setup.model)
        self._hand = (Tool(np.eye(4)), self._kinematics)
        self._frames = Frames(setup.model.base.matrix, float(setup.model.reach[0]))

    @property
    def model(self) -> RobotModel:
        """The robot model: joint names, limits, frames."""
        return self._setup.model

    @property
    def status(self) -> RobotStatus:
        """State of the arm and its controller. It is available even while a link is down."""
        return self._connection.status

    @property
    def joints(self) -> Array:
        """Measured joint positions, shape (n,), rad (m). Raises RobotError if they are stale."""
        return self._connection.sample().positions.copy()

    @property
    def joint_velocities(self) -> Array:
        """Joint velocities, shape (n,), rad/s (m/s). Raises RobotError if they are stale."""
        return self._connection.sample().velocities.copy()

    def sample(self) -> Sample:
        """Return the newest sample: joints, time and state.

        Raises RobotError if the sample is stale.
        """
        return self._connection.stamped(self._connection.sample())

    @property
    def pose(self) -> Array:
        """Pose of the flange (tool0) in base_link: homogeneous matrix, shape (4, 4), m.

        Raises RobotError if the joints are stale.
        """
        return self._kinematics.forward(self._connection.sample().positions)

    @property
    def tool_pose(self) -> Array:
        """Pose of the tool in base_link: homogeneous matrix, shape (4, 4), m.

        Raises RobotError if the joints are stale.
        """
        return self._hand[1].forward(self._connection.sample().positions)

    @property
    def ros_pose(self) -> Array:
        """Pose of the tool in base_link: x y z, m, and a quaternion x y z w, shape (7,).

        Raises RobotError if the joints are stale.
        """
        return quaternion_pose(self.tool_pose)

    @property
    def epson_point(self) -> EpsonPoint:
        """Pose of the tool as shown on the teach pendant, in mm and degrees.

        Raises RobotError if the joints are stale.
        """
        return EpsonPoint.of(self.pose_in(BASE))

    def _taught(self) -> tuple[EpsonPoint, Posture | str]:
        """Return the tool's pose, and the arm's posture or why the posture is unknown."""
        return taught(self._hand[1], self._connection.sample().positions)

    @checked_arguments
    def pose_in(self, frame: str) -> 'Array':
        """Return the pose of the tool in a frame: homogeneous matrix, shape (4, 4), m.

        Raises ArgumentError if the frame is unknown, RobotError if the joints are stale.
        """
        return self._frames.pose_in(self.tool_pose, frame)

    # --- tool and frames --------------------------------------------------------------------

    @property
    def tool(self) -> Array:
        """Pose of the tool in the flange (tool0): homogeneous matrix, shape (4, 4), m."""
        return self._hand[0].pose.copy()

    @checked_arguments
    def set_tool(
        self,
        pose: 'Pose',
        *,
        max_speed: float | None = None,
        max_acceleration: float | None = None,
    ) -> None:
        """Set the tool (TCP) for lines, arcs and poses. The default is the flange.

        * pose: the tool in the flange (tool0), in any form that `move_line` accepts.
        * max_speed, max_acceleration: limits of the tool, m/s and m/s². A line, arc or path that
          exceeds one of them is rejected. None: no limit. Joint moves are not checked.

        A running motion is not affected. Raises ArgumentError if an argument is invalid.
        """
        tool = checked_tool(pose, max_speed, max_acceleration)
        self._hand = (tool, Kinematics(self.model, tool.pose))

    @checked_arguments
    def set_payload(
        self,
        mass: float,
        center: 'npt.ArrayLike' = (0.0, 0.0, 0.0),
        inertia: 'npt.ArrayLike' = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> None:
        """Set the payload (tool and part), which is sent to the controller with the next motion.

        The arguments correspond to geometry_msgs/Inertia in the flange (tool0). The SPEL+ settings
        Weight and Inertia are computed from them.

        * mass: mass of tool and part, kg.
        * center: center of mass, shape (3,), m.
        * inertia: moments about the center of mass, kg m²: ixx ixy ixz iyy iyz izz, or a (3, 3)
          matrix.

        Raises ArgumentError if an argument is invalid, RobotError if the controller's program sets
        the payload.
        """
        self._connection.set_load(_load(self.model, mass, center, inertia))

    @checked_arguments
    def forward(self, joints: 'npt.ArrayLike') -> 'Array':
        """Return the pose of the tool in base_link for joint positions, shape (n,), rad (m).

        The pose is a homogeneous matrix, shape (4, 4), m. Raises ArgumentError if the joint
        positions are invalid.
        """
        values = moves.joint_rows('joints', joints, self.model.limits, rows=False)
        return self._hand[1].forward(values)

    @checked_arguments
    def inverse(
        self, pose: 'Pose', *, frame: str | None = None, near: 'npt.ArrayLike | None' = None
    ) -> 'Array':
        """Return joint positions, shape (n,), rad (m), that bring the tool to a pose.

        pose, frame: see `move_line`. near: joint positions, shape (n,). The result is the solution
        nearest to them. None: the measured joints. Raises PathError if the pose is out of reach,
        ArgumentError if an argument is invalid, RobotError if the measured joints are stale.
        """
        if near is None:
            start = self._connection.sample().positions
        else:
            start = moves.joint_rows('near', near, self.model.limits, rows=False)
        return self._joints_at('pose', pose, frame, start)

    def _joints_at(self, field: str, pose: Pose, frame: str | None, near: Array) -> Array:
        arm = self._hand[1]
        target = self._frames.target(field, pose, frame).in_base_link(arm.forward(near))
        result = arm.inverse(target, near)
        if not len(result):
            place = self._frames.shown(frame, pose).text(target[:3, 3])
            reason = arm.why_unreachable(target) or 'out of reach'
            raise PathError(f'{field}: no joint positions for {place}: {reason}')
        return np.asarray(result[0])

    @property
    def frames(self) -> dict[str, Array]:
        """Poses of all named frames in base_link: homogeneous matrices, shape (4, 4), m."""
        return self._frames.poses

    @checked_arguments
    def set_frame(self, name: str, pose: 'Pose', *, parent: str | None = None) -> None:
        """Set a named frame by its pose in another frame, in any form that `move_line` accepts.

        parent: the other frame. It may be any `frame` of `move_line` except 'tool'. A later change
        of the parent does not move this frame. Raises ArgumentError if an argument is invalid.
        """
        self._frames.set(name, pose, parent)

    async def catch_up(self) -> None:
        """Process received messages until the joints are fresh, for at most half a second.

        Call it before reading joints if the program has blocked the event loop, or if the machine
        is busy, because newer joint messages may be unread.
        """
        await self._connection.wait_for_fresh_state()

    @checked_arguments
    async def measured(self, read: Callable[[], T]) -> T:
        """Call `catch_up`, then return the result of `read`.

        Example: `await robot.measured(lambda: robot.joints)`. A delay of this process between
        `catch_up` and `read` does not make the joints stale.
        """
        return await self._connection.measured(read)

    @checked_arguments
    async def wait_until(
        self, condition: Callable[[Sample], bool], timeout: float | None = None
    ) -> Sample:
        """Wait for a sample that meets a condition, and return that sample.

        Raises TimeoutError after `timeout` s, RobotError if the joints become stale.
        """
        try:
            async with asyncio.timeout(checked_timeout(timeout)):
                while not condition(sample := await self.measured(self.sample)):
                    await self._connection.next_joints()
        except TimeoutError as error:
            raise TimeoutError(f'condition not met within {timeout:g} s') from error
        return sample


def _load(model: RobotModel, mass: float, center: npt.ArrayLike, inertia: npt.ArrayLike) -> 'Load':
    """Convert the arguments of `Robot.set_payload`. Raises ValueError if one is invalid."""
    from epson_driver.driver.delivery.statements import Load

    weight = model.checked_payload(mass, 'mass')
    place = finite_numbers('center', center)
    if place.shape != (3,):
        raise ValueError(f'center has shape {place.shape}: must be (3,), x y z in m')
    about = finite_numbers('inertia', inertia)
    if about.shape == (6,):
        ixx, ixy, ixz, iyy, iyz, izz = about.tolist()
        about = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    if about.shape != (3, 3):
        raise ValueError(
            f'inertia has shape {about.shape}: must be (6,), ixx ixy ixz iyy iyz izz, or (3, 3)'
        )
    if (np.diag(about) < 0.0).any():
        diagonal = np.diag(about).tolist()
        raise ValueError(f'inertia: its diagonal is {diagonal}: must not be negative')
    distance = float(np.hypot(*place[:2]))
    if distance > MAX_ECCENTRICITY_M:
        raise ValueError(
            f'center is {distance:g} m from the flange axis: must be at most '
            f'{MAX_ECCENTRICITY_M:g} (x and y in m, not mm)'
        )
    return Load(weight, float(about[2, 2]) + weight * distance**2, distance)
