# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`demo --stay` and `--panel`: controller and driver go on after the demo, for a person to use."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from epson_driver.demo.cell import RunningDriver
from epson_driver.panel import INSTALL, missing
from epson_driver.processes import processes

ENVIRONMENT = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
"""What another terminal must have to find the driver."""


@contextlib.contextmanager
def panel_beside(
    folder: Path, driver: RunningDriver, console: Console, *, wanted: bool
) -> Iterator[str | None]:
    """Run the panel during the block, if wanted and installed, and yield its address.

    Raises RunError with what it said if it does not start.
    """
    if not wanted:
        yield None
        return
    if missing():
        console.print(INSTALL, highlight=False, markup=False)
        yield None
        return
    environment = processes.ros_environment(driver.domain)
    panel = processes.Process('panel', ['--port', '0'], folder / 'panel.log', environment)
    with processes.ended_at_exit(panel):
        address = panel.address()
        _say_address(address, console)
        yield address


def stay(driver: RunningDriver, panel: str | None, console: Console) -> None:
    """Say how driver and panel are reached, and return at Ctrl-C.

    `panel`: its address. Raises RunError if the driver ends.
    """
    console.print('controller and driver go on until Ctrl-C; in another terminal:')
    for name in ENVIRONMENT:
        console.print(f'export {name}={os.environ[name]}', highlight=False)
    if panel is not None:
        _say_address(panel, console)
    try:
        driver.process.wait()
        driver.process.check_alive()
    except KeyboardInterrupt:
        console.print('ended')


def _say_address(address: str, console: Console) -> None:
    console.print(f'panel: {address}', highlight=False, soft_wrap=True)
