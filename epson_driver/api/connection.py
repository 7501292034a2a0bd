# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Connection of a Python Robot to its controller. It runs a driver from `connect` to `close`.

All calls of the public classes pass through a Connection. It checks that the driver is connected,
that the joints are fresh, and that no other motion runs. `close` stops the arm before it
disconnects.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, BinaryIO, TypeVar

from epson_driver.api.driver_status import Changes, robot_status
from epson_driver.api.errors import WORDS, RobotError, not_started, refusals
from epson_driver.api.motion import CheckedPath, Motion
from epson_driver.api.moves import divided
from epson_driver.api.ownership import Page, Process, close_soon, release, take_over
from epson_driver.api.simulation import SimulatedController
from epson_driver.api.status import RobotStatus, Sample
from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.delivery.statements import NO_PLANS, Load, StatementDelivery
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.inhibit import Purpose
from epson_driver.driver.io.gripper import Gripper as DrivenGripper
from epson_driver.driver.remedy import with_remedy
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import Notification, report_error, wait_for_fresh_state
from epson_driver.driver.why_not import link_remedy
from epson_driver.link import Link
from epson_driver.link.link_reports import MAX_SHORT, TURNED_AWAY
from epson_driver.motion import Array, Trajectory
from epson_driver.setup.setup import Setup
from epson_driver.simple_message import Status
from epson_driver.trace import TraceError, open_trace

FRESH_POSE_TIMEOUT_S = 0.5
"""Maximum time to wait for newer joints if the received joints are stale, s."""

CHECKS, CHECK_PERIOD_S = 5, 0.1
"""Number of consecutive checks that a stable link must pass, and the period of the checks, s. No
time is measured, because a delayed process performs fewer checks in the same time."""

T = TypeVar('T')

_log = logging.getLogger(__name__)


class Connection:
    """The connection of one Robot to its controller. It runs in the loop that called `connect`."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.simulation: SimulatedController | None = None  # started by connect, ended by close
        self.driver: Driver | None = None
        self.page: Page | None = None
        self.task: asyncio.Task[None] | None = None
        self.loop: asyncio.AbstractEventLoop
        """Event loop that called `connect`."""
        self._process = Process()
        self._lost = False
        self._load: Load | None = None
        self._commands: ArmCommands | None = None
        self._gripper: DrivenGripper | None = None
        self._received = Notification()
        self._link_reason = 'not connected yet'
        self._moment: float | None = None
        """Loop time at which `sample` checks the age of joints, s. None: the current time."""
        errors = setup.configuration.errors
        assert errors is not None  # noqa: S101 - for the type checker: make_setup loads them
        self.changes = Changes(self.callback_failed, errors)

    @property
    def running(self) -> Driver:
        return self._connected()[0]

    @property
    def commands(self) -> ArmCommands:
        """The driver's commands. Raises RobotError if not connected."""
        return self._connected()[1]

    @property
    def status(self) -> RobotStatus:
        """State of arm and controller. Raises RobotError before `connect`."""
        if self.driver is None:
            raise RobotError(f'no connection ({self._link_reason}): call connect()')
        return robot_status(self.driver, self.loop.time(), self._link_reason)

    @property
    def summary(self) -> str:
        return 'not connected' if self.driver is None else self.status.text

    @property
    def simulated(self) -> int:
        if self.simulation is None:
            raise RobotError(
                'this Robot did not start its controller: use Robot.simulated(), or `epson_driver '
                'pendant` for a running sim_controller'
            )
        return self.running.configuration.remote_port

    @property
    def gripper(self) -> DrivenGripper | None:
        self._connected()
        return self._gripper

    # --- from connecting to closing ---------------------------------------------------------

    async def connect(self, timeout: float) -> None:
        self._process.check()
        if self._stranded:
            self.task = None
        if self.task is not None:
            raise RobotError('the robot is already connected')
        self.loop = asyncio.get_running_loop()
        self._lost = False
        setup = self.setup
        try:
            if self.simulation is not None:
                ports: dict[str, Any] = await self.simulation.start()
                configuration = replace(setup.configuration, host='127.0.0.1', **ports)
                setup = replace(setup, configuration=configuration)
            await self._take_over(setup.configuration.address, timeout)
            trace = await self._open_trace()
            driver = setup.make_driver(self)
            if driver.set_load is not None:
                driver.set_load(self._load)
            if trace is not None:
                driver.trace.begin(trace)
            self.driver, self._commands = driver, ArmCommands(driver)
            wiring = setup.gripper
            self._gripper = None if wiring is None else DrivenGripper(driver.io, wiring)
            self.task = asyncio.create_task(driver.run())
            self.task.add_done_callback(lambda _: self._received.notify_all())
            if self.simulation is None:
                for sentence in setup.model.cautions:
                    _log.warning('%s', sentence)
            await self._wait_until_ready(driver, timeout)
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        if self._process.forked or self._stranded:
            self.task = None
            return
        if self.task is not None:
            self._check_loop()
        task, driver, commands = self.task, self.driver, self._commands
        page, self.page = self.page, None
        closing = asyncio.create_task(asyncio.sleep(0) if page is None else page.close())
        try:
            if task is not None and driver is not None and commands is not None:
                if not task.done():
                    await self._stop_before_leaving(driver, commands)
                    await closing  # no other task may enable the arm again
                    await driver.shut_down()
                task.cancel()
                ended = await asyncio.gather(task, return_exceptions=True)
                if isinstance(ended[0], Exception):
                    _log.error('the driver failed: %s', ended[0])
        finally:
            if task is not None:
                task.cancel()
            self.task = self.driver = self._commands = None
            self._link_reason = 'the connection was closed'
            self.changes.recorded.clear()
            release(self)
            await closing
            if self.simulation is not None:
                await self.simulation.close()

    def lost(self) -> None:
        """Schedule `close_lost` after the Robot was garbage-collected. Any thread may call it."""
        if self.task is not None:
            close_soon(self.loop, self._process, self.close_lost)

    async def close_lost(self) -> None:
        if self.task is None or self._lost:
            return
        self._lost = True
        if not self.task.done():
            _log.warning('a connected Robot was deleted: stopping the arm and closing the links')
        await self.close()

    @property
    def files(self) -> list[int]:
        driver, simulation = self.driver, self.simulation
        links = [] if driver is None else [*driver.links, driver.io.link]
        sockets = [
            link.transport.get_extra_info('socket') for link in links if link and link.transport
        ]
        return [socket.fileno() for socket in sockets] + (simulation.files if simulation else [])

    async def _open_trace(self) -> BinaryIO | None:
        folder, name = (self.setup.values[f'trace_{item}'] for item in ('folder', 'file'))
        try:
            return await asyncio.to_thread(open_trace, folder, name) if name else None
        except TraceError as error:
            raise RobotError(str(error)) from error

    async def _take_over(self, address: tuple[str, int], timeout: float) -> None:
        try:
            async with asyncio.timeout(timeout):
                await take_over(address, self)
        except TimeoutError as error:
            raise RobotError('another Robot of this program is connected: close() it') from error

    async def _wait_until_ready(self, driver: Driver, timeout: float) -> None:
        """Wait for stable links, fresh joints and a STATUS. Raises RobotError after `timeout` s.

        A link may be unstable, because a controller that serves only one client accepts a second
        client and disconnects it immediately.
        """
        links = driver.links
        try:
            async with asyncio.timeout(timeout):
                passed, connections = 0, [0 for _ in links]
                while passed < CHECKS:
                    self._connected()
                    before, connections = connections, [_count(link) for link in links]
                    if self._missing(driver):
                        passed = 0
                        await self._received.wait()
                    else:
                        passed = passed + 1 if connections == before else 0
                        await asyncio.sleep(CHECK_PERIOD_S)
        except TimeoutError as error:
            unstable = f'the links must stay connected for {CHECKS * CHECK_PERIOD_S:g} s'
            missing = self._missing(driver) or [unstable]
            if rejecting := [link for link in links if _count(link) >= MAX_SHORT]:
                names = _named(rejecting)
                missing = [f'the controller closes the {names} immediately: {TURNED_AWAY}']
            raise RobotError(f'not ready within {timeout:g} s: {"; ".join(missing)}') from error

    def _missing(self, driver: Driver) -> list[str]:
        down = [link for link in driver.links if not link.connected]
        missing = []
        if down:
            verb = 'is' if len(down) == 1 else 'are'
            text = f'the {_named(down)} {verb} not connected ({self._link_reason})'
            missing.append(f'{text}: {with_remedy("", link_remedy(down[0]), WORDS)}')
        if driver.state_link in down:
            return missing
        now = asyncio.get_running_loop().time()
        why = None if driver.robot.joints_unavailable else driver.robot.why_not_ready(now)
        if why is not None:
            missing.append(f'{why}: check that the state server of the controller is running')
        if driver.robot.status is None:
            missing.append('the controller sends no STATUS')
        return missing

    async def _stop_before_leaving(self, driver: Driver, commands: ArmCommands) -> None:
        if driver.goal_queue.idle and driver.stopper.over and not driver.stopper.ours:
            return
        try:
            _log.info('closing: %s', await commands.stop())
        except CommandError as error:
            _log.error('the stop while closing failed: %s', error)

    def _connected(self) -> tuple[Driver, ArmCommands]:
        self._process.check()
        if self.task is None or self.driver is None or self._commands is None:
            raise RobotError(f'no connection ({self._link_reason}): call connect()')
        self._check_loop()
        if self.task.done():
            failure = None if self.task.cancelled() else self.task.exception()
            raise RobotError(f'the driver has ended ({failure}): call close(), then connect()')
        return self.driver, self._commands

    @property
    def _stranded(self) -> bool:
        return self.task is not None and self.loop.is_closed()

    def _check_loop(self) -> None:
        if self.loop is not asyncio.get_running_loop():
            ended = 'has ended: call connect() in this one' if self._stranded else 'runs elsewhere'
            raise RobotError(f'this Robot was connected in another event loop, which {ended}')

    # --- the pose ---------------------------------------------------------------------------

    async def wait_for_fresh_state(self) -> float:
        """Wait for fresh joints. Return the loop time at which to check their age, s."""
        driver = self.running
        return await wait_for_fresh_state(driver.robot.stale, self._received, FRESH_POSE_TIMEOUT_S)

    async def measured(self, read: Callable[[], T]) -> T:
        """Wait for fresh joints, then return the result of `read`.

        A delay between the wait and `read` does not make the joints stale.
        """
        self._moment = await self.wait_for_fresh_state()
        try:
            return read()
        finally:
            self._moment = None

    async def next_joints(self) -> None:
        await self._received.wait()

    def sample(self) -> JointSample:
        """Return the newest joints. Raises RobotError if they are missing, stale or invalid."""
        driver = self.running
        now = asyncio.get_running_loop().time() if self._moment is None else self._moment
        if (why := driver.robot.why_not_ready(now)) is not None:
            raise RobotError(f'joint position unknown: {why}')
        assert driver.robot.sample is not None  # noqa: S101 - for the type checker
        return driver.robot.sample

    def stamped(self, joints: JointSample) -> Sample:
        ago = self.loop.time() - joints.measured
        return Sample(
            joints.positions.copy(), joints.velocities.copy(), time.time() - ago, self.status
        )

    # --- commands and motions ---------------------------------------------------------------

    async def command(self, command: Callable[[ArmCommands], Coroutine[Any, Any, str]]) -> str:
        commands = self.commands
        try:
            return await command(commands)
        except CommandError as error:
            raise RobotError(with_remedy(str(error), error.remedy, WORDS)) from error

    async def ready(self) -> tuple[Array, PlanningCancellation]:
        """Return the joint positions, shape (n,), and a scope for planning a motion from them.

        A stop, or any other event that inhibits motion, cancels the scope.
        """
        driver = self.running
        now = asyncio.get_running_loop().time()
        with refusals():
            driver.goal_queue.check(Purpose.ALONE, now)
        plan = driver.goal_queue.plans.begin()
        if driver.gate.reason is None:
            now = await self.wait_for_fresh_state()
        with refusals():
            plan.check()
            sample = driver.goal_queue.ready_sample(now)
        return sample.positions, plan

    async def execute(
        self,
        trajectory: Trajectory,
        plan: PlanningCancellation,
        *,
        wait: bool,
        path: CheckedPath | None = None,
        move: Callable[[StatementDelivery], str] | None = None,
        remark: str = '',
    ) -> Motion:
        """Start a motion. With `wait`, wait until it ends, and stop it if the task is cancelled.

        * path: path of the tool, with which its accuracy is checked, or None.
        * move: function that builds the SPEL+ statement for a controller that accepts no points.
          None: no statement can express the motion.
        * remark: see `Goal`.
        """
        driver = self.running
        sample, statement = driver.robot.sample, None
        if driver.statements is not None:
            if move is None:
                raise not_started(NO_PLANS.format(len(trajectory.times)))
            statement = move(driver.statements)
        elif sample is not None:
            trajectory = divided(trajectory, sample.positions)
        goal = replace(self.setup.goal(trajectory, statement), remark=remark)
        motion = Motion(driver.goal_queue, goal, plan, path)
        motion.start()
        if wait:
            await motion.finish()
        return motion

    def set_load(self, load: Load) -> None:
        configuration = self.setup.configuration
        if not (configuration.statements or configuration.real_time):
            raise RobotError(
                'this kind of controller accepts no payload: set Weight and Inertia in '
                'its program, or in RC+'
            )
        self._load = load
        if self.driver is not None and self.driver.set_load is not None:
            self.driver.set_load(load)

    def set_speed_scaling(self, factor: float) -> None:
        try:
            self.running.goal_queue.set_speed(factor)
        except ValueError as error:
            raise RobotError(str(error)) from error

    # --- from the driver (DriverEvents) -----------------------------------------------------

    def on_joints(self, sample: JointSample) -> None:
        self._received.notify_all()
        self.changes.recorded.call(sample)
        if self.changes.joints.registered:
            self.changes.joints.call(self.stamped(sample))

    def on_status(self, status: Status) -> None:
        self._received.notify_all()
        self.changes.update(status)

    def on_link_state(self, name: str, why: str) -> None:
        if name in ('backing_off', 'disconnected'):
            self._link_reason = why
        self._received.notify_all()
        self.changes.link.call(name, why)

    def callback_failed_elsewhere(self, error: Exception) -> None:
        if self.task is None:
            _log.error('a callback failed (there is no connection)', exc_info=error)
        else:
            self.loop.call_soon_threadsafe(self.callback_failed, error)

    def callback_failed(self, error: Exception) -> None:
        """Report an exception in a user's callback, and stop and disable the arm."""
        self.failed(f'a callback failed: {type(error).__name__}: {error}', error)

    def failed(self, why: str, error: Exception) -> None:
        """Report an unexpected exception, and stop and disable the arm."""
        report_error(why, error)
        if self.driver is not None:
            self.driver.fault(why)


def _named(links: list[Link]) -> str:
    return ' and the '.join(f'{link.name} link to port {link.port}' for link in links)


def _count(link: Link) -> int:
    return link.statistics.connections
