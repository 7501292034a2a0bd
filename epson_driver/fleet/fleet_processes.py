# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The processes of a simulated fleet: controllers, drivers, and a discovery server for them."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from epson_driver.processes import processes
from epson_driver.processes.interrupt import ending_signals, interrupts_held
from epson_driver.processes.processes import Process, RunError

PROGRAM = 'fast-discovery-server'
VARIABLE = 'ROS_DISCOVERY_SERVER'
"""Whoever has it in its environment, HOST:PORT, asks that server who is there."""

USUAL_PORT = 11811


def program() -> str:
    """Return the path of the program. Raises RunError that says where it comes from."""
    beside = Path(sys.executable).with_name(PROGRAM)  # in an environment made by pip
    found = str(beside) if beside.is_file() else shutil.which(PROGRAM)
    if found is None:
        raise RunError(
            f'no {PROGRAM}: it comes with Fast DDS (source a ROS 2 workspace; apt install '
            'ros-jazzy-fastrtps)'
        )
    return found


def discovery_server(
    log: Path, address: str, port: int = USUAL_PORT, *, run: Sequence[str] = ()
) -> Process:
    """Start a server on an address of this machine, with the words `run` before the command.

    Nobody has to wait for it: who asks it asks again. It uses no shared memory: what killed
    processes leave in /dev/shm, at the ports that all servers and their clients share, can keep
    its answers from them. Raises RunError if there is no such program.
    """
    arguments = ['-i', '0', '-l', address, '-p', str(port)]
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    environment['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    return Process(program(), arguments, log, environment, run)


ADDRESS = '127.0.0.1'


@dataclass(frozen=True, eq=False)
class Fleet:
    """The running fleet. All robots have the same driver process if they share one."""

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
    """Return the namespaces of `count` robots."""
    return tuple(f'robot_{number}' for number in range(1, count + 1))


@contextmanager
def running_fleet(
    folder: Path, count: int, *, together: bool = False, server: bool = True
) -> Iterator[Fleet]:
    """Run a fleet in a free ROS domain of this machine until the block ends.

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
    running: list[Process] = []

    def start(make: Callable[[], Process]) -> Process:
        with interrupts_held(ending_signals()):
            running.insert(0, make())  # the last are told first: drivers stop their arms
        return running[0]

    try:
        discovery = None
        os.environ.pop(VARIABLE, None)
        if server:
            port = processes.port_beside(domain)
            log = folder / 'discovery_server.log'
            discovery = start(partial(discovery_server, log, ADDRESS, port))
            environment[VARIABLE] = f'{ADDRESS}:{port}'
        os.environ.update(environment)  # for the drivers, and for the nodes of this process
        controllers = {
            name: start(partial(processes.sim_controller, folder / f'controller_{name}.log'))
            for name in names
        }
        ports = {name: controller.ports() for name, controller in controllers.items()}
        drivers: dict[str, Process] = {}
        for group in [names] if together else [(name,) for name in names]:
            own, log = {name: ports[name] for name in group}, folder / f'client_{group[0]}.log'
            drivers |= dict.fromkeys(group, start(partial(processes.clients, log, own, domain)))
        yield Fleet(controllers, drivers, discovery, environment)
    finally:
        processes.end_together(running)
