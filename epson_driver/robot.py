# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm from plain Python, without ROS: the driver's own checks, arm gate and sentences.

    with Robot('192.168.0.1', controller='rc700a', model='c4_a601s') as robot:
        robot.enable()
        robot.move_joints([0.0, 0.3, -0.2, 0.0, 0.5, 0.0], speed=0.2)

Angles are rad, lengths m, times s. docs/python.md explains it; epson_driver.aio is the same for
asyncio. A Robot may be used from several threads.
"""

import logging
import threading
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from types import TracebackType
from typing import Any, Literal, TypeVar

import numpy.typing as npt

from epson_driver import aio
from epson_driver.api.errors import MotionError, RobotError
from epson_driver.api.gripper import GripperState, GripperWiring
from epson_driver.api.poses import EpsonPoint, Pose, Waypoint
from epson_driver.api.settings import Settings
from epson_driver.api.status import ControllerError, RobotStatus
from epson_driver.api.synchronous import Gripper, Io, Motion
from epson_driver.api.threads import CallbackThread, LoopThread
from epson_driver.motion import Array
from epson_driver.robots import RobotModel

__all__ = [
    'ControllerError',
    'EpsonPoint',
    'Gripper',
    'GripperState',
    'GripperWiring',
    'Io',
    'Motion',
    'MotionError',
    'Robot',
    'RobotError',
    'RobotStatus',
    'Settings',
    'Waypoint',
]

_log = logging.getLogger(__name__)

R = TypeVar('R', bound='Robot')
T = TypeVar('T')


class Robot:
    """One arm. `connect` first, or use it in a `with` block, which stops the arm at its end.

    The arguments are those of aio.Robot: controller and model by name or file, ports that are not
    the profile's, settings. Raises ValueError and FileNotFoundError for what cannot be.
    """

    def __init__(
        self,
        host: str = '127.0.0.1',
        *,
        controller: str = 'rc620',
        model: str = 'c3_a601s',
        motion_port: int | None = None,
        state_port: int | None = None,
        io_port: int | None = None,
        remote_port: int | None = None,
        settings: Settings | None = None,
    ) -> None:
        self._robot = aio.Robot(
            host,
            controller=controller,
            model=model,
            motion_port=motion_port,
            state_port=state_port,
            io_port=io_port,
            remote_port=remote_port,
            settings=settings,
        )
        self._begin()

    def _begin(self) -> None:
        self._closing = threading.Lock()
        self._thread: LoopThread | None = None
        self._callbacks = CallbackThread('robot callbacks', self._callback_failed)
        self.io = Io(self._robot.io, self._running)
        """Inputs and outputs."""
        self.gripper = Gripper(self._robot.gripper, self._running)
        """The gripper that the settings describe."""

    @classmethod
    def simulated(
        cls: type[R],
        *,
        controller: str = 'rc620',
        model: str = 'c3_a601s',
        start: Sequence[float] | None = None,
        motion: Literal['smooth', 'ptp'] = 'smooth',
        settings: Settings | None = None,
    ) -> R:
        """Return a robot that starts a simulated controller of its own when it connects.

        start: its first joint positions, rad (m). motion: through all points without a stop, or
        with a rest at each.
        """
        robot = cls.__new__(cls)
        robot._robot = aio.Robot.simulated(
            controller=controller, model=model, start=start, motion=motion, settings=settings
        )
        robot._begin()
        return robot

    # --- the connection ---------------------------------------------------------------------

    def connect(self: R, timeout: float = aio.READY_TIMEOUT_S) -> R:
        """Connect, and wait until the controller has told its state and where the arm is.

        Raises RobotError that says what is missing after `timeout` s. The arm stays disabled.
        """
        if self._thread is not None:
            raise RobotError('the robot is connected already')
        self._thread = LoopThread('robot')
        try:
            self._run(partial(self._robot.connect, timeout))
        except BaseException:
            self.close()
            raise
        return self

    def close(self) -> None:
        """Stop the arm, disable it, and disconnect. Nothing if there is no connection."""
        with self._closing:
            thread = self._thread
            if thread is None:
                return
            try:
                thread.run(self._robot.close)
            finally:
                self._thread = None
                thread.close()
        self._callbacks.close()  # without the lock: one of them may be closing, too

    def __enter__(self: R) -> R:
        return self.connect()

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self.close()

    # --- what a person would ask first ------------------------------------------------------

    @property
    def model(self) -> RobotModel:
        """The robot model: joint names, limits, frames."""
        return self._robot.model

    @property
    def status(self) -> RobotStatus:
        """What is known of arm and controller now, in words as well; also while a link is down."""
        return self._call(lambda: self._robot.status)

    @property
    def joints(self) -> Array:
        """Measured joint positions, shape (n,), rad (m). Raises RobotError if they are too old."""
        return self._measured(lambda: self._robot.joints)

    @property
    def joint_velocities(self) -> Array:
        """Joint velocities, shape (n,), rad/s (m/s). Raises as `joints`."""
        return self._measured(lambda: self._robot.joint_velocities)

    @property
    def pose(self) -> Array:
        """The flange (tool0) in base_link: homogeneous, shape (4, 4), m. Raises as `joints`."""
        return self._measured(lambda: self._robot.pose)

    @property
    def tool_pose(self) -> Array:
        """The tool in base_link: homogeneous, shape (4, 4), m. Raises as `joints`."""
        return self._measured(lambda: self._robot.tool_pose)

    @property
    def ros_pose(self) -> Array:
        """The tool in base_link: x y z, m, and a quaternion x y z w, shape (7,). As `joints`."""
        return self._measured(lambda: self._robot.ros_pose)

    @property
    def epson_point(self) -> EpsonPoint:
        """The tool as the teach pendant shows it, in mm and degrees. Raises as `joints`."""
        return self._measured(lambda: self._robot.epson_point)

    def pose_in(self, frame: str) -> Array:
        """Return the tool in a frame: homogeneous, shape (4, 4), m.

        Raises ValueError for a frame that is not there; otherwise as `joints`.
        """
        return self._measured(lambda: self._robot.pose_in(frame))

    # --- tool and frames --------------------------------------------------------------------

    @property
    def tool(self) -> Array:
        """The tool in the flange (tool0): homogeneous, shape (4, 4), m."""
        return self._robot.tool

    def set_tool(
        self,
        pose: Pose,
        *,
        max_speed: float | None = None,
        max_acceleration: float | None = None,
    ) -> None:
        """Set the tool (TCP) that lines, arcs and poses are about; at first it is the flange.

        pose: in the flange (tool0), in any form that `move_line` takes. max_speed, m/s, and
        max_acceleration, m/s²: a line, an arc or a path that asks for more is refused; None: no
        limit. Joint moves are not held against them. What runs goes on. Raises ValueError.
        """
        self._robot.set_tool(pose, max_speed=max_speed, max_acceleration=max_acceleration)

    @property
    def frames(self) -> dict[str, Array]:
        """The frames by name, each in base_link: homogeneous, shape (4, 4), m."""
        return self._robot.frames

    def set_frame(self, name: str, pose: Pose, *, parent: str | None = None) -> None:
        """Set a named frame by its pose in another one, in any form that `move_line` takes.

        parent: as `frame` of `move_line`, but not 'tool'. The frame stays where it is if the
        parent is set anew. Raises ValueError.
        """
        self._robot.set_frame(name, pose, parent=parent)

    # --- commands ---------------------------------------------------------------------------

    def enable(self) -> str:
        """Switch the motors on where that can be done from here, and allow motions."""
        return self._run(self._robot.enable)

    def disable(self) -> str:
        """Stop the arm, allow no more motions, and switch the motors off where that can be."""
        return self._run(self._robot.disable)

    def reset(self) -> str:
        """Reset the controller's error, also after an E-stop. The arm stays disabled."""
        return self._run(self._robot.reset)

    def stop(self) -> str:
        """Stop the arm; return a sentence when it stands. A motion that runs is aborted."""
        return self._run(self._robot.stop)

    # --- motions ----------------------------------------------------------------------------

    def move_joints(
        self,
        target: npt.ArrayLike,
        *,
        speed: float = 1.0,
        acceleration: float = 1.0,
        wait: bool = True,
    ) -> Motion:
        """Move straight in joint space to n joint positions, rad (m), as fast as allowed.

        speed, acceleration: shares of the joint limits, (0, 1]. wait: until the arm is there;
        Ctrl-C meanwhile stops the arm. Otherwise return at once.

        Raises ValueError for bad arguments; MotionError if the arm is not enabled, a motion runs
        already (none replaces it unnoticed: wait for it or cancel it), or this one fails.
        """
        return self._move(
            partial(
                self._robot.move_joints, target, speed=speed, acceleration=acceleration, wait=wait
            )
        )

    def move_waypoints(
        self,
        points: npt.ArrayLike,
        *,
        speed: float = 1.0,
        acceleration: float = 1.0,
        wait: bool = True,
    ) -> Motion:
        """Move through joint positions, shape (k, n), rad (m), without a rest where that can be.

        As fast as the shares of the joint limits allow; a controller that rests at each point does
        so here. Planning takes up to seconds, also with `wait=False`. Raises as `move_joints`.
        """
        return self._move(
            partial(
                self._robot.move_waypoints,
                points,
                speed=speed,
                acceleration=acceleration,
                wait=wait,
            )
        )

    def move_trajectory(
        self,
        times: npt.ArrayLike,
        positions: npt.ArrayLike,
        velocities: npt.ArrayLike | None = None,
        *,
        joint_names: Sequence[str] | None = None,
        wait: bool = True,
    ) -> Motion:
        """Execute a planned trajectory as it is; it begins where the arm stands.

        times: shape (k,), s from the start, strictly increasing. positions, velocities: shape
        (k, n), rad and rad/s (m, m/s), in the order of joint_names (default: the model's). What a
        trajectory must be is in docs/goals.md. Raises as `move_joints`.
        """
        return self._move(
            partial(
                self._robot.move_trajectory,
                times,
                positions,
                velocities,
                joint_names=joint_names,
                wait=wait,
            )
        )

    def move_line(
        self,
        pose: Pose,
        *,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        slow: bool = False,
        wait: bool = True,
    ) -> Motion:
        """Move the tool straight to a pose: in base_link, a named frame, or 'tool'.

        pose: a homogeneous matrix, shape (4, 4), m; x y z, m, and a quaternion x y z w, shape
        (7,); or an EpsonPoint. frame: 'base_link', 'base' (EPSON's world), 'tool' (the tool where
        it is), or a name given to `set_frame`; None: 'base_link', 'base' for an EpsonPoint.

        The orientation turns evenly about one axis. speed, acceleration: of the tool at most, m/s
        and m/s², in bends too; turn_speed, turn_acceleration: of its turn, rad/s and rad/s².
        accuracy: how far the way between two points that are sent may be from the line, m. slow:
        go slower where a joint limit asks for it; otherwise that is refused.

        Raises ValueError, before anything is sent, for a pose out of reach or a way near a
        singularity, with joint, place and limit; otherwise as `move_joints`. On six-axis arms it
        needs py-opw-kinematics (pip install 'epson_driver[planning]').
        """
        return self._move(
            partial(
                self._robot.move_line,
                pose,
                frame=frame,
                speed=speed,
                acceleration=acceleration,
                turn_speed=turn_speed,
                turn_acceleration=turn_acceleration,
                accuracy=accuracy,
                slow=slow,
                wait=wait,
            )
        )

    def move_arc(
        self,
        via: npt.ArrayLike,
        pose: Pose,
        *,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        slow: bool = False,
        wait: bool = True,
    ) -> Motion:
        """Move the tool on a circle through a point, x y z in m, to a pose in the same frame.

        The point is x y z also where the pose is an EpsonPoint. The rest as in `move_line`.
        """
        return self._move(
            partial(
                self._robot.move_arc,
                via,
                pose,
                frame=frame,
                speed=speed,
                acceleration=acceleration,
                turn_speed=turn_speed,
                turn_acceleration=turn_acceleration,
                accuracy=accuracy,
                slow=slow,
                wait=wait,
            )
        )

    def move_path(
        self,
        points: Sequence[Waypoint | Pose],
        *,
        blend: float = 0.0,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        slow: bool = False,
        wait: bool = True,
    ) -> Motion:
        """Move the tool through poses or Waypoints, from one to the next straight or on a circle.

        blend: how far from each point, m, the tool may leave the way to it for the way to the
        next, without a rest; 0: it rests there. blend and frame hold for the points that have none
        of their own. Around the corner it is as fast as the limits allow. 'tool' is the tool where
        it is at the beginning.

        The rest as in `move_line`; the ValueError for a blend that is longer than the way, and for
        what is wrong with a single point, names the point.
        """
        return self._move(
            partial(
                self._robot.move_path,
                points,
                blend=blend,
                frame=frame,
                speed=speed,
                acceleration=acceleration,
                turn_speed=turn_speed,
                turn_acceleration=turn_acceleration,
                accuracy=accuracy,
                slow=slow,
                wait=wait,
            )
        )

    @property
    def speed_scaling(self) -> float:
        """The share of the planned speed at which all motions run."""
        return self._call(lambda: self._robot.speed_scaling)

    def set_speed_scaling(self, factor: float) -> None:
        """Run all motions at this share of their planned speed, also those that run: 0 pauses.

        From 0.01 to 1, or 0. It is reached in half a second at most (docs/goals.md).
        """
        self._call(lambda: self._robot.set_speed_scaling(factor))

    # --- callbacks --------------------------------------------------------------------------

    def on_estop(self, callback: Callable[[bool], object]) -> Callable[[], None]:
        """Have it called when the E-stop is pressed (True) or reset (False).

        Callbacks run one after the other in a thread of their own and may use the robot; the arm
        is disabled by then. One that raises is reported, and the arm is stopped. Returns what
        takes the callback away again.
        """
        return self._robot.on_estop(self._callbacks.wrap(callback))

    def on_error(self, callback: Callable[[ControllerError | None], object]) -> Callable[[], None]:
        """Have it called when the controller has another error, or none any more. As on_estop."""
        return self._robot.on_error(self._callbacks.wrap(callback))

    def on_link(self, callback: Callable[[str, str], object]) -> Callable[[], None]:
        """Have it called with the links' state and why, when it changes. As on_estop.

        States: disconnected, connecting, connected, backing_off (waiting for the next attempt).
        """
        return self._robot.on_link(self._callbacks.wrap(callback))

    # --- within -----------------------------------------------------------------------------

    def _callback_failed(self, error: Exception) -> None:
        try:
            self._call(lambda: self._robot.callback_failed(error))
        except RobotError as closed:
            _log.error('a callback failed (%s)', closed, exc_info=error)

    def _move(self, begin: Callable[[], Coroutine[Any, Any, aio.Motion]]) -> Motion:
        thread = self._running()
        return Motion(thread.run(begin), thread)

    def _run(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        return self._running().run(work)

    def _measured(self, function: Callable[[], T]) -> T:
        return self._run(partial(self._robot.measured, function))

    def _call(self, function: Callable[[], T]) -> T:
        return self._running().call(function)

    def _running(self) -> LoopThread:
        if self._thread is None:
            raise RobotError('there is no connection: call connect(), or use a with block')
        return self._thread
