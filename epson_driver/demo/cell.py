# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The demo's robot cell: a simulated controller, its driver, and a ROS node that uses both.

Controller and driver are separate processes, as in a real cell.
"""

import asyncio
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from epson_driver.demo.ros_client import RosClient
from epson_driver.panel import INSTALL, missing
from epson_driver.processes import processes
from epson_driver.processes.processes import Ports, Process
from epson_driver.remote_ethernet.answers import identity
from epson_driver.remote_ethernet.client import logged_in

TIMEOUT_S = 5.0


class RunningDriver(NamedTuple):
    user: RosClient
    process: Process
    domain: int


@contextmanager
def running_driver(
    folder: Path,
    ports: Ports,
    joint_names: Sequence[str],
    console: Console,
    **parameters: str,
) -> Iterator[RunningDriver]:
    """Run the driver for a controller in a free ROS domain, and yield it once it is enabled.

    `parameters`: ROS parameters of the driver, with `__` for a dot. Raises RunError if the driver
    ends or cannot be enabled.
    """
    domain = processes.free_ros_domain()
    parameters['joint_names'] = f'[{",".join(joint_names)}]'
    client = processes.client(folder / 'client.log', ports, domain, **parameters)
    with processes.ended_at_exit(client):
        console.print(
            f'sim_controller: {_identity(ports.remote)} (remote), :{ports.motion} (motion), '
            f':{ports.state} (state); client in ROS domain {domain}',
            highlight=False,
            soft_wrap=True,
        )
        os.environ.update(processes.ros_environment(domain))  # for the node in this process
        user = RosClient(tuple(joint_names), client.check_alive)
        try:
            user.enable()
            yield RunningDriver(user, client, domain)
        finally:
            user.close()


def _identity(remote_port: int) -> str:
    async def asked() -> str:
        async with logged_in('127.0.0.1', remote_port, TIMEOUT_S) as ask:
            return await identity(ask, f'127.0.0.1:{remote_port}')

    return asyncio.run(asked())


ENVIRONMENT = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')  # for another terminal


@contextmanager
def panel_beside(
    folder: Path, driver: RunningDriver, console: Console, *, enabled: bool
) -> Iterator[str | None]:
    """Run the panel during the block, if it is enabled and installed. Yield its address.

    The address is None without a panel.
    """
    if not enabled:
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
    """Print how to reach the driver and the panel, and wait for Ctrl-C."""
    console.print('controller and driver keep running until Ctrl-C. In another terminal:')
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
