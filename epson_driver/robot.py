# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Python API. It needs no ROS, and contains the same driver as the ROS 2 node.

    with Robot('192.168.0.1', controller='spel', model='c4_a601s') as robot:
        robot.enable()
        robot.move_joints([0.0, 0.3, -0.2, 0.0, 0.5, 0.0], speed=0.2)

Several threads may use a Robot. Angles are in rad, lengths in m, times in s. docs/python.md
describes the API. The classes are derived from epson_driver.aio, the same API for asyncio.
"""

from functools import partial
from types import TracebackType
from typing import Self

from epson_driver import aio
from epson_driver.api.errors import ArgumentError, MotionError, PathError, RobotError
from epson_driver.api.io import GripperState, GripperWiring
from epson_driver.api.poses import Waypoint
from epson_driver.api.recording import Recording
from epson_driver.api.settings import Settings
from epson_driver.api.status import ControllerError, RobotStatus, Sample
from epson_driver.api.synchronous import (
    Gripper,
    Io,
    Motion,
    Points,
    Simulation,
    Synchronous,
    calls,
    makes,
    measured,
    moves,
    reads,
    registers,
    waits,
)
from epson_driver.api.threads import Session
from epson_driver.taught_points import EpsonPoint, Pallet, TaughtPoints

__all__ = [
    'ArgumentError',
    'ControllerError',
    'EpsonPoint',
    'Gripper',
    'GripperState',
    'GripperWiring',
    'Io',
    'Motion',
    'MotionError',
    'Pallet',
    'PathError',
    'Points',
    'Recording',
    'Robot',
    'RobotError',
    'RobotStatus',
    'Sample',
    'Settings',
    'TaughtPoints',
    'Waypoint',
]


class Robot(Synchronous[aio.Robot]):
    """An arm and its controller. `with Robot(…) as robot:` connects and closes it.

    * host: the address of the controller, or a robot.yaml written by `epson_driver connect`, which
      contains the address, the profile and the model.
    * controller, model: names from config/controllers and config/robots (default: simulated and
      c3_a601s), or paths of files.
    * motion_port, …: TCP ports. The controller's profile has the defaults. An `io_port` or
      `remote_port` of 0 is not used.
    * enable: whether `connect` also enables the arm.

    Raises ArgumentError if an argument or a file is invalid.
    """

    @makes(aio.Robot)
    def __init__(self, robot: aio.Robot) -> None:
        super().__init__(robot, Session(robot, robot._connection))
        self.io = Io(robot.io, self._session)
        """Inputs and outputs of the controller."""
        self.gripper = Gripper(robot.gripper, self._session)
        """The gripper described by `Settings.gripper`."""
        self.points = Points(robot.points, self._session)
        """Taught points by name."""
        self.simulation = Simulation(robot.simulation, self._session)
        """Operator actions on a simulated controller."""

    @classmethod
    @makes(aio.Robot.simulated)
    def simulated(cls, robot: aio.Robot) -> Self:
        """Return a robot that starts its simulated controller when it connects.

        * start: initial joint positions, rad (m).
        * motion: 'smooth' (default): the arm moves through all points without a stop. 'ptp': it
          stops at each point. Omit this if the controller runs a SPEL+ program, which determines
          it.
        * enable: whether `connect` also enables the arm.
        """
        made = cls.__new__(cls)
        Robot.__init__.__wrapped__(made, robot)  # type: ignore[attr-defined]
        return made

    def connect(self, timeout: float = aio.READY_TIMEOUT_S) -> Self:
        """Connect, and wait until the controller has reported its state and the joint positions.

        The arm stays disabled, unless the Robot was created with `enable=True`. Then `connect`
        also enables the arm, and closes the connection if that fails. Raises RobotError if the
        robot is not ready within `timeout` s. The error's text lists what is missing.
        """
        self._session.open(partial(self._awaited.connect, timeout))
        return self

    def close(self) -> None:
        """Stop the arm, disable it, and disconnect. Do nothing if not connected."""
        self._session.close()

    def __enter__(self) -> Self:
        return self.connect()

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self.close()

    model = reads(aio.Robot, lambda robot: robot.model)
    status = reads(aio.Robot, lambda robot: robot.status)
    joints = reads(aio.Robot, lambda robot: robot.joints, measured)
    joint_velocities = reads(aio.Robot, lambda robot: robot.joint_velocities, measured)
    pose = reads(aio.Robot, lambda robot: robot.pose, measured)
    tool_pose = reads(aio.Robot, lambda robot: robot.tool_pose, measured)
    ros_pose = reads(aio.Robot, lambda robot: robot.ros_pose, measured)
    epson_point = reads(aio.Robot, lambda robot: robot.epson_point, measured)
    pose_in = calls(aio.Robot.pose_in, measured)

    sample = calls(aio.Robot.sample, measured)
    wait_until = waits(aio.Robot.wait_until)
    wait_for_input = waits(aio.Robot.wait_for_input)

    tool = reads(aio.Robot, lambda robot: robot.tool)
    set_tool = calls(aio.Robot.set_tool)
    set_payload = calls(aio.Robot.set_payload)
    forward = calls(aio.Robot.forward)
    inverse = calls(aio.Robot.inverse, measured)
    frames = reads(aio.Robot, lambda robot: robot.frames)
    set_frame = calls(aio.Robot.set_frame)

    enable = waits(aio.Robot.enable)
    disable = waits(aio.Robot.disable)
    reset = waits(aio.Robot.reset)
    stop = waits(aio.Robot.stop)
    show = waits(aio.Robot.show)

    move_joints = moves(aio.Robot.move_joints)
    move_waypoints = moves(aio.Robot.move_waypoints)
    move_trajectory = moves(aio.Robot.move_trajectory)
    record = calls(aio.Robot.record)
    replay = moves(aio.Robot.replay)
    move_line = moves(aio.Robot.move_line)
    move_arc = moves(aio.Robot.move_arc)
    move_path = moves(aio.Robot.move_path)
    servo = calls(aio.Robot.servo)
    servo_velocity = calls(aio.Robot.servo_velocity)
    servo_pose = calls(aio.Robot.servo_pose)
    servo_speed = calls(aio.Robot.servo_speed)
    servo_end = waits(aio.Robot.servo_end)
    speed_scaling = reads(aio.Robot, lambda robot: robot.speed_scaling)
    set_speed_scaling = calls(aio.Robot.set_speed_scaling)

    on_estop = registers(aio.Robot.on_estop)
    on_joints = registers(aio.Robot.on_joints)
    on_error = registers(aio.Robot.on_error)
    on_link = registers(aio.Robot.on_link)
