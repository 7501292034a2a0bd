# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robot of a panel without ROS: the driver of a connected Python Robot, in this process."""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Any

from epson_driver.api.connection import Connection
from epson_driver.api.errors import RobotError
from epson_driver.api.points import Points
from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.inhibit import Purpose
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.driver.outcome import End, Outcome
from epson_driver.driver.remedy import with_remedy
from epson_driver.driver.servo.setpoint import Setpoint
from epson_driver.motion import Array, Trajectory
from epson_driver.panel.robot_state import (
    ERROR,
    INFO,
    MAX_TAUGHT_POINTS,
    TRIGGERS,
    WARN,
    Event,
    IoRange,
    RequestError,
    RobotState,
    Say,
    Status,
    Tri,
)
from epson_driver.panel.status_lamps import WORDS
from epson_driver.robots.kinematics import Kinematics
from epson_driver.simple_message import IoSetting, IoType, Mode
from epson_driver.simple_message import Status as DriverStatus
from epson_driver.tool_motion.tool_pose import quaternion_pose

SOURCE = 'the panel'  # name of its stream of setpoints, for texts
MODES = {int(Mode.AUTO): 'AUTO', int(Mode.MANUAL): 'MANUAL'}

_package = logging.getLogger('epson_driver')


class EventLog(logging.Handler):
    """Log handler that adds the package's log lines of one thread to the page."""

    def __init__(self, state: RobotState, thread: int | None) -> None:
        super().__init__(logging.INFO)
        self._state, self._thread = state, thread

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._thread:
            self._state.add_event(Event(record.created, record.levelno, record.getMessage()))


class ApiGoal:
    """A motion requested by the panel. Only the event loop uses it.

    `handle` is set once the motion is submitted.
    """

    def __init__(self) -> None:
        self.ended = threading.Event()
        self.canceled = False
        self.handle: GoalHandle | None = None


class ApiRobot:
    """The single robot of a panel: the driver of a connected Robot.

    The driver runs in the event loop of the connection, in the thread with the number `thread`.
    `sample` only schedules a read of the driver's state in this loop. While the loop hangs, the
    state becomes stale. `on_error` is called with an unexpected exception.
    """

    def __init__(
        self,
        connection: Connection,
        driver: Driver,
        points: Points,
        thread: int,
        on_error: Callable[[str, BaseException], None],
    ) -> None:
        setup, configuration = connection.setup, driver.configuration
        self.name = self.label = setup.model.name
        self.robots = {self.name: self}
        self.parameters: dict[str, Any] = {
            'robot_model': setup.values['robot_model'],
            'robot_ip': configuration.host,
            'remote_port': configuration.remote_port,
        }
        # This process has one driver, which no other one can replace.
        self.state = RobotState(times={'first joints': 0.0, 'parameters': 0.0})
        self._connection = connection
        self._points = points
        self._on_error = on_error
        self._names = setup.model.joint_names
        self._arm = Kinematics(setup.model)
        self._goals: list[ApiGoal] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._reading = False
        self._log = EventLog(self.state, thread)
        if not _package.hasHandlers() and logging.lastResort is not None:
            _package.addHandler(logging.lastResort)  # which another handler would switch off
        _package.addHandler(self._log)

    def close(self) -> None:
        _package.removeHandler(self._log)

    # --- the driver's state -----------------------------------------------------------------

    def sample(self, _now: float) -> None:
        if not self._reading:
            self._reading = True
            self._in_loop('reading the driver', self._read)

    def discover(self, _now: float) -> None:
        self._in_loop('reading the points', self._read_points)

    def _read(self) -> None:
        self._reading = False
        with contextlib.suppress(RobotError):  # the driver has ended: the state becomes stale
            self._update(self._connection.running, self._connection.loop.time())

    def _update(self, driver: Driver, now: float) -> None:
        state, robot, goals = self.state, driver.robot, driver.goal_queue
        sample, execution = robot.sample, goals.execution
        state.link = driver.link_state.value
        if sample is not None and not robot.joints_unavailable:
            state.joint_names, state.positions = self._names, sample.positions
            state.measured, state.times['joints'] = sample.measured, sample.time
            if execution is not None and execution.desired is not None:
                state.reference = execution.desired[1]
                state.tracking_error = state.reference - sample.positions
                state.times['reference'] = now
        if robot.joints_unavailable:
            state.times['joints withheld'] = now
        state.status = _status(robot.status or DriverStatus())
        delivery = driver.stopper.delivery
        state.gate_open = driver.gate.reason is None
        state.goal_running = goals.busy
        state.no_plans = delivery.no_plans
        state.no_streams = delivery.no_streams or goals.why_no_stream
        state.inhibit = driver.why_not(Purpose.REPORT, now)
        state.speed = goals.scaling.factor(now)
        io = driver.io
        state.io_reason = '' if io.states else io.reason
        state.io = tuple(IoRange(item.io_type, item.start, item.values) for item in io.states)
        state.times |= {'status': now, 'diagnostics': now}

    def _read_points(self) -> None:
        places = list(self._points.places.items())[:MAX_TAUGHT_POINTS]
        self.state.taught = {
            name: quaternion_pose(self._arm.from_base(point.pose)) for name, point in places
        }

    # --- requests ---------------------------------------------------------------------------

    def trigger(self, name: str, say: Say) -> None:
        if name not in TRIGGERS:
            raise RequestError(f'unknown command {name}')
        self._request(name, lambda: getattr(self._connection.commands, name)(), say)

    def set_speed(self, factor: float, say: Say) -> None:
        async def work() -> str:
            return self._connection.running.goal_queue.set_speed(factor)

        self._request('speed', work, say)

    def write_output(self, index: int, value: int, say: Say) -> None:
        async def work() -> str:
            setting = IoSetting(IoType.DIGITAL_OUTPUT, index, value)
            (answer,) = await self._connection.running.io.write([setting])
            if answer.text:
                raise RequestError(answer.text)
            return 'on' if value else 'off'

        self._request(f'output {index}', work, say)

    def jog(self, _names: Sequence[str], velocities: Array) -> None:
        setpoint, arrival = Setpoint(SOURCE, None, velocities), time.monotonic()

        def take() -> None:
            with contextlib.suppress(RobotError):  # no driver moves the arm
                self._connection.running.servo.take(setpoint, arrival)

        with contextlib.suppress(RequestError):
            self._in_loop('jogging', take)

    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None:
        """Send a trajectory as a goal. The goal is refused while another motion is running."""
        goal = ApiGoal()

        def end(outcome: str, level: int) -> None:
            goal.ended.set()
            self._goals.remove(goal)
            say(f'{text}: {outcome}', level)

        def on_end(outcome: Outcome) -> None:
            level = INFO if outcome.end is End.SUCCEEDED else WARN
            end(with_remedy(outcome.text, outcome.remedy, WORDS), level)

        def submit() -> None:
            if goal.canceled:
                end('canceled before it was sent', WARN)
                return
            try:
                queue = self._connection.running.goal_queue
                request = self._connection.setup.goal(trajectory)
                goal.handle = GoalHandle(
                    request, on_end, lambda *_: None, plan=PlanningCancellation()
                )
                queue.submit(goal.handle)
            except RobotError as error:
                end(str(error), ERROR)

        self._goals.append(goal)
        try:
            self._in_loop(text, submit)
        except RequestError:
            self._goals.remove(goal)
            raise

    @property
    def goals(self) -> list[ApiGoal]:
        return list(self._goals)

    def cancel_goals(self) -> list[ApiGoal]:
        goals = self.goals

        def cancel(goal: ApiGoal) -> None:
            if goal.handle is not None:
                with contextlib.suppress(RobotError):  # its driver has ended, and the goal with it
                    self._connection.running.goal_queue.cancel(goal.handle)

        for goal in goals:
            goal.canceled = True
            with contextlib.suppress(RequestError):
                self._in_loop('canceling a goal', partial(cancel, goal))
        return goals

    def log(self, text: str, level: int) -> None:
        self.state.add_event(Event(time.time(), level, text))

    # --- in the event loop ------------------------------------------------------------------

    def _request(self, name: str, work: Callable[[], Coroutine[Any, Any, str]], say: Say) -> None:
        """Run `work()` in the loop. Call `say` with its result, or with the text of its error."""

        async def run() -> None:
            try:
                say(f'{name}: {await work()}', INFO)
            except CommandError as error:
                say(f'{name}: {with_remedy(str(error), error.remedy, WORDS)}', ERROR)
            except (RobotError, RequestError, IoUnavailableError, ValueError) as error:
                say(f'{name}: {error}', ERROR)
            except asyncio.CancelledError:
                say(f'{name}: the connection was closed before the answer', ERROR)
                raise
            except Exception as error:  # noqa: BLE001 - it is reported, and stops the arm
                say(f'{name} failed: {type(error).__name__}: {error}', ERROR)
                self._failed(name, error)

        def start() -> None:
            task = asyncio.get_running_loop().create_task(run())
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

        self._in_loop(name, start)

    def _in_loop(self, what: str, function: Callable[[], object]) -> None:
        """Call `function` in the loop. Raises RequestError if the connection is closed."""

        def call() -> None:
            try:
                function()
            except Exception as error:  # noqa: BLE001 - it is reported, and stops the arm
                self._failed(what, error)

        try:
            self._connection.loop.call_soon_threadsafe(call)
        except RuntimeError as error:  # the loop is closed
            raise RequestError('the connection of the robot was closed') from error

    def _failed(self, what: str, error: Exception) -> None:
        self._connection.failed(f'{what} failed: {type(error).__name__}: {error}', error)
        self._on_error(f'{what} failed', error)


def _status(status: DriverStatus) -> Status:
    return Status(
        _tri(status.e_stopped),
        _tri(status.drives_powered),
        _tri(status.motion_possible),
        _tri(status.in_motion),
        _tri(status.in_error),
        MODES.get(status.mode, ''),
        (status.error_code,) if status.error_code else (),
    )


def _tri(value: int) -> Tri:
    return Tri(value) if value in (0, 1) else Tri.UNKNOWN
