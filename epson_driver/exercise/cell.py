# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot cell on this machine: simulated controller, driver, operator, and observer."""

import asyncio
import contextlib
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.motion import Array
from epson_driver.processes import processes
from epson_driver.processes.command import module_command
from epson_driver.processes.processes import Ports, Process, RunError
from epson_driver.profiles import load_controller_profile
from epson_driver.remote_ethernet.client import Ask, RemoteError, execute, logged_in
from epson_driver.remote_ethernet.hand import action
from epson_driver.robots import RobotModel, load_robot_model

HOST = '127.0.0.1'
PERIOD_S = 0.02  # polling period, s: the remote port sends only replies
RETRY_S = 0.2
SESSION_S = 86_400.0
ESTOP_FLAG = 6  # index of the E-stop flag in the reply to GetStatus
MOVED = 0.002  # minimum displacement of a joint that counts as motion, rad or m
REST_S = 0.2  # time without motion after which the arm counts as at rest, s


class Observer:
    """Polls the arm's position and the E-stop at the remote port, in a thread, until `close`.

    Its observations do not depend on the driver, the program, or faults in their messages. Times
    are s on the monotonic clock.
    """

    def __init__(self, port: int, model: RobotModel, password: str = '') -> None:
        self._port = port
        self._password = password
        self._joints = len(model.joint_names)
        self._units = [float(item) for item in model.shown_per_unit]
        self._lock = threading.Lock()
        self._times: list[float] = []
        self._positions: list[tuple[float, ...]] = []
        self._stopped: list[tuple[float, bool]] = []
        self._news = threading.Condition(self._lock)
        self._closing = False
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._poll_forever()), name='observer', daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        self._closing = True
        self._thread.join()

    @property
    def seen(self) -> tuple[Array, Array]:
        """Times of the observations, shape (k,), and joint positions, shape (k, n), rad or m."""
        with self._lock:
            return np.array(self._times), np.array(self._positions).reshape(-1, self._joints)

    @property
    def stopped_at(self) -> float | None:
        with self._lock:
            return next((time for time, stopped in self._stopped if stopped), None)

    def wait_for_state(self, timeout: float) -> bool:
        with self._news:
            return bool(self._news.wait_for(lambda: self._times, timeout))

    def wait_for_motion(self, until: float, ended: threading.Event) -> float | None:
        """Return when the arm was first seen moving.

        Return None if the arm has not moved at the time `until`, or when `ended` is set.
        """
        with self._news:
            start = self._positions[-1] if self._positions else None
            while time.monotonic() < until and not ended.is_set():
                if self._positions:
                    start = start or self._positions[-1]
                    away = max(abs(a - b) for a, b in zip(self._positions[-1], start, strict=True))
                    if away > MOVED:
                        return self._times[-1]
                self._news.wait(min(0.5, max(until - time.monotonic(), 0.01)))
        return None

    def moved_after_stop(self) -> bool:
        """Return whether the arm came to rest after the E-stop, and then moved."""
        stopped = self.stopped_at
        if stopped is None:
            return False
        times, positions = self.seen
        after = times > stopped
        times, positions = times[after], positions[after]
        first = standstill(times, positions)
        if first is None:
            return False
        return bool(np.any(np.abs(positions[first:] - positions[first]).max(axis=1) > MOVED))

    async def _poll_forever(self) -> None:
        while not self._closing:
            with contextlib.suppress(RemoteError, ConnectionError, TimeoutError):
                async with logged_in(HOST, self._port, SESSION_S, self._password) as ask:
                    while not self._closing:
                        await self._poll(ask)
                        await asyncio.sleep(PERIOD_S)
            if not self._closing:
                await asyncio.sleep(RETRY_S)

    async def _poll(self, ask: Ask) -> None:
        shown = (await ask('Sim,joints')).split()
        joints = tuple(float(value) / unit for value, unit in zip(shown, self._units, strict=True))
        stopped = (await ask('GetStatus'))[ESTOP_FLAG : ESTOP_FLAG + 1] == '1'
        now = time.monotonic()
        with self._news:
            self._times.append(now)
            self._positions.append(joints)
            self._stopped.append((now, stopped))
            self._news.notify_all()


def standstill(times: Array, positions: Array) -> int | None:
    """Return the index of the first standstill of at least REST_S, or None."""
    for index in range(len(times)):
        within = (times >= times[index]) & (times <= times[index] + REST_S)
        if times[-1] < times[index] + REST_S:
            return None
        if np.all(np.abs(positions[within] - positions[index]).max(axis=1) <= MOVED / 10):
            return index
    return None


PENDANT_TIMEOUT_S = 30.0
READY_TIMEOUT_S = 120.0
TRACE = 'wire.pcap'


class SimulatedCell:
    """A running controller and its driver.

    * environment: environment variables for programs that use the cell.
    * trace: the driver's recording of the network traffic. It is complete once the cell is closed.
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
        """Perform an operator action, such as `estop press`, `motors off` or `fault cut 2`.

        Raises UsageError if `words` are unknown, RemoteError if the controller refuses the action.
        """
        command, port = action(words).commands[0], self.ports.remote
        asyncio.run(execute(HOST, port, [command], PENDANT_TIMEOUT_S, self._password))

    def fault(self, words: str) -> None:
        """Start a fault, such as `cut 2` or `lost_reply skip=4`. `clear` ends all faults."""
        self.pendant(f'fault {words}')

    def enable(self) -> None:
        """Enable the arm as an operator would.

        Raises RunError, with the reason, if the arm cannot be enabled.
        """
        words = ('/epson_driver/enable', f'{READY_TIMEOUT_S:g}')
        process = subprocess.run(  # noqa: S603 - our own
            module_command('epson_driver.exercise.call_trigger', *words),
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if process.returncode:
            last = (process.stderr.strip().splitlines() or ['no output'])[-1]
            raise RunError(f'~/enable: {last}')

    @property
    def positions(self) -> Array:
        """The joint positions reported by the controller: shape (n,), rad or m.

        Raises RunError before the first report.
        """
        _, positions = self.observer.seen
        if not len(positions):
            raise RunError('no joint positions received yet')
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
    """Run a cell on free ports and in an unused ROS domain, with logs and trace in `folder`.

    `arguments`: further arguments of sim_controller. `parameters`: the driver's parameters, with
    `__` for a dot. Raises RunError if a process does not start, with the reason.
    """
    model = load_robot_model(robot)
    words = [f'--robot={robot}', f'--controller={controller}', *arguments]
    sim = processes.sim_controller(folder / 'sim_controller.log', *words)
    started: list[Process] = [sim]
    cell: SimulatedCell | None = None
    try:
        ports = sim.ports()
        domain = processes.free_ros_domain()
        settings: dict[str, Any] = {
            'joint_names': f'[{",".join(model.joint_names)}]',
            'robot_model': robot,
            'controller': controller,
            'require_planned_speed': False,  # simulated: faults are the subject, not speeds
            'trace_folder': str(folder),
            'trace_file': TRACE,
        }
        driver = processes.client(
            folder / 'client.log', ports, domain, **settings | dict(parameters or {})
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
