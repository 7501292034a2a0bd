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
import contextlib
import logging
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from epson_driver.api import moves
from epson_driver.api.callbacks import Changes
from epson_driver.api.errors import MotionError, RobotError, in_python, not_begun, refusals
from epson_driver.api.gripper import Gripper, GripperState, GripperWiring
from epson_driver.api.io import Io
from epson_driver.api.motion import Motion
from epson_driver.api.poses import (
    BASE,
    EpsonPoint,
    Frames,
    Pose,
    Tool,
    Waypoint,
    checked_tool,
    quaternion_pose,
)
from epson_driver.api.settings import Ports, Settings, make_setup
from epson_driver.api.simulation import SimulatedController
from epson_driver.api.status import ControllerError, RobotStatus, robot_status
from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.goal.goal_plan import GoalPlan
from epson_driver.driver.io.gripper import Gripper as DrivenGripper
from epson_driver.driver.smoothing.smoothing import Smoothing
from epson_driver.driver.smoothing.smoothing_process import SmoothingError, SmoothingProcess
from epson_driver.driver.state.fresh_pose import fresh_moment
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks.notification import Notification
from epson_driver.driver.tasks.task_group import report_error
from epson_driver.motion import Array, Trajectory
from epson_driver.motion.blended_path import Run
from epson_driver.robots import RobotModel
from epson_driver.robots.cartesian_motion import ToolLimits, runs_trajectory
from epson_driver.robots.kinematics import Kinematics
from epson_driver.simple_message import Status

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

READY_TIMEOUT_S = 10.0
"""How long `connect` waits for the controller unless it is told otherwise, s."""

FRESH_POSE_TIMEOUT_S = 0.5
"""How long to wait for joints if those that are there are too old, s."""

R = TypeVar('R', bound='Robot')
T = TypeVar('T')

_log = logging.getLogger(__name__)


class Robot:
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
        self._setup = make_setup(host, controller, model, ports, settings or Settings())
        self._simulation: SimulatedController | None = None
        self._kinematics = Kinematics(self._setup.model)
        self._hand = (Tool(np.eye(4)), self._kinematics)
        self._frames = Frames(self._setup.model.base.matrix, float(self._setup.model.reach[0]))
        self._driver: Driver | None = None
        self._commands: ArmCommands | None = None
        self._task: asyncio.Task[None] | None = None
        self._gripper: DrivenGripper | None = None
        self._heard = Notification()
        self._link_reason = 'not connected yet'
        self._moment: float | None = None
        """When what is read now had come, loop time, s; None: nobody made sure."""
        errors = self._setup.configuration.errors
        assert errors is not None  # noqa: S101 - for the type checker: make_setup loads them
        self._changes = Changes(self.callback_failed, errors)
        self.io = Io(lambda: self._connected()[0].io)
        """Inputs and outputs."""
        self.gripper = Gripper(self._driven_gripper)
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
        robot = cls(controller=controller, model=model, settings=settings)
        if motion not in ('smooth', 'ptp'):
            raise ValueError(f'motion = {motion!r}: must be smooth or ptp')
        words = [f'--controller={controller}', f'--robot={model}', f'--motion={motion}']
        if start is not None:
            (first,) = moves.targets('start', [start], robot.model.limits).positions
            words.append('--start=' + ','.join(f'{value:.9g}' for value in first))
        robot._simulation = SimulatedController(words)
        return robot

    # --- the connection ---------------------------------------------------------------------

    async def connect(self: R, timeout: float = READY_TIMEOUT_S) -> R:
        """Connect, and wait until the controller has told its state and where the arm is.

        Raises RobotError that says what is missing after `timeout` s. The arm stays disabled.
        """
        if self._task is not None:
            raise RobotError('the robot is connected already')
        configuration = self._setup.configuration
        try:
            if self._simulation is not None:
                there = await self._simulation.start()
                configuration = replace(
                    configuration,
                    host='127.0.0.1',
                    motion_port=there.motion or 0,
                    state_port=there.state or 0,
                    io_port=there.io or 0,
                    remote_port=there.remote or 0,
                )
            driver = Driver(configuration, self, self._setup.goals)
            driver.goal_queue.start_tolerance = self._setup.start_tolerance
            self._driver, self._commands = driver, ArmCommands(driver)
            wiring = self._setup.gripper
            self._gripper = None if wiring is None else DrivenGripper(driver.io, wiring)
            self._task = asyncio.create_task(driver.run())
            self._task.add_done_callback(lambda _: self._heard.notify_all())
            await self._wait_until_ready(driver, timeout)
        except BaseException:
            await self.close()
            raise
        return self

    async def close(self) -> None:
        """Stop the arm, disable it, and disconnect. Nothing if there is no connection."""
        task, driver, commands = self._task, self._driver, self._commands
        try:
            if task is not None and driver is not None and commands is not None:
                if not task.done():
                    await self._stop_before_leaving(driver, commands)
                    await driver.shut_down()
                task.cancel()
                ended = await asyncio.gather(task, return_exceptions=True)
                if isinstance(ended[0], Exception):
                    _log.error('the driver had failed: %s', ended[0])
        finally:
            if task is not None:
                task.cancel()
            self._task = self._driver = self._commands = None
            self._link_reason = 'the connection was closed'
            if self._simulation is not None:
                await self._simulation.close()

    async def __aenter__(self: R) -> R:
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
        """What is known of arm and controller now, in words as well; also while a link is down."""
        if self._driver is None or self._commands is None:
            raise RobotError(f'there is no connection ({self._link_reason}): call connect()')
        return robot_status(self._driver, self._commands, self._link_reason)

    @property
    def joints(self) -> Array:
        """Measured joint positions, shape (n,), rad (m). Raises RobotError if they are too old."""
        return self._sample().positions.copy()

    @property
    def joint_velocities(self) -> Array:
        """Joint velocities, shape (n,), rad/s (m/s). Raises as `joints`."""
        return self._sample().velocities.copy()

    @property
    def pose(self) -> Array:
        """The flange (tool0) in base_link: homogeneous, shape (4, 4), m. Raises as `joints`."""
        return self._kinematics.forward(self._sample().positions)

    @property
    def tool_pose(self) -> Array:
        """The tool in base_link: homogeneous, shape (4, 4), m. Raises as `joints`."""
        return self._hand[1].forward(self._sample().positions)

    @property
    def ros_pose(self) -> Array:
        """The tool in base_link: x y z, m, and a quaternion x y z w, shape (7,). As `joints`."""
        return quaternion_pose(self.tool_pose)

    @property
    def epson_point(self) -> EpsonPoint:
        """The tool as the teach pendant shows it, in mm and degrees. Raises as `joints`."""
        return EpsonPoint.of(self.pose_in(BASE))

    def pose_in(self, frame: str) -> Array:
        """Return the tool in a frame: homogeneous, shape (4, 4), m.

        Raises ValueError for a frame that is not there; otherwise as `joints`.
        """
        return self._frames.pose_in(self.tool_pose, frame)

    # --- tool and frames --------------------------------------------------------------------

    @property
    def tool(self) -> Array:
        """The tool in the flange (tool0): homogeneous, shape (4, 4), m."""
        return self._hand[0].pose.copy()

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
        tool = checked_tool(pose, max_speed, max_acceleration)
        self._hand = (tool, Kinematics(self.model, tool.pose))

    @property
    def frames(self) -> dict[str, Array]:
        """The frames by name, each in base_link: homogeneous, shape (4, 4), m."""
        return self._frames.poses

    def set_frame(self, name: str, pose: Pose, *, parent: str | None = None) -> None:
        """Set a named frame by its pose in another one, in any form that `move_line` takes.

        parent: as `frame` of `move_line`, but not 'tool'. The frame stays where it is if the
        parent is set anew. Raises ValueError.
        """
        self._frames.set(name, pose, parent)

    async def catch_up(self) -> None:
        """Let what has come be read, as long as the newest joints are too old: half a second.

        In a program that held the event loop, or on a busy machine, newer ones may be waiting.
        """
        await self._fresh_moment()

    async def measured(self, read: Callable[[], T]) -> T:
        """Catch up, then return what `read` does: `await robot.measured(lambda: robot.joints)`.

        It reads what had come by then, however long this process is held up in between.
        """
        self._moment = await self._fresh_moment()
        try:
            return read()
        finally:
            self._moment = None

    async def _fresh_moment(self) -> float:
        driver, _ = self._connected()
        return await fresh_moment(driver.robot.stale, self._heard, FRESH_POSE_TIMEOUT_S)

    def _sample(self) -> JointSample:
        driver, _ = self._connected()
        now = asyncio.get_running_loop().time() if self._moment is None else self._moment
        if (why := driver.robot.why_not_ready(now)) is not None:
            raise RobotError(f'nobody knows where the arm is: {why}')
        assert driver.robot.sample is not None  # noqa: S101 - for the type checker
        return driver.robot.sample

    # --- commands ---------------------------------------------------------------------------

    async def enable(self) -> str:
        """Switch the motors on where that can be done from here, and allow motions."""
        return await self._command(self._connected()[1].enable)

    async def disable(self) -> str:
        """Stop the arm, allow no more motions, and switch the motors off where that can be."""
        return await self._command(self._connected()[1].disable)

    async def reset(self) -> str:
        """Reset the controller's error, also after an E-stop. The arm stays disabled."""
        return await self._command(self._connected()[1].reset_error)

    async def stop(self) -> str:
        """Stop the arm; return a sentence when it stands. A motion that runs is aborted."""
        return await self._command(self._connected()[1].stop)

    # --- motions ----------------------------------------------------------------------------

    async def move_joints(
        self,
        target: npt.ArrayLike,
        *,
        speed: float = 1.0,
        acceleration: float = 1.0,
        wait: bool = True,
    ) -> Motion:
        """Move straight in joint space to n joint positions, rad (m), as fast as allowed.

        speed, acceleration: shares of the joint limits, (0, 1]. wait: until the arm is there; a
        caller that is cancelled meanwhile stops the arm. Otherwise return at once.

        Raises ValueError for bad arguments; MotionError if the arm is not enabled, a motion runs
        already (none replaces it unnoticed: wait for it or cancel it), or this one fails.
        """
        limits = self.model.limits
        moves.check_shares(speed, acceleration)
        positions = moves.joint_rows('target', target, limits, rows=False)
        moves.targets('target', positions[None, :], limits)
        start, plan = await self._ready()
        trajectory = moves.straight(
            start, positions, limits, speed, acceleration, sampled=self._interpolates
        )
        return await self._execute(trajectory, plan, wait)

    async def move_waypoints(
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
        limits = self.model.limits
        moves.check_shares(speed, acceleration)
        waypoints = moves.targets('points', points, limits)
        start, plan = await self._ready()
        scaled = moves.scaled_limits(limits, speed, acceleration)
        smoother = SmoothingProcess(scaled, Smoothing(time_optimal=True))
        try:
            trajectory = await smoother.prepared(waypoints, start)
        except SmoothingError as error:
            raise not_begun(str(error)) from error
        finally:
            await smoother.close()
        return await self._execute(trajectory, plan, wait)

    async def move_trajectory(
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
        limits = self.model.limits
        trajectory = moves.planned(times, positions, velocities, joint_names, limits)
        return await self._execute(trajectory, GoalPlan(), wait)

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
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, slow=slow
        )
        point = moves.PathPoint(self._frames.target('pose', pose, frame))
        return await self._move_tool(point.run, tool, wait)

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
        slow: bool = False,
        wait: bool = True,
    ) -> Motion:
        """Move the tool on a circle through a point, x y z in m, to a pose in the same frame.

        The point is x y z also where the pose is an EpsonPoint. The rest as in `move_line`.
        """
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, slow=slow
        )
        middle = self._frames.point('via', via, frame, pose)
        point = moves.PathPoint(self._frames.target('pose', pose, frame), middle)
        return await self._move_tool(point.run, tool, wait)

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
        tool = moves.tool_limits(
            speed, acceleration, turn_speed, turn_acceleration, accuracy, slow=slow
        )
        ways = moves.path_points(points, blend, frame, self._frames)
        return await self._move_tool(partial(moves.path_runs, ways), tool, wait)

    async def _move_tool(
        self, path: Callable[[Array], list[Run]], limits: ToolLimits, wait: bool
    ) -> Motion:
        tool, arm = self._hand
        tool.check(limits.speed, limits.acceleration)
        start, plan = await self._ready()
        way = path(arm.forward(start))
        with refusals():
            trajectory = await plan.in_thread(partial(runs_trajectory, arm, start, way, limits))
        return await self._execute(trajectory, plan, wait)

    @property
    def speed_scaling(self) -> float:
        """The share of the planned speed at which all motions run."""
        return self._connected()[0].goal_queue.scaling.target

    def set_speed_scaling(self, factor: float) -> None:
        """Run all motions at this share of their planned speed, also those that run: 0 pauses.

        From 0.01 to 1, or 0. It is reached in half a second at most (docs/goals.md).
        """
        driver, _ = self._connected()
        driver.goal_queue.scaling.set(float(factor), asyncio.get_running_loop().time())

    # --- callbacks --------------------------------------------------------------------------

    def on_estop(self, callback: Callable[[bool], object]) -> Callable[[], None]:
        """Have it called when the E-stop is pressed (True) or reset (False).

        Callbacks run in the event loop and must return at once; the arm is disabled by then. One
        that raises is reported to the loop's exception handler, and the arm is stopped. Returns
        what takes the callback away again.
        """
        return self._changes.estop.add(callback)

    def on_error(self, callback: Callable[[ControllerError | None], object]) -> Callable[[], None]:
        """Have it called when the controller has another error, or none any more. As on_estop."""
        return self._changes.error.add(callback)

    def on_link(self, callback: Callable[[str, str], object]) -> Callable[[], None]:
        """Have it called with the links' state and why, when it changes. As on_estop.

        States: disconnected, connecting, connected, backing_off (waiting for the next attempt).
        """
        return self._changes.link.add(callback)

    def callback_failed(self, error: Exception) -> None:
        """Stop and disable the arm: what the user's program wanted to do then was not done."""
        why = f'a callback failed: {type(error).__name__}: {error}'
        report_error(why, error)
        if self._driver is not None:
            self._driver.fault(why)

    # --- from the driver (DriverEvents) -----------------------------------------------------

    def on_joints(self, _sample: JointSample) -> None:
        """Joints came."""
        self._heard.notify_all()

    def on_status(self, status: Status) -> None:
        """A status came."""
        self._heard.notify_all()
        self._changes.see(status)

    def on_link_state(self, name: str, why: str) -> None:
        """The state of the links changed."""
        if name in ('backing_off', 'disconnected'):
            self._link_reason = why
        self._heard.notify_all()
        self._changes.link.call(name, why)

    # --- within -----------------------------------------------------------------------------

    @property
    def _interpolates(self) -> bool:
        """Whether the controller interpolates between positions and velocities at given times."""
        return self._setup.configuration.delivery.point_message == 'joint_traj_pt_full'

    def _connected(self) -> tuple[Driver, ArmCommands]:
        if self._task is None or self._driver is None or self._commands is None:
            raise RobotError(f'there is no connection ({self._link_reason}): call connect()')
        if self._task.done():
            failure = None if self._task.cancelled() else self._task.exception()
            raise RobotError(f'the driver has ended ({failure}): call close(), then connect()')
        return self._driver, self._commands

    def _driven_gripper(self) -> DrivenGripper | None:
        self._connected()
        return self._gripper

    async def _wait_until_ready(self, driver: Driver, timeout: float) -> None:
        try:
            async with asyncio.timeout(timeout):
                while self._missing(driver):
                    self._connected()
                    await self._heard.wait()
        except TimeoutError as error:
            missing = '; '.join(self._missing(driver))
            raise RobotError(f'not ready within {timeout:g} s: {missing}') from error

    def _missing(self, driver: Driver) -> list[str]:
        """Return what is not there yet, each in a clause with what to do about it."""
        down = [link for link in (driver.state_link, driver.motion_link) if not link.connected]
        if down:
            names = ' and '.join(f'the {link.name} link to port {link.port}' for link in down)
            verb = 'is' if len(down) == 1 else 'are'
            return [
                f'{names} {verb} not connected ({self._link_reason}): start the controller, or '
                'check host and ports'
            ]
        missing = []
        if (why := driver.robot.why_not_ready(asyncio.get_running_loop().time())) is not None:
            missing.append(f'{why}: is the state server of the controller running?')
        if driver.robot.status is None:
            missing.append('the controller sends no STATUS')
        return missing

    async def _command(self, command: Callable[[], Coroutine[Any, Any, str]]) -> str:
        try:
            return in_python(await command())
        except CommandError as error:
            raise RobotError(str(error)) from error

    async def _ready(self) -> tuple[Array, GoalPlan]:
        """Return where the arm is, and what ends with whatever forbids the motion from now on.

        Raises MotionError unless it may begin to move now.
        """
        driver, _ = self._connected()
        self._check_idle(driver)
        plan = driver.goal_queue.plans.begin()
        now = asyncio.get_running_loop().time()
        if driver.gate.reason is None:
            now = await self._fresh_moment()
        with refusals():
            plan.check()
            sample = driver.goal_queue.check_ready(now)
        return sample.positions, plan

    async def _execute(self, trajectory: Trajectory, plan: GoalPlan, wait: bool) -> Motion:
        driver, _ = self._connected()
        self._check_idle(driver)
        with refusals():
            plan.check()
        setup = self._setup
        units = setup.model.limits.units
        goal = Goal(trajectory, setup.goal_tolerance, setup.goal_time, units=units)
        motion = Motion(driver.goal_queue, goal)
        motion.begin()
        if wait:
            try:
                await motion.wait()
            except asyncio.CancelledError:
                with contextlib.suppress(MotionError):  # it ended otherwise: not in the way
                    await motion.cancel()
                raise
        return motion

    @staticmethod
    def _check_idle(driver: Driver) -> None:
        if not driver.goal_queue.idle:
            raise not_begun('another motion runs: wait for its end, or cancel it first')

    async def _stop_before_leaving(self, driver: Driver, commands: ArmCommands) -> None:
        if driver.goal_queue.idle and driver.stopper.over and not driver.stopper.ours:
            return
        try:
            _log.info('leaving: %s', in_python(await commands.stop()))
        except CommandError as error:
            _log.error('leaving, but %s', in_python(str(error)))
