# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm from asyncio, without ROS: the driver's own checks, arm gate and sentences.

    async with Robot('192.168.0.1', controller='rc700a', model='c4_a601s') as robot:
        await robot.enable()
        await robot.move_joints([0.0, 0.3, -0.2, 0.0, 0.5, 0.0], speed=0.2)

Everything runs in the event loop that connects; angles are rad, lengths m, times s. docs/python.md
explains it; epson_driver.robot has the same without asyncio.
"""

import weakref
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Literal, Self

from epson_driver.api import moves
from epson_driver.api.arguments import checked_arguments
from epson_driver.api.errors import (
    TIMEOUT,
    ArgumentError,
    MotionError,
    PathError,
    RobotError,
)
from epson_driver.api.io import Gripper, GripperState, GripperWiring, Io
from epson_driver.api.motion import Motion
from epson_driver.api.motions import Motions
from epson_driver.api.points import Points
from epson_driver.api.poses import Waypoint
from epson_driver.api.recording import Recording
from epson_driver.api.settings import Settings, given_values
from epson_driver.api.simulation import SimulatedController, Simulation
from epson_driver.api.status import ControllerError, RobotStatus, Sample
from epson_driver.api.streams import Streams
from epson_driver.taught_points import EpsonPoint, Posture

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


class Robot(Motions, Streams):
    """One arm. `connect` first, or use it as a context manager, which stops the arm at its end.

    controller, model: names of config/controllers and config/robots, or paths to files. Ports:
    the profile's unless given; an I/O or remote port of 0 is not used. enable: `connect` enables
    the arm. Raises ValueError and FileNotFoundError for what cannot be.
    """

    @checked_arguments
    def __init__(
        self,
        host: str = '127.0.0.1',
        *,
        controller: str = 'simulated',
        model: str = 'c3_a601s',
        motion_port: int | None = None,
        state_port: int | None = None,
        io_port: int | None = None,
        remote_port: int | None = None,
        settings: Settings | None = None,
        enable: bool = False,
    ) -> None:
        from epson_driver.setup.setup import make_setup

        given = given_values(
            Settings() if settings is None else settings,
            host,
            controller,
            model,
            motion_port=motion_port,
            state_port=state_port,
            io_port=io_port,
            remote_port=remote_port,
        )
        super().__init__(make_setup(given))
        self._enable = enable
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
        """Return a robot that starts a simulated controller of its own when it connects.

        start: its first joint positions, rad (m). motion: through all points without a stop
        ('smooth', the default), or with a rest at each ('ptp'); a SPEL+ program moves as its
        statements say. enable: `connect` enables the arm.
        """
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
        """Connect, and wait until the controller has told its state and where the arm is.

        Raises RobotError that says what is missing after `timeout` s. The arm stays disabled,
        unless the Robot was made with `enable=True`: it is enabled then, or nothing is connected.
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

    # --- commands ---------------------------------------------------------------------------

    async def enable(self) -> str:
        """Switch the motors on where that can be done from here, and allow motions."""
        return await self._connection.command(lambda commands: commands.enable())

    async def disable(self) -> str:
        """Stop the arm, allow no more motions, and switch the motors off where that can be."""
        return await self._connection.command(lambda commands: commands.disable())

    @checked_arguments
    async def reset(self, *, enable: bool = False) -> str:
        """Reset the controller's error, also after an E-stop.

        enable: `enable` the arm after it, unless it is disabled meanwhile; else it stays disabled.
        """
        return await self._connection.command(
            lambda commands: commands.recover() if enable else commands.reset_error()
        )

    async def stop(self) -> str:
        """Stop the arm and abort its motion, and return a sentence when it stands."""
        return await self._connection.command(lambda commands: commands.stop())

    async def wait_for_input(
        self, index: int, value: int = 1, *, kind: str = 'DI', timeout: float | None = None
    ) -> None:
        """Wait until a point, an input unless `kind` says otherwise, has a value.

        Raises TimeoutError after `timeout` s, otherwise as `io.read`.
        """
        await self.io.wait(kind, index, value, timeout)

    # --- callbacks --------------------------------------------------------------------------

    @checked_arguments
    def on_estop(self, callback: Callable[[bool], object]) -> Callable[[], None]:
        """Have it called when the E-stop is pressed (True) or reset (False).

        The arm is disabled by then. Callbacks of Robot run one after the other in a thread of
        their own and may use the robot; those of aio.Robot run in the event loop and must return
        at once. One that raises is reported, and the arm is stopped. Returns what takes the
        callback away again.
        """
        return self._connection.changes.estop.add(callback)

    @checked_arguments
    def on_joints(self, callback: Callable[[Sample], object]) -> Callable[[], None]:
        """Have it called with each sample, up to 200 times a second. As on_estop.

        One that is slower than that, and falls 1000 behind, stops the arm.
        """
        return self._connection.changes.joints.add(callback)

    @checked_arguments
    def on_error(self, callback: Callable[[ControllerError | None], object]) -> Callable[[], None]:
        """Have it called when the controller has another error, or none any more. As on_estop."""
        return self._connection.changes.error.add(callback)

    @checked_arguments
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
