# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot cell on this machine: simulated controller, driver, and a person at the pendant."""

import asyncio
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.exercise.observer import Observer
from epson_driver.motion import Array
from epson_driver.processes import processes
from epson_driver.processes.command import module_command
from epson_driver.processes.processes import Ports, Process, RunError
from epson_driver.profiles import load_controller_profile
from epson_driver.remote_ethernet.client import execute
from epson_driver.remote_ethernet.hand import action
from epson_driver.robots import RobotModel, load_robot_model

PENDANT_TIMEOUT_S = 30.0
READY_TIMEOUT_S = 120.0
TRACE = 'wire.pcap'


class SimulatedCell:
    """A running controller and its driver. `environment`: for programs that use them.

    `trace`: the driver's recording of the wire, complete once the cell is closed.
    """

    def __init__(
        self, ports: Ports, domain: int, folder: Path, model: RobotModel, password: str
    ) -> None:
        self.ports = ports
        self.domain = domain
        self.folder = folder
        self.trace = folder / TRACE
        self.environment = processes.ros_environment(domain)
        self.observer = Observer(ports.remote, model, password)
        self._password = password

    def pendant(self, words: str) -> None:
        """Do a person's action at the controller: `estop press`, `motors off`, `fault cut 2`.

        Raises UsageError for unknown words, RemoteError if the controller refuses.
        """
        command = action(words).commands[0]
        port, limit = self.ports.remote, PENDANT_TIMEOUT_S
        asyncio.run(execute('127.0.0.1', port, [command], limit, self._password))

    def fault(self, words: str) -> None:
        """Start a fault, such as `cut 2` or `lost_reply skip=4`, or end all with `clear`."""
        self.pendant(f'fault {words}')

    def enable(self) -> None:
        """Enable the arm on a person's behalf. Raises RunError if that fails, with the reason."""
        words = ('/epson_driver/enable', f'{READY_TIMEOUT_S:g}')
        asked = subprocess.run(  # noqa: S603 - our own
            module_command('epson_driver.exercise.call_trigger', *words),
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if asked.returncode:
            last = (asked.stderr.strip().splitlines() or ['nothing was said'])[-1]
            raise RunError(f'~/enable: {last}')

    @property
    def positions(self) -> Array:
        """The joint positions reported by the controller: shape (n,), rad or m.

        Raises RunError before the first report.
        """
        _, positions = self.observer.seen
        if not len(positions):
            raise RunError('the controller has not said yet where the joints are')
        return np.asarray(positions[-1])


@contextmanager
def simulated_cell(
    folder: Path,
    *,
    robot: str = 'c3_a601s',
    controller: str = 'simulated',
    arguments: Sequence[str] = (),
    parameters: Mapping[str, Any] | None = None,
    enabled: bool = True,
) -> Iterator[SimulatedCell]:
    """Run a cell on free ports and in a free ROS domain, with logs and trace in a folder.

    `arguments`: further arguments of sim_controller. `parameters`: the driver's parameters, with
    `__` for a dot. Raises RunError if a process does not start, with the reason.
    """
    model = load_robot_model(robot)
    log = folder / 'sim_controller.log'
    words = [f'--robot={robot}', f'--controller={controller}', *arguments]
    sim = processes.sim_controller(log, *words)
    started: list[Process] = [sim]
    cell: SimulatedCell | None = None
    try:
        ports = sim.ports()
        domain = processes.free_ros_domain()
        given: dict[str, Any] = {
            'joint_names': f'[{",".join(model.joint_names)}]',
            'robot_model': robot,
            'controller': controller,
            'require_planned_speed': False,  # simulated: faults are the subject, not speeds
            'trace_folder': str(folder),
            'trace_file': TRACE,
        }
        driver = processes.client(
            folder / 'client.log', ports, domain, **given | dict(parameters or {})
        )
        started.append(driver)
        password = load_controller_profile(controller).remote.password
        cell = SimulatedCell(ports, domain, folder, model, password)
        if not cell.observer.wait_for_state(READY_TIMEOUT_S):
            raise RunError(f'no answer at the remote port within {READY_TIMEOUT_S:g} s')
        if enabled:
            cell.enable()
        driver.check_alive()
        yield cell
    finally:
        if cell is not None:
            cell.observer.close()
        for process in reversed(started):  # the driver first: it writes its trace to the end
            process.end()
