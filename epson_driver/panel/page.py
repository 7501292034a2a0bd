# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel of one connected Python Robot, in threads of the same process."""

import asyncio
import contextlib
import threading
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from epson_driver.api.connection import Connection
from epson_driver.api.errors import RobotError
from epson_driver.api.points import Points
from epson_driver.inputs import InputError
from epson_driver.motion import Trajectory
from epson_driver.panel.access import new_token
from epson_driver.panel.api_robot import ApiRobot
from epson_driver.panel.panel import Panel
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory


class Page:
    """A panel that runs until `close` or a failure. Only the connection's event loop uses it.

    * url: the address to open.
    * ended: event that is set when the panel has ended. `code` is then the exit code.
    """

    def __init__(self, connection: Connection, panel: Panel) -> None:
        self.url = panel.url
        self.ended = asyncio.Event()
        self.code = 0
        self._panel = panel
        self._connection = connection
        connection.page = self
        threading.Thread(target=self._run, name='panel', daemon=True).start()

    def _run(self) -> None:
        self.code = self._panel.run()
        with contextlib.suppress(RuntimeError):  # the loop was closed
            self._connection.loop.call_soon_threadsafe(self._end)

    def _end(self) -> None:
        self.ended.set()
        if self._connection.page is self:
            self._connection.page = None

    async def close(self) -> None:
        """End the panel, and cancel its goals."""
        self._panel.stop()
        await self.ended.wait()


async def show(
    connection: Connection,
    points: Points,
    host: str,
    port: int,
    files: Sequence[Path] = (),
    *,
    allow_motion: bool,
) -> Page:
    """Open the page of a connected robot.

    `files` are trajectories (default: the trajectories of this package). Raises RobotError if the
    address is in use, or if a file is invalid.
    """
    driver, thread = connection.running, threading.get_ident()

    def make() -> Panel:
        robot = partial(ApiRobot, connection, driver, points, thread)
        token, paths = new_token(host), trajectories(files)
        return Panel(host, port, token, robot, paths, allow_motion=allow_motion)

    try:
        panel = await asyncio.to_thread(make)  # imports and files would delay the driver
    except (RuntimeError, InputError, OSError) as error:
        raise RobotError(str(error)) from error
    if connection.driver is not driver or connection.page is not None:
        panel.close()
        raise RobotError('the robot was closed, or shown, at the same time')
    return Page(connection, panel)


def trajectories(files: Sequence[Path]) -> Mapping[str, Trajectory]:
    """Return the trajectories in files by name.

    Without files, return the trajectories of this package.
    """
    paths = files or sorted(share_path('config', 'trajectories').glob('*.yaml'))
    return {path.stem: read_trajectory(path) for path in paths}
