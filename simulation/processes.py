# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's clients: the process of a ROS node, or of a Python program.

Calls that a node's callbacks make in the driver, and calls of the public Python API, run in the
context of a process, while it is alive. ROS itself is simulated.
"""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import copy_context
from functools import partial
from typing import Any, Protocol, TypeVar

import numpy as np

from epson_driver.aio import MotionError, Robot, RobotError
from epson_driver.api.ownership import release
from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.goal.goal_queue import FRESH_POSE_TIMEOUT_S, GoalHandle
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation, PlanningEndedError
from epson_driver.driver.io.io_client import IoAnswer
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.servo.setpoint import Setpoint, came_at
from epson_driver.driver.tasks import wait_for_fresh_state
from epson_driver.motion import Array, Trajectory
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics
from epson_driver.simple_message import IoAddress, IoSetting, IoType, Status
from epson_driver.tool_motion.motion_sequence import (
    Kind,
    Primitive,
    SequenceError,
    plan_sequence,
)
from simulation.network import PROCESS
from simulation.virtual_loop import VirtualLoop

T = TypeVar('T')

TOLERANCE_RAD = 0.01
"""Goal tolerance, and the tolerance for the final position of a successful goal."""

CONNECT_S, CONNECT_AGAIN_S = 10.0, 0.5
"""Time for which a program tries to connect, and time until its next attempt, s."""

OnEnd = Callable[[Outcome, Array | None], object]
"""on_end(outcome, target) is called when a goal has ended. target: joints, rad (None: unknown)."""


class DiedError(Exception):
    """The process died before it answered."""


class WorldInterface(Protocol):
    """The parts of the world used by processes. It receives the driver's publications."""

    loop: VirtualLoop

    def say(self, text: str) -> None: ...

    def process_over(self, task: 'asyncio.Task[None]') -> None: ...

    def on_joints(self, sample: Any) -> None: ...

    def on_status(self, status: Status) -> None: ...

    def on_link_state(self, name: str, why: str) -> None: ...


class Process:
    """A process from its start to its death. `lives` prevents garbage collection."""

    def __init__(self, world: WorldInterface, number: int) -> None:
        self.name = f'driver {number}'
        self.context = copy_context()
        self.context.run(PROCESS.set, self.name)
        self.lives: list[Any] = []
        self.died: asyncio.Future[None] = world.loop.create_future()
        self._world = world

    def die(self) -> None:
        self._world.loop.kill(self.name)
        if not self.died.done():
            self.died.set_result(None)

    @property
    def hangs(self) -> bool:
        return self.name in self._world.loop.hanging

    def call(self, callback: Callable[[], object]) -> None:
        self._world.loop.call_soon(callback, context=self.context)

    def begin(self, work: Coroutine[Any, Any, T]) -> 'asyncio.Task[T]':
        task: asyncio.Task[T] = self.context.copy().run(self._world.loop.create_task, work)
        self.lives.append(task)
        return task

    async def ask(self, work: Callable[[], Awaitable[T]]) -> T:
        """Run `work` in the process and return its result or raise its error, or DiedError."""
        answer: asyncio.Future[T] = self._world.loop.create_future()

        async def done() -> None:
            try:
                answer.set_result(await work())
            except Exception as error:  # noqa: BLE001 - raised where it is awaited
                answer.set_exception(error)

        self.begin(done())
        either: set[asyncio.Future[Any]] = {answer, self.died}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not answer.done():
            raise DiedError
        return answer.result()


class NodeProcess(Process):
    """The process of the ROS node: its driver, and the actions of its callbacks."""

    def __init__(
        self,
        world: WorldInterface,
        number: int,
        configuration: Configuration,
        model: RobotModel,
    ) -> None:
        super().__init__(world, number)
        self._arm = Kinematics(model)
        self.driver = self.context.run(
            Driver, configuration, world, GoalSettings(require_planned_speed=False)
        )
        self._commands = ArmCommands(self.driver)
        self._handles: dict[int, GoalHandle] = {}
        self._plans: dict[int, PlanningCancellation] = {}
        self._running = self.begin(self.driver.run())
        self._running.add_done_callback(world.process_over)
        self.lives.append(self.driver)

    @property
    def linked(self) -> bool:
        driver = self.driver
        known = driver.robot.sample is not None and driver.robot.status is not None
        return known and all(link.connected for link in driver.links)

    @property
    def gate(self) -> bool | None:
        """Whether the node's diagnostics report an enabled arm. None: no diagnostics."""
        return None if self.died.done() or self.hangs else self.driver.gate.reason is None

    async def leave(self, *, lost: bool) -> None:
        """Exit like on SIGTERM: stop the arm, then all work."""
        with contextlib.suppress(DiedError, TimeoutError):  # like node/client_process.py
            await self.ask(self.driver.shut_down)
        self.call(self._running.cancel)
        await asyncio.wait([self._running, self.died], return_when=asyncio.FIRST_COMPLETED)
        self.die()

    async def command(self, name: str) -> str:
        message: str = await getattr(self._commands, name)()
        return message

    def scale(self, factor: float) -> None:
        self.driver.goal_queue.set_speed(factor)

    def take(self, setpoint: Setpoint, received: int, missed: bool) -> None:
        """Process a setpoint received by the middleware at `received`, ns of the system clock.

        missed: its publisher had sent before the process was running.
        """
        self.driver.servo.take(setpoint, came_at(received), missed=missed)

    def hand_in(self, number: int, trajectory: Trajectory, on_end: OnEnd) -> None:
        self.call(partial(self._submit, number, trajectory, on_end))

    def _submit(self, number: int, trajectory: Trajectory, on_end: OnEnd) -> None:
        goal = Goal(trajectory, np.full(len(trajectory.joint_names), TOLERANCE_RAD), 0.0)
        ended = partial(self._ended, number, on_end, trajectory.positions[-1])
        self._handles[number] = handle = GoalHandle(goal, ended, lambda *_: None)
        self.driver.goal_queue.submit(handle)

    def _ended(self, number: int, on_end: OnEnd, target: Array, outcome: Outcome) -> None:
        handle = self._handles.pop(number, None)
        if handle is not None:
            handle.outcome = outcome
        on_end(outcome, target)

    def cancel(self, number: int) -> bool:
        self.call(partial(self._cancel, number))
        return True

    def _cancel(self, number: int) -> None:
        if number in self._handles:
            self.driver.goal_queue.cancel(self._handles[number])
        elif number in self._plans:
            self._plans[number].end('canceled')

    def move_tool(
        self, number: int, ways: list[list[float]], blend: float, speed: float, on_end: OnEnd
    ) -> None:
        """Submit a sequence of tool lines with the given displacements, m."""
        self.begin(self._sequence(number, ways, blend, speed, on_end))

    async def _sequence(
        self, number: int, ways: list[list[float]], blend: float, speed: float, on_end: OnEnd
    ) -> None:
        queue, robot = self.driver.goal_queue, self.driver.robot
        self._plans[number] = plan = queue.plans.begin()
        try:
            now = await wait_for_fresh_state(
                robot.why_not_ready, self.driver.changed, FRESH_POSE_TIMEOUT_S
            )
            start = queue.ready_sample(now).positions
            lines = self._lines(start, ways, blend, speed)
            planned = await plan.in_thread(
                lambda checkpoint: plan_sequence(self._arm, start, lines, checkpoint=checkpoint)
            )
            plan.check()
            if not queue.idle or self.driver.statements is not None:
                raise SequenceError('another goal runs, or the controller takes no plans')
        except (GoalRejectedError, SequenceError, PlanningEndedError) as error:
            on_end(Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, str(error)), None)
        else:
            self._submit(number, planned.trajectory, on_end)
        finally:
            del self._plans[number]

    def _lines(
        self, start: Array, ways: list[list[float]], blend: float, speed: float
    ) -> list[Primitive]:
        pose, lines = self._arm.forward(start), []
        for index, way in enumerate(ways):
            pose = pose.copy()
            pose[:3, 3] += way
            last = index == len(ways) - 1
            lines.append(
                Primitive(
                    Kind.LINEAR_CARTESIAN,
                    pose,
                    velocity=speed,
                    blend_radius=0.0 if last else blend,
                )
            )
        return lines

    async def read(self, index: int) -> int:
        return _one(await self.driver.io.read([IoAddress(IoType.DIGITAL_OUTPUT, index)]))

    async def write(self, index: int, value: int) -> None:
        _one(await self.driver.io.write([IoSetting(IoType.DIGITAL_OUTPUT, index, value)]))


def _one(answers: list[IoAnswer]) -> int:
    if answers[0].text:
        raise IoUnavailableError(answers[0].text)
    return answers[0].value


class RobotProcess(Process):
    """A program that uses the Python API. It creates a new Robot after a close or a loss."""

    def __init__(
        self, world: WorldInterface, number: int, make: Callable[[], Robot], model: RobotModel
    ) -> None:
        super().__init__(world, number)
        self._make = make
        self._arm = Kinematics(model)
        self._motions: dict[int, Any] = {}
        self._robot: Robot | None = None
        self._asking = 0
        self.linked = False
        self.begin(self._connect())

    @property
    def gate(self) -> bool | None:
        """Return None, because a program publishes no diagnostics."""
        return None

    async def _connect(self) -> None:
        self._robot = self._make()
        self.lives.append(self._robot._connection)  # noqa: SLF001 - a dead process closes nothing
        self._robot.on_joints(self._world.on_joints)
        while not self.linked:
            try:
                await self._robot.connect(CONNECT_S)
                self.linked = True
            except RobotError as error:
                self._world.say(f'connect: {error}')
                await asyncio.sleep(CONNECT_AGAIN_S)

    def die(self) -> None:
        """Kill the process and release everything it owned."""
        super().die()
        if self._robot is not None:
            release(self._robot._connection)  # noqa: SLF001 - its memory is gone
            self.lives.append(self._robot)

    @property
    def _there(self) -> Robot:
        if self._robot is None:
            raise RobotError('there is no robot now')
        return self._robot

    async def leave(self, *, lost: bool) -> None:
        """Close the robot, or drop the last reference to it without a close."""
        if not self.linked:
            return
        self.linked = False
        await self.ask(partial(self._release, lost and not self._asking))

    async def _release(self, lost: bool) -> None:
        robot, self._robot = self._robot, None
        if robot is not None and not lost:
            await robot.close()

    def come_back(self) -> None:
        if not self.linked and self._robot is None:
            self.begin(self._connect())

    async def command(self, name: str) -> str:
        self._asking += 1
        try:
            method = 'reset' if name == 'reset_error' else name
            message: str = await getattr(self._there, method)()
        finally:
            self._asking -= 1
        return message

    def scale(self, factor: float) -> None:
        try:
            self._there.set_speed_scaling(factor)
        except RobotError as error:
            raise ValueError(str(error)) from error

    def take(self, setpoint: Setpoint, _received: int, _missed: bool) -> None:
        with contextlib.suppress(RobotError):
            if setpoint.positions is not None:
                self._there.servo(setpoint.positions, setpoint.velocities)
            elif setpoint.velocities is not None:
                self._there.servo_velocity(setpoint.velocities)

    def hand_in(self, number: int, trajectory: Trajectory, on_end: OnEnd) -> None:
        times, points = trajectory.times, trajectory.positions

        async def move() -> Any:
            if len(times) == 1:
                return await self._there.move_joints(points[0], wait=False)
            return await self._there.move_trajectory(times, points, wait=False)

        self.begin(self._motion(number, move, points[-1], on_end))

    def move_tool(
        self, number: int, ways: list[list[float]], blend: float, speed: float, on_end: OnEnd
    ) -> None:
        async def move() -> Any:
            pose, poses = self._there.tool_pose, []
            for way in ways:
                pose = pose.copy()
                pose[:3, 3] += way
                poses.append(pose)
            if len(poses) == 1:
                return await self._there.move_line(poses[0], speed=speed, wait=False)
            return await self._there.move_path(poses, blend=blend, speed=speed, wait=False)

        self.begin(self._motion(number, move, None, on_end))

    async def _motion(
        self, number: int, move: Callable[[], Awaitable[Any]], target: Array | None, on_end: OnEnd
    ) -> None:
        end, text = End.SUCCEEDED, ''
        self._asking += 1
        try:
            try:
                self._motions[number] = motion = await move()
            finally:
                self._asking -= 1
            text = await motion.wait()
        except MotionError as error:
            end, text = error.end, str(error)
        except RobotError as error:
            end, text = End.ABORTED, str(error)
        self._motions.pop(number, None)
        on_end(Outcome(end, ErrorCode.SUCCESSFUL, text), target)

    def cancel(self, number: int) -> bool:
        motion = self._motions.get(number)
        if motion is None:
            return False

        async def cancel() -> None:
            with contextlib.suppress(MotionError):
                await motion.cancel()

        self.begin(cancel())
        return True

    async def read(self, index: int) -> int:
        value: int = await self._there.io.read('DO', index)
        return value

    async def write(self, index: int, value: int) -> None:
        await self._there.io.write('DO', index, value)
