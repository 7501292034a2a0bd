# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot of the Python API and its driver, which runs from connecting to closing.

What the public classes do passes here: there is a connection or a sentence that says why not, the
pose is fresh, nothing else moves the arm, and what leaves stops it first.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, TypeVar

from epson_driver.api.callbacks import Changes
from epson_driver.api.errors import MotionError, RobotError, in_python, not_begun, refusals
from epson_driver.api.motion import Motion
from epson_driver.api.settings import Setup
from epson_driver.api.simulation import SimulatedController
from epson_driver.api.status import RobotStatus, robot_status
from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.goal.goal_plan import GoalPlan
from epson_driver.driver.io.gripper import Gripper as DrivenGripper
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks.fresh_moment import fresh_moment
from epson_driver.driver.tasks.notification import Notification
from epson_driver.driver.tasks.task_group import report_error
from epson_driver.motion import Array, Trajectory
from epson_driver.simple_message import Status

FRESH_POSE_TIMEOUT_S = 0.5
"""How long to wait for joints if those that are there are too old, s."""

T = TypeVar('T')

_log = logging.getLogger(__name__)


class Connection:
    """The driver of one robot while there is a connection. Everything runs in its event loop.

    simulation: a controller that is started with it, and ends with it; it may be set before.
    """

    def __init__(self, setup: Setup, simulation: SimulatedController | None = None) -> None:
        self._setup = setup
        self.simulation = simulation
        self.driver: Driver | None = None
        self.task: asyncio.Task[None] | None = None
        """What runs the driver."""
        self._commands: ArmCommands | None = None
        self._gripper: DrivenGripper | None = None
        self._heard = Notification()
        self._link_reason = 'not connected yet'
        self._moment: float | None = None
        """When what is read now had come, loop time, s; None: nobody made sure."""
        errors = setup.configuration.errors
        assert errors is not None  # noqa: S101 - for the type checker: make_setup loads them
        self.changes = Changes(self.callback_failed, errors)

    @property
    def interpolates(self) -> bool:
        """Whether the controller interpolates between positions and velocities at given times."""
        return self._setup.configuration.delivery.point_message == 'joint_traj_pt_full'

    @property
    def running(self) -> Driver:
        """The driver. Raises RobotError if there is no connection, or the driver has ended."""
        return self._connected()[0]

    @property
    def status(self) -> RobotStatus:
        """What is known of arm and controller. Raises RobotError before `connect`."""
        if self.driver is None or self._commands is None:
            raise RobotError(f'there is no connection ({self._link_reason}): call connect()')
        return robot_status(self.driver, self._commands, self._link_reason)

    @property
    def gripper(self) -> DrivenGripper | None:
        """The gripper, if there is one. Raises as `running`."""
        self._connected()
        return self._gripper

    # --- from connecting to closing ---------------------------------------------------------

    async def connect(self, timeout: float) -> None:
        """Connect, and wait until the controller has told its state and where the arm is.

        Raises RobotError that says what is missing after `timeout` s.
        """
        if self.task is not None:
            raise RobotError('the robot is connected already')
        configuration = self._setup.configuration
        try:
            if self.simulation is not None:
                there = await self.simulation.start()
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
            self.driver, self._commands = driver, ArmCommands(driver)
            wiring = self._setup.gripper
            self._gripper = None if wiring is None else DrivenGripper(driver.io, wiring)
            self.task = asyncio.create_task(driver.run())
            self.task.add_done_callback(lambda _: self._heard.notify_all())
            await self._wait_until_ready(driver, timeout)
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Stop the arm, disable it, and disconnect. Nothing if there is no connection."""
        task, driver, commands = self.task, self.driver, self._commands
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
            self.task = self.driver = self._commands = None
            self._link_reason = 'the connection was closed'
            if self.simulation is not None:
                await self.simulation.close()

    async def _wait_until_ready(self, driver: Driver, timeout: float) -> None:
        try:
            async with asyncio.timeout(timeout):
                while self._missing(driver):
                    self._connected()
                    await self._heard.wait()
        except TimeoutError as error:
            if missing := '; '.join(self._missing(driver)):
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

    async def _stop_before_leaving(self, driver: Driver, commands: ArmCommands) -> None:
        if driver.goal_queue.idle and driver.stopper.over and not driver.stopper.ours:
            return
        try:
            _log.info('leaving: %s', in_python(await commands.stop()))
        except CommandError as error:
            _log.error('leaving, but %s', in_python(str(error)))

    def _connected(self) -> tuple[Driver, ArmCommands]:
        if self.task is None or self.driver is None or self._commands is None:
            raise RobotError(f'there is no connection ({self._link_reason}): call connect()')
        if self.task.done():
            failure = None if self.task.cancelled() else self.task.exception()
            raise RobotError(f'the driver has ended ({failure}): call close(), then connect()')
        return self.driver, self._commands

    # --- the pose ---------------------------------------------------------------------------

    async def fresh_moment(self) -> float:
        """Return a moment at which the joints are not too old, if that can be: half a second."""
        driver = self.running
        return await fresh_moment(driver.robot.stale, self._heard, FRESH_POSE_TIMEOUT_S)

    async def measured(self, read: Callable[[], T]) -> T:
        """Return what `read` does, with a `sample` as of a fresh moment."""
        self._moment = await self.fresh_moment()
        try:
            return read()
        finally:
            self._moment = None

    def sample(self) -> JointSample:
        """Return the newest joints. Raises RobotError if they are too old."""
        driver = self.running
        now = asyncio.get_running_loop().time() if self._moment is None else self._moment
        if (why := driver.robot.why_not_ready(now)) is not None:
            raise RobotError(f'nobody knows where the arm is: {why}')
        assert driver.robot.sample is not None  # noqa: S101 - for the type checker
        return driver.robot.sample

    # --- commands and motions ---------------------------------------------------------------

    async def command(self, command: Callable[[ArmCommands], Coroutine[Any, Any, str]]) -> str:
        """Have a command done; return its sentence. Raises RobotError."""
        _, commands = self._connected()
        try:
            return in_python(await command(commands))
        except CommandError as error:
            raise RobotError(str(error)) from error

    async def ready(self) -> tuple[Array, GoalPlan]:
        """Return where the arm is, and what ends with whatever forbids the motion from now on.

        Raises MotionError unless it may begin to move now.
        """
        driver = self.running
        self._check_idle(driver)
        plan = driver.goal_queue.plans.begin()
        now = asyncio.get_running_loop().time()
        if driver.gate.reason is None:
            now = await self.fresh_moment()
        with refusals():
            plan.check()
            sample = driver.goal_queue.check_ready(now)
        return sample.positions, plan

    async def execute(self, trajectory: Trajectory, plan: GoalPlan, *, wait: bool) -> Motion:
        """Begin a motion; with `wait`, wait for its end, and stop it when cancelled meanwhile.

        Raises MotionError if it was ended while it was planned, is not begun, or fails.
        """
        driver = self.running
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

    # --- from the driver (DriverEvents) -----------------------------------------------------

    def on_joints(self, _sample: JointSample) -> None:
        """Joints came."""
        self._heard.notify_all()

    def on_status(self, status: Status) -> None:
        """A status came."""
        self._heard.notify_all()
        self.changes.see(status)

    def on_link_state(self, name: str, why: str) -> None:
        """The state of the links changed."""
        if name in ('backing_off', 'disconnected'):
            self._link_reason = why
        self._heard.notify_all()
        self.changes.link.call(name, why)

    def callback_failed(self, error: Exception) -> None:
        """Stop and disable the arm: what the user's program wanted to do then was not done."""
        why = f'a callback failed: {type(error).__name__}: {error}'
        report_error(why, error)
        if self.driver is not None:
            self.driver.fault(why)
