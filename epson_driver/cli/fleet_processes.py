# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The processes of a simulated fleet: controllers, drivers, and a discovery server for them."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from epson_driver.cli import processes
from epson_driver.cli.discovery_server import VARIABLE, discovery_server, free_port
from epson_driver.cli.processes import Process

ADDRESS = '127.0.0.1'


@dataclass(frozen=True, eq=False)
class Fleet:
    """What runs. All robots have the same driver's process if they share one."""

    controllers: dict[str, Process]
    """By the robot's name, which is its namespace; so are the drivers."""
    drivers: dict[str, Process]
    server: Process | None
    environment: dict[str, str]
    """What another terminal must have to find the robots."""

    @property
    def names(self) -> tuple[str, ...]:
        """The robots, in their order."""
        return tuple(self.controllers)

    @property
    def together(self) -> bool:
        """Whether one process drives them all."""
        return len(self.drivers) > 1 and len(set(map(id, self.drivers.values()))) == 1


def robot_names(count: int) -> tuple[str, ...]:
    """Return the namespaces of so many robots."""
    return tuple(f'robot_{number}' for number in range(1, count + 1))


@contextmanager
def running_fleet(
    folder: Path, count: int, *, together: bool = False, server: bool = True
) -> Iterator[Fleet]:
    """Run a fleet in a free ROS domain of this machine; all of it ends with the block.

    `together`: one process for all drivers, not one for each; `server`: they find each other by a
    discovery server, not by asking everybody. Logs go to files in `folder`. The environment of
    this process is changed so that its own nodes are in the fleet's domain. Raises RunError if a
    controller cannot start, or there is no server.
    """
    names = robot_names(count)
    domain = processes.free_ros_domain()
    environment = {
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    with ExitStack() as stack:
        discovery = None
        if server:
            port = free_port(ADDRESS)
            discovery = discovery_server(folder / 'discovery_server.log', ADDRESS, port)
            stack.callback(discovery.end)
            environment[VARIABLE] = f'{ADDRESS}:{port}'
        else:
            os.environ.pop(VARIABLE, None)
        os.environ.update(environment)  # for the drivers, and for the nodes of this process
        started: list[Process] = []
        stack.callback(processes.end_together, started)
        controllers = {}
        for name in names:
            controllers[name] = processes.sim_controller(folder / f'controller_{name}.log')
            started.append(controllers[name])
        ports = {name: controller.ports() for name, controller in controllers.items()}
        drivers: dict[str, Process] = {}
        for group in [names] if together else [(name,) for name in names]:
            log = folder / f'client_{group[0]}.log'
            driver = processes.clients(log, {name: ports[name] for name in group}, domain)
            started.insert(0, driver)  # drivers are told first, and stop their arms
            drivers |= dict.fromkeys(group, driver)
        yield Fleet(controllers, drivers, discovery, environment)
