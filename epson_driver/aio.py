# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm from asyncio, without ROS: the driver's own checks, arm gate and sentences.

    async with Robot('192.168.0.1', controller='rc700a', model='c4_a601s') as robot:
        await robot.enable()
        await robot.move_joints([0.0, 0.3, -0.2, 0.0, 0.5, 0.0], speed=0.2)

Everything runs in the event loop that connects; angles are rad, lengths m, times s. docs/python.md
explains it; epson_driver.robot has the same without asyncio.
"""

import asyncio
import weakref
from collections.abc import Callable, Sequence
from functools import partial
from os import PathLike
from types import TracebackType
from typing import Literal, Self, TypeVar

import numpy as np
import numpy.typing as npt

from epson_driver.api import moves
from epson_driver.api.connection import Connection
from epson_driver.api.errors import (
    ArgumentError,
    MotionError,
    PathError,
    RobotError,
    argument_errors,
    checked_timeout,
    motion,
    not_begun,
    refusals,
)
from epson_driver.api.gripper import Gripper, GripperState, GripperWiring
from epson_driver.api.io import Io
from epson_driver.api.motion import Motion
from epson_driver.api.ownership import Unique
from epson_driver.api.payload import checked_load
from epson_driver.api.points import Points
from epson_driver.api.poses import (
    BASE,
    Frames,
    Pose,
    Tool,
    Waypoint,
    checked_tool,
    is_pose,
)
from epson_driver.api.recording import RATE, Recording
from epson_driver.api.settings import Ports, Settings, make_setup
from epson_driver.api.simulation import SimulatedController, Simulation
from epson_driver.api.status import ControllerError, RobotStatus, Sample
from epson_driver.api.streams import Streams
from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.goal.planning_scope import PlanningScope
from epson_driver.driver.smoothing import Smoothing, SmoothingError, SmoothingProcess
from epson_driver.motion import Array
from epson_driver.motion.point_to_point import LONGEST_SEGMENT_S, straight
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics
from epson_driver.taught_points.epson_point import EpsonPoint
from epson_driver.taught_points.posture import Posture, posture
from epson_driver.tool_motion.pose_path import Run
from epson_driver.tool_motion.tool_pose import quaternion_pose
from epson_driver.tool_motion.tool_trajectory import ToolLimits, runs_trajectory

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
    'PathError',
    'Points',
    'Recording',
    'Robot',
    'RobotError',
    'RobotStatus',
    'Sample',
    'Settings',
    'Waypoint',
]

READY_TIMEOUT_S = 10.0
"""How long `connect` waits for the controller unless it is told otherwise, s."""

T = TypeVar('T')


class Robot(Unique):
    """One arm. `connect` first, or use it as a context manager, which stops the arm at its end.

    controller, model: names of config/controllers and config/robots, or paths to files. Ports:
    the profile's unless given; an I/O or remote port of 0 is not used. Raises ValueError and
    FileNotFoundError for what cannot be.
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
        ports = Ports(motion=motion_port, state=state_port, io=io_port, remote=remote_port)
        self._setup = make_setup(
            host, controller, model, ports, Settings() if settings is None else settings
        )
        self._connection = Connection(self._setup)
        self._kinematics = Kinematics(self._setup.model)
        self._hand = (Tool(np.eye(4)), self._kinematics)
        self._streams = Streams(self._connection, self._setup.model.limits)
        self._frames = Frames(self._setup.model.base.matrix, float(self._setup.model.reach[0]))
        connection = self._connection  # not self: a robot that is lost is to be collected at once
        self.io = Io(lambda: connection.running.io)
        """Inputs and outputs."""
        self.gripper = Gripper(lambda: connection.gripper)
        """The gripper that the settings describe."""
        taught = weakref.WeakMethod(self._taught)
        self.points = Points(lambda: _of(taught), connection.measured)
        """Taught points by name."""
        self.simulation = Simulation(lambda: connection.simulated)
        """The hand of a person at a simulated controller."""

    @classmethod
    def simulated(
        cls,
        *,
        controller: str = 'rc620',
        model: str = 'c3_a601s',
        start: Sequence[float] | None = None,
        motion: Literal['smooth', 'ptp'] | None = None,
        settings: Settings | None = None,
    ) -> Self:
        """Return a robot that starts a simulated controller of its own when it connects.

        start: its first joint positions, rad (m). motion: through all points without a stop
        ('smooth', the default), or with a rest at each ('ptp'); a SPEL+ program moves as its
        statements say.
        """
        robot = cls(controller=controller, model=model, settings=settings)
        words = [f'--controller={controller}', f'--robot={model}']
        if motion not in (None, 'smooth', 'ptp'):
            raise ValueError(f'motion = {motion!r}: must be smooth or ptp')
        if motion is not None:
            words.append(f'--motion={motion}')
        if start is not None:
            (first,) = moves.targets('start', [start], robot.model.limits).positions
            words.append('--start=' + ','.join(f'{value:.9g}' for value in first))
        robot._connection.simulation = SimulatedController(words)
        return robot

    def __repr__(self) -> str:
        return f'<Robot: {self._setup.configuration.configured_as}, {self._connection.summary}>'

    # --- the connection ---------------------------------------------------------------------

    async def connect(self, timeout: float = READY_TIMEOUT_S) -> Self:
        """Connect, and wait until the controller has told its state and where the arm is.

        Raises RobotError that says what is missing after `timeout` s. The arm stays disabled.
        """
        lost = weakref.finalize(self, self._connection.lost)
        lost.atexit = False
        await self._connection.connect(checked_timeout(timeout) or 0.0)
        return self

    async def close(self) -> None:
        """Stop the arm, disable it, and disconnect. Nothing if there is no connection."""
        await self._connection.close()

    async def __aenter__(self) -> Self:
        return await self.connect()

    async def __aexit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        await self.close()

    # --- what a person would ask first ------------------------------------------------------

    @property
    def model(self) -> RobotModel:
        """The robot model: joint names, limits, frames."""
        return self._setup.model

    @property
    def status(self) -> RobotStatus:
        """What is known of arm and controller now, also while a link is down."""
        return self._connection.status

    @property
    def joints(self) -> Array:
        """Measured joint positions, shape (n,), rad (m). Raises RobotError if they are too old."""
        return self._connection.sample().positions.copy()

    @property
    def joint_velocities(self) -> Array:
        """Joint velocities, shape (n,), rad/s (m/s). Raises as `joints`."""
        return self._connection.sample().velocities.copy()

    def sample(self) -> Sample:
        """Return joints, time and state of the newest measurement. Raises as `joints`."""
        return self._connection.stamped(self._connection.sample())

    @property
    def pose(self) -> Array:
        """The flange (tool0) in base_link: homogeneous, shape (4, 4), m. Raises as `joints`."""
        return self._kinematics.forward(self._connection.sample().positions)

    @property
    def tool_pose(self) -> Array:
        """The tool in base_link: homogeneous, shape (4, 4), m. Raises as `joints`."""
        return self._hand[1].forward(self._connection.sample().positions)

    @property
    def ros_pose(self) -> Array:
        """The tool in base_link: x y z, m, and a quaternion x y z w, shape (7,). As `joints`."""
        return quaternion_pose(self.tool_pose)

    @property
    def epson_point(self) -> EpsonPoint:
        """The tool as the teach pendant shows it, in mm and degrees. Raises as `joints`."""
        return EpsonPoint.of(self.pose_in(BASE))

    def _taught(self) -> tuple[EpsonPoint, Posture | str]:
        """Return where the tool is, and the arm's posture as .pts files have it, or why not."""
        try:
            known = posture(self.model, self._connection.sample().positions)
        except ValueError as error:
            return self.epson_point, str(error)
        return self.epson_point, known

    @argument_errors()
    def pose_in(self, frame: str) -> Array:
        """Return the tool in a frame: homogeneous, shape (4, 4), m.

        Raises ArgumentError for a frame that is not there; otherwise as `joints`.
        """
        return self._frames.pose_in(self.tool_pose, frame)

    # --- tool and frames --------------------------------------------------------------------

    @property
    def tool(self) -> Array:
        """The tool in the flange (tool0): homogeneous, shape (4, 4), m."""
        return self._hand[0].pose.copy()

    @argument_errors()
    def set_tool(
        self,
        pose: Pose,
        *,
        max_speed: float | None = None,
        max_acceleration: float | None = None,
    ) -> None:
        """Set the tool (TCP) that lines, arcs and poses are about, at first the flange.

        pose: in the flange (tool0), in any form that `move_line` takes. max_speed, m/s, and
        max_acceleration, m/s²: a line, an arc or a path that asks for more is refused; None: no
        limit. Joint moves are not held against them. What runs goes on. Raises ArgumentError.
        """
        tool = checked_tool(pose, max_speed, max_acceleration)
        self._hand = (tool, Kinematics(self.model, tool.pose))

    @argument_errors()
    def set_payload(
        self,
        mass: float,
        center: npt.ArrayLike = (0.0, 0.0, 0.0),
        inertia: npt.ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> None:
        """Have the controller told what the arm carries, tool and part, from the next motion on.

        As geometry_msgs/Inertia in the flange (tool0): mass, kg; center, shape (3,), m; inertia
        about the center, kg m², ixx ixy ixz iyy iyz izz, or as a matrix (3, 3). SPEL+'s Weight and
        Inertia are made of it. Raises ArgumentError, and RobotError where the controller's program
        has it.
        """
        self._connection.set_load(checked_load(self.model, mass, center, inertia))

    @argument_errors()
    def forward(self, joints: npt.ArrayLike) -> Array:
        """Return the tool in base_link at joint positions, shape (n,): shape (4, 4), m.

        Raises ArgumentError.
        """
        values = moves.joint_rows('joints', joints, self.model.limits, rows=False)
        return self._hand[1].forward(values)

    @argument_errors()
    def inverse(
        self, pose: Pose, *, frame: str | None = None, near: npt.ArrayLike | None = None
    ) -> Array:
        """Return joint positions, shape (n,), rad (m), that bring the tool to a pose.

        pose, frame: as in `move_line`. near: of all solutions the nearest to these joints; None:
        to where the arm is. Raises PathError for a pose out of reach, ArgumentError, and, without
        near, as `joints`.
        """
        if near is None:
            start = self._connection.sample().positions
        else:
            start = moves.joint_rows('near', near, self.model.limits, rows=False)
        return self._joints_at('pose', pose, frame, start)

    def _joints_at(self, field: str, pose: Pose, frame: str | None, near: Array) -> Array:
        arm = self._hand[1]
        wanted = self._frames.target(field, pose, frame).seen_from(arm.forward(near))
        found = arm.inverse(wanted, near)
        if not len(found):
            place = ', '.join(f'{1e3 * value:.1f}' for value in wanted[:3, 3])
            why = arm.why_unreachable(wanted) or 'it is out of reach'
            raise PathError(f'{field}: no joint positions lead to ({place}) mm: {why}')
        return np.asarray(found[0])

    @property
    def frames(self) -> dict[str, Array]:
        """The frames by name, each in base_link: homogeneous, shape (4, 4), m."""
        return self._frames.poses

    @argument_errors()
    def set_frame(self, name: str, pose: Pose, *, parent: str | None = None) -> None:
        """Set a named frame by its pose in another one, in any form that `move_line` takes.

        parent: as `frame` of `move_line`, but not 'tool'. The frame stays where it is if the
        parent is set anew. Raises ArgumentError.
        """
        self._frames.set(name, pose, parent)

    async def catch_up(self) -> None:
        """Let what has come be read, as long as the newest joints are too old: half a second.

        In a program that held the event loop, or on a busy machine, newer ones may be waiting.
        """
        await self._connection.wait_for_fresh_state()

    async def measured(self, read: Callable[[], T]) -> T:
        """Catch up, then return what `read` does: `await robot.measured(lambda: robot.joints)`.

        It reads what had come by then, however long this process is held up in between.
        """
        return await self._connection.measured(read)

    async def wait_until(
        self, condition: Callable[[Sample], bool], timeout: float | None = None
    ) -> Sample:
        """Wait until a condition, asked for each sample, holds for one, and return that.

        Raises TimeoutError after `timeout` s, RobotError when joints are too old.
        """
        try:
            async with asyncio.timeout(checked_timeout(timeout)):
                while not condition(sample := await self.measured(self.sample)):
                    await self._connection.next_joints()
        except TimeoutError as error:
            raise TimeoutError(f'the condition did not hold within {timeout:g} s') from error
        return sample

    async def wait_for_input(
        self, index: int, value: int = 1, *, kind: str = 'DI', timeout: float | None = None
    ) -> None:
        """Wait until a point, an input unless `kind` says otherwise, has a value.

        Raises TimeoutError after `timeout` s, otherwise as `io.read`.
        """
        await self.io.wait(kind, index, value, timeout)

    # --- commands ---------------------------------------------------------------------------

    async def enable(self) -> str:
        """Switch the motors on where that can be done from here, and allow motions."""
        return await self._connection.command(ArmCommands.enable)

    async def disable(self) -> str:
        """Stop the arm, allow no more motions, and switch the motors off where that can be."""
        return await self._connection.command(ArmCommands.disable)

    async def reset(self) -> str:
        """Reset the controller's error, also after an E-stop. The arm stays disabled."""
        return await self._connection.command(ArmCommands.reset_error)

    async def stop(self) -> str:
        """Stop the arm and abort its motion, and return a sentence when it stands."""
        return await self._connection.command(ArmCommands.stop)

    # --- motions ----------------------------------------------------------------------------

    @motion
    async def move_joints(
        self,
        target: Pose,
        *,
        speed: float = 0.2,
        acceleration: float = 0.5,
        wait: bool = True,
    ) -> Motion:
        """Move straight in joint space to n joint positions, rad (m), or to a pose of the tool.

        A pose is in any form that `move_line` takes, in base_link (an EpsonPoint: in EPSON's
        world), and is reached in the configuration nearest to where the arm is.

        speed, acceleration: shares of the joint limits, (0, 1]; 1 is as fast as the arm can. wait:
        until the arm is there; Ctrl-C or a cancelled task meanwhile stops the arm. Otherwise
        return at once.

        Raises ArgumentError for bad arguments; MotionError if the arm is not enabled, a motion
        runs already (none replaces it unnoticed: wait for it or cancel it), or this one fails.
        Both are RobotErrors.
        """
        limits = self.model.limits
        moves.check_shares(speed, acceleration)
        pose = is_pose(target, len(limits.names))
        if pose:
            self._frames.target('target', target, None)
        else:
            positions = moves.joint_rows('target', target, limits, rows=False)
            positions = moves.targets('target', positions[None, :], limits).positions[0]
        start, plan = await self._connection.ready()
        if pose:
            positions = self._joints_at('target', target, None, start)
        trajectory = straight(
            start, positions, limits, speed, acceleration, sampled=self._connection.interpolates
        )
        return await self._connection.execute(
            trajectory,
            plan,
            wait=wait,
            move=lambda moves: moves.joints(positions, speed, acceleration),
        )

    @motion
    async def move_waypoints(
        self,
        points: npt.ArrayLike,
        *,
        speed: float = 0.2,
        acceleration: float = 0.5,
        wait: bool = True,
    ) -> Motion:
        """Move through joint positions, shape (k, n), rad (m), without a rest where that can be.

        As fast as the shares of the joint limits allow; a controller that rests at each point does
        so here. Planning takes up to seconds, also with `wait=False`. Raises as `move_joints`.
        """
        limits = self.model.limits
        moves.check_shares(speed, acceleration)
        waypoints = moves.targets('points', points, limits)
        start, plan = await self._connection.ready()
        scaled = moves.scaled_limits(limits, speed, acceleration)
        smoother = SmoothingProcess(
            scaled, Smoothing(time_optimal=True, longest=LONGEST_SEGMENT_S)
        )
        try:
            trajectory = await smoother.prepared(waypoints, start)
        except SmoothingError as error:
            raise not_begun(str(error)) from error
        finally:
            await smoother.close()
        return await self._connection.execute(trajectory, plan, wait=wait)

    @motion
    async def move_trajectory(
        self,
        times: npt.ArrayLike,
        positions: npt.ArrayLike,
        velocities: npt.ArrayLike | None = None,
        *,
        joint_names: Sequence[str] | None = None,
        wait: bool = True,
    ) -> Motion:
        """Execute a planned trajectory as it is, from where the arm stands.

        times: shape (k,), s from the start, strictly increasing. positions, velocities: shape
        (k, n), rad and rad/s (m, m/s), in the order of joint_names (default: the model's). What a
        trajectory must be is in docs/goals.md. Raises as `move_joints`.
        """
        limits = self.model.limits
        trajectory = moves.planned(times, positions, velocities, joint_names, limits)
        return await self._connection.execute(trajectory, PlanningScope(), wait=wait)

    @argument_errors()
    def record(self, rate: float = 1000.0) -> Recording:
        """Record the joints from now on, however the arm is moved, until its `stop`.

        rate: per s; at most as often as the controller sends them. Raises as `joints`, and
        ArgumentError.
        """
        period = 1.0 / RATE.checked(rate, 'rate')
        self._connection.running  # noqa: B018 - it raises
        recording = Recording(self.model.joint_names, period)
        recording.begin(self._connection.changes.recorded.add)
        return recording

    @motion
    async def replay(
        self,
        recording: Recording | str | PathLike[str],
        *,
        speed: float = 1.0,
        wait: bool = True,
    ) -> Motion:
        """Move as it was recorded, or is in a file, from `move_joints` to where that begins.

        speed: the share of its own, 0.01 to 1. The arm begins at once, and rests where it rested.
        What is still being recorded ends with this.
        Raises OSError for a file that cannot be read, otherwise as `move_trajectory`.
        """
        if not isinstance(recording, Recording):
            recording = Recording.load(recording)
        recording.stop()
        limits = self.model.limits
        way = moves.checked(recording.plan(limits, speed), limits, 'recording')
        start, plan = await self._connection.ready()
        trajectory = straight(
            start, way.positions[0], limits, 0.2, 0.5, sampled=self._connection.interpolates
        )
        return await self._connection.execute(moves.joined(trajectory, way), plan, wait=wait)

    @motion
    async def move_line(
        self,
        pose: Pose,
        *,
        frame: str | None = None,
        speed: float = 0.1,
        acceleration: float = 1.0,
        turn_speed: float = 1.0,
        turn_acceleration: float = 10.0,
        accuracy: float = 1e-4,
        jerk: float | None = None,
        slow: bool = True,
        wait: bool = True,
    ) -> Motion:
        """Move the tool straight to a pose: in base_link, a named frame, or 'tool'.

        pose: a homogeneous matrix, shape (4, 4), m; x y z, m, and a quaternion x y z w, shape
        (7,); or an EpsonPoint. frame: 'base_link', 'base' (EPSON's world), 'tool' (the tool where
        it is), or a name given to `set_frame`; None: 'base_link', 'base' for an EpsonPoint.

        The orientation turns evenly about one axis. speed, acceleration: of the tool at most, m/s
        and m/s², in bends too; turn_speed, turn_acceleration: of its turn, rad/s and rad/s².
        jerk: of the tool, m/s³; None: 10 / s of the acceleration; that of the turn is in the same
        ratio. accuracy: points are sent so densely that the way between them is no farther from
        the line, m; a motion in which the tool was farther away says so in its text. slow: go
        slower where a joint limit asks for it; False: refuse that.

        Raises PathError, an ArgumentError, before anything is sent, for a pose out of reach or a
        way through a singularity, with joint, place and limit; otherwise as `move_joints`.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, jerk=jerk, slow=slow
        )
        point = moves.PathPoint(self._frames.target('pose', pose, frame))
        return await self._move_tool(point.run, tool, wait, point)

    @motion
    async def move_arc(
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
        jerk: float | None = None,
        slow: bool = True,
        wait: bool = True,
    ) -> Motion:
        """Move the tool on a circle through a point, x y z in m, to a pose in the same frame.

        The point is x y z also where the pose is an EpsonPoint. The rest as in `move_line`.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, jerk=jerk, slow=slow
        )
        middle = self._frames.point('via', via, frame, pose)
        point = moves.PathPoint(self._frames.target('pose', pose, frame), middle)
        return await self._move_tool(point.run, tool, wait, point)

    @motion
    async def move_path(
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
        jerk: float | None = None,
        slow: bool = True,
        wait: bool = True,
    ) -> Motion:
        """Move the tool through poses or Waypoints, from one to the next straight or on a circle.

        blend: how far from each point, m, the tool may leave the way to it for the way to the
        next, without a rest; 0: it rests there. blend and frame hold for the points that have none
        of their own. Around the corner it is as fast as the limits allow. 'tool' is the tool where
        it is at the beginning.

        The rest as in `move_line`; the error for a blend that is longer than the way, and for
        what is wrong with a single point, names the point.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, jerk=jerk, slow=slow
        )
        ways = moves.path_points(points, blend, frame, self._frames)
        return await self._move_tool(partial(moves.path_runs, ways), tool, wait)

    async def _move_tool(
        self,
        path: Callable[[Array], list[Run]],
        limits: ToolLimits,
        wait: bool,
        point: moves.PathPoint | None = None,
    ) -> Motion:
        tool, arm = self._hand
        tool.check(limits.speed, limits.acceleration)
        start, plan = await self._connection.ready()
        way = path(arm.forward(start))
        if not way:  # the tool is there
            trajectory = straight(start, start, self.model.limits, 1.0, 1.0, sampled=False)
            return await self._connection.execute(
                trajectory, plan, wait=wait, move=lambda written: written.joints(start, 0.01, 0.01)
            )
        with refusals():
            trajectory = await plan.in_thread(partial(runs_trajectory, arm, start, way, limits))
        written = None
        if point is not None:
            written = partial(
                moves.tool_statement, arm, tool.pose, point, start, trajectory, limits
            )
        held = (moves.deviation(arm, way), limits.accuracy)
        return await self._connection.execute(trajectory, plan, wait=wait, path=held, move=written)

    # --- streams ----------------------------------------------------------------------------

    @argument_errors()
    def servo(self, target: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> None:
        """Follow joint positions, shape (n,), rad (m), that come 10 to 500 times a second.

        velocities: with which these go on, shape (n,); None: estimated. The newest counts; the arm
        follows inside a share of its limits (`Settings.servo_scale`), 0.1 rad away at most when
        the stream begins, and comes to rest when none comes any more. After a stop, or whatever
        disabled the arm, a stream must be silent for a second before it begins anew
        (docs/servo.md).

        Raises ArgumentError for what cannot be followed; RobotError, or MotionError, with why,
        while it is not followed. The setpoint is lost then.
        """
        self._streams.positions(target, velocities)

    @argument_errors()
    def servo_velocity(self, velocities: npt.ArrayLike) -> None:
        """Follow joint velocities, shape (n,), rad/s (m/s). The rest as `servo`."""
        self._streams.velocities(velocities)

    @argument_errors()
    def servo_pose(self, pose: Pose, *, frame: str | None = None) -> None:
        """Follow a pose of the tool, in any form and frame that `move_line` takes.

        In the configuration nearest to where the arm is. Raises PathError for a pose that is out
        of reach or asks for another configuration. The rest as `servo`.
        """
        arm = self._hand[1]
        self._streams.pose(
            arm, lambda tool: self._frames.target('pose', pose, frame).seen_from(tool)
        )

    @argument_errors()
    def servo_speed(self, velocity: npt.ArrayLike, *, frame: str = 'base_link') -> None:
        """Follow a velocity of the tool: x y z, m/s, and about x y z, rad/s, shape (6,).

        frame: 'base_link' or 'tool', the tool where it is, for its axes. Slower where a joint
        would be too fast. Raises PathError where the tool cannot move so. The rest as `servo`.
        """
        self._streams.twist(self._hand[1], velocity, frame)

    async def servo_end(self) -> str:
        """Wait until the stream is over and the arm stands, and say so."""
        return await self._streams.end()

    @property
    def speed_scaling(self) -> float:
        """The share of the planned speed at which all motions run."""
        return self._connection.running.goal_queue.scaling.target

    @argument_errors()
    def set_speed_scaling(self, factor: float) -> None:
        """Run all motions at this share of their planned speed, also those that run: 0 pauses.

        From 0.01 to 1, or 0. It is reached in half a second at most, and acts on what the
        controller does not have yet: an arm that moves rests within three seconds (docs/goals.md).
        For a rest at once, call `stop`. Raises ArgumentError, and RobotError where the controller
        cannot do it.
        """
        self._connection.set_speed_scaling(moves.FACTOR.checked(factor, 'factor'))

    # --- callbacks --------------------------------------------------------------------------

    def on_estop(self, callback: Callable[[bool], object]) -> Callable[[], None]:
        """Have it called when the E-stop is pressed (True) or reset (False).

        The arm is disabled by then. Callbacks of Robot run one after the other in a thread of
        their own and may use the robot; those of aio.Robot run in the event loop and must return
        at once. One that raises is reported, and the arm is stopped. Returns what takes the
        callback away again.
        """
        return self._connection.changes.estop.add(callback)

    def on_joints(self, callback: Callable[[Sample], object]) -> Callable[[], None]:
        """Have it called with each sample, up to 200 times a second. As on_estop.

        One that is slower than that, and falls 1000 behind, stops the arm.
        """
        return self._connection.changes.joints.add(callback)

    def on_error(self, callback: Callable[[ControllerError | None], object]) -> Callable[[], None]:
        """Have it called when the controller has another error, or none any more. As on_estop."""
        return self._connection.changes.error.add(callback)

    def on_link(self, callback: Callable[[str, str], object]) -> Callable[[], None]:
        """Have it called with the links' state and why, when it changes. As on_estop.

        States: disconnected, connecting, connected, backing_off (waiting for the next attempt).
        """
        return self._connection.changes.link.add(callback)


def _of(
    taught: weakref.WeakMethod[Callable[[], tuple[EpsonPoint, Posture | str]]],
) -> tuple[EpsonPoint, Posture | str]:
    """Return what a robot's method does. Raises RobotError if the robot was lost."""
    method = taught()
    if method is None:
        raise RobotError('the robot of these points was lost')
    return method()
