# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Python API for asyncio. It needs no ROS, and contains the same driver as the ROS 2 node.

    async with Robot('192.168.0.1', controller='spel', model='c4_a601s') as robot:
        await robot.enable()
        await robot.move_joints([0.0, 0.3, -0.2, 0.0, 0.5, 0.0], speed=0.2)

A Robot works only in the event loop in which `connect` was called. Angles are in rad, lengths in
m, times in s. docs/python.md describes the API. epson_driver.robot has the same API without
asyncio.
"""

import asyncio
import weakref
from collections.abc import Callable, Coroutine, Sequence
from types import TracebackType
from typing import Any, Literal, Self

from epson_driver.api import moves
from epson_driver.api.errors import (
    TIMEOUT,
    ArgumentError,
    MotionError,
    PathError,
    RobotError,
    checked_arguments,
)
from epson_driver.api.io import Gripper, GripperState, GripperWiring, Io
from epson_driver.api.motion import Motion
from epson_driver.api.motions import Motions
from epson_driver.api.ownership import Page
from epson_driver.api.points import Points
from epson_driver.api.poses import Waypoint
from epson_driver.api.recording import Recording
from epson_driver.api.settings import Settings, checked_argument, parameter_values
from epson_driver.api.simulation import SimulatedController, Simulation
from epson_driver.api.status import ControllerError, RobotStatus, Sample
from epson_driver.api.streams import Streams
from epson_driver.inputs import HOST, count
from epson_driver.taught_points import EpsonPoint, Pallet, Posture, TaughtPoints

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

FREE_PORT = count(0, 65_535)

READY_TIMEOUT_S = 10.0
"""Default timeout of `connect`, s."""


class Robot(Motions, Streams):
    """An arm and its controller. `async with Robot(…) as robot:` connects and closes it.

    * host: the address of the controller, or a robot.yaml written by `epson_driver connect`, which
      contains the address, the profile and the model.
    * controller, model: names from config/controllers and config/robots (default: simulated and
      c3_a601s), or paths of files.
    * motion_port, …: TCP ports. The defaults come from the controller's profile. 0 disables
      `io_port` or `remote_port`.
    * enable: whether `connect` also enables the arm.

    Raises ArgumentError if an argument or a file is invalid.
    """

    @checked_arguments
    def __init__(
        self,
        host: str = '127.0.0.1',
        *,
        controller: str | None = None,
        model: str | None = None,
        motion_port: int | None = None,
        state_port: int | None = None,
        io_port: int | None = None,
        remote_port: int | None = None,
        settings: Settings | None = None,
        enable: bool = False,
    ) -> None:
        from epson_driver.setup.setup import make_setup

        values = parameter_values(
            Settings() if settings is None else settings,
            host,
            controller,
            model,
            motion_port=motion_port,
            state_port=state_port,
            io_port=io_port,
            remote_port=remote_port,
        )
        super().__init__(make_setup(values))
        self._enable = enable
        connection = self._connection  # a reference to self would delay garbage collection
        self.io = Io(lambda: connection.running.io)
        """Inputs and outputs of the controller."""
        self.gripper = Gripper(lambda: connection.gripper)
        """The gripper described by `Settings.gripper`."""
        taught = weakref.WeakMethod(self._taught)
        self.points = Points(lambda: _of(taught), connection.measured)
        """Taught points by name."""
        self.simulation = Simulation(lambda: connection.simulated)
        """Operator actions on a simulated controller."""

    @classmethod
    @checked_arguments
    def simulated(
        cls,
        *,
        controller: str = 'simulated',
        model: str = 'c3_a601s',
        start: Sequence[float] | None = None,
        motion: Literal['smooth', 'ptp'] | None = None,
        settings: Settings | None = None,
        enable: bool = False,
    ) -> Self:
        """Return a robot that starts its simulated controller when it connects.

        * start: initial joint positions, rad (m).
        * motion: 'smooth' (default): the arm moves through all points without a stop. 'ptp': it
          stops at each point. Omit this if the controller runs a SPEL+ program, which determines
          it.
        * enable: whether `connect` also enables the arm.
        """
        for name, value in (('controller', controller), ('model', model)):
            checked_argument(name, value)
        robot = cls(controller=controller, model=model, settings=settings, enable=enable)
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

    @checked_arguments
    async def connect(self, timeout: float = READY_TIMEOUT_S) -> Self:
        """Connect, and wait until the controller has reported its state and the joint positions.

        The arm stays disabled, unless the Robot was created with `enable=True`. Then `connect`
        also enables the arm, and closes the connection if that fails. Raises RobotError if the
        robot is not ready within `timeout` s. The error's text lists what is missing.
        """
        lost = weakref.finalize(self, self._connection.lost)
        lost.atexit = False
        await self._connection.connect(TIMEOUT.checked(timeout, 'timeout'))
        if self._enable:
            try:
                await self.enable()
            except BaseException:
                await self.close()
                raise
        return self

    async def close(self) -> None:
        """Stop the arm, disable it, and disconnect. Do nothing if not connected."""
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

    # --- commands ---------------------------------------------------------------------------

    async def enable(self) -> str:
        """Allow motions, and switch the motors on if the controller supports it."""
        return await self._connection.command(lambda commands: commands.enable())

    async def disable(self) -> str:
        """Stop the arm, block motions, and switch the motors off if the controller supports it."""
        return await self._connection.command(lambda commands: commands.disable())

    @checked_arguments
    async def reset(self, *, enable: bool = False) -> str:
        """Reset the controller after an error or a released E-stop.

        enable: whether to enable the arm after the reset. If False, a disabled arm stays disabled.
        If True, RobotError is raised if `disable` is called during the reset.
        """
        return await self._connection.command(
            lambda commands: commands.recover() if enable else commands.reset_error()
        )

    async def stop(self) -> str:
        """Stop the arm and abort its motion. Return a message when the arm is at rest."""
        return await self._connection.command(lambda commands: commands.stop())

    async def wait_for_input(
        self, index: int, value: int = 1, *, kind: str = 'DI', timeout: float | None = None
    ) -> None:
        """Wait until an input has a value.

        kind: type of I/O point (docs/io.md), by default a digital input. Raises TimeoutError after
        `timeout` s, and the exceptions of `io.read`.
        """
        await self.io.wait(kind, index, value, timeout)

    @checked_arguments
    async def show(
        self, *, host: str = '127.0.0.1', port: int = 0, allow_motion: bool = False
    ) -> str:
        """Show the robot in a browser, and return the address of the page (docs/panel.md).

        * host, port: the address to listen on. 0: any free port. If other machines can reach the
          host, the address of the page contains a token.
        * allow_motion: whether the page may move a robot that is not simulated.

        The page ends with the connection. Until then, further calls return the same address.
        Raises RobotError if not connected, if the address is in use, or without the package
        websockets.
        """
        from epson_driver.panel import INSTALL, missing

        HOST.checked(host, 'host')
        FREE_PORT.checked(port, 'port')
        if missing():
            raise RobotError(INSTALL)
        connection = self._connection
        page = connection.page
        if page is None:
            show = await asyncio.to_thread(_load_panel)  # importing it would delay the driver
            page = await show(connection, self.points, host, port, allow_motion=allow_motion)
        return page.url

    # --- callbacks --------------------------------------------------------------------------

    @checked_arguments
    def on_estop(self, callback: Callable[[bool], object]) -> Callable[[], None]:
        """Register a callback for the E-stop: pressed (True) or reset (False).

        Returns a function that unregisters the callback. When the callback runs, the arm is
        already disabled. Callbacks of Robot run one after the other in a separate thread,
        and may use the robot. Callbacks of aio.Robot run in the event loop, and must return
        immediately. If a callback raises an exception, this is logged, and the arm is stopped and
        disabled.
        """
        return self._connection.changes.estop.add(callback)

    @checked_arguments
    def on_joints(self, callback: Callable[[Sample], object]) -> Callable[[], None]:
        """Register a callback for each joint sample, up to 200 per second. See `on_estop`.

        If the callbacks of Robot are so slow that 1000 calls are waiting, the arm is stopped.
        """
        return self._connection.changes.joints.add(callback)

    @checked_arguments
    def on_error(self, callback: Callable[[ControllerError | None], object]) -> Callable[[], None]:
        """Register a callback for controller errors. See `on_estop`.

        The callback's argument is the new error, or None when the error is cleared.
        """
        return self._connection.changes.error.add(callback)

    @checked_arguments
    def on_link(self, callback: Callable[[str, str], object]) -> Callable[[], None]:
        """Register a callback for the link state and the reason of its change. See `on_estop`.

        The states are disconnected, connecting, connected, and backing_off (waiting for the next
        attempt). If the motion link and the state link differ, the callback gets the worse state.
        """
        return self._connection.changes.link.add(callback)


def _load_panel() -> Callable[..., Coroutine[Any, Any, Page]]:
    from epson_driver.panel.page import show

    return show


def _of(
    taught: weakref.WeakMethod[Callable[[], tuple[EpsonPoint, Posture | str]]],
) -> tuple[EpsonPoint, Posture | str]:
    """Call a weakly referenced method of a Robot.

    Raises RobotError if the Robot no longer exists.
    """
    method = taught()
    if method is None:
        raise RobotError('the robot of these points no longer exists')
    return method()
