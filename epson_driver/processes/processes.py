# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Starts the executables as processes, on free ports and in an unused ROS domain."""

import atexit
import contextlib
import dataclasses
import json
import os
import random
import signal
import socket
import subprocess
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from epson_driver.processes.command import module_command
from epson_driver.processes.interrupt import interrupts_held

SAFE_DOMAINS = range(1, 102)  # ports below the ephemeral range of every common system
MAX_CLAIMS = 5
"""Maximum number of domains that this process claims at the same time. A claim prevents other
processes, such as a second test run, from choosing the domain before its participants have
started."""

claims: deque[socket.socket] = deque()  # the oldest first

END_TIMEOUT_S = 5.0
TELLING = ('panel', 'sim_controller')  # they print address or ports on stdout once ready
EXECUTABLE = tuple(module_command('epson_driver.cli'))  # to be followed by a name and arguments


class RunError(RuntimeError):
    """A process failed to start, or ended. The text of the error is the reason."""


@dataclass(frozen=True)
class Ports:
    """Ports of a simulated controller, as printed in its `listening` line."""

    motion: int
    state: int
    io: int
    remote: int


def free_ros_domain() -> int:
    """Return a ROS_DOMAIN_ID that is unused on this machine, and claim it for a while.

    The UDP ports of a domain start at 7400 + 250 · domain (DDSI-RTPS 9.6.1). The first participant
    uses the eleventh port. To claim the domain, this process binds a port that DDS leaves unused.
    The claim lasts until this process ends, or has chosen MAX_CLAIMS other domains.
    """
    for domain in random.sample(SAFE_DOMAINS, len(SAFE_DOMAINS)):
        first = _first_port(domain)
        try:
            claim = _bound('127.0.0.1', first + 5)
        except OSError:
            continue
        try:
            _bound('', first + 10).close()  # at all addresses, as DDS does
        except OSError:
            claim.close()
            continue
        claims.append(claim)
        if len(claims) > MAX_CLAIMS:
            claims.popleft().close()
        return domain
    raise RunError('every ROS domain from 1 to 101 is in use on this machine')


def port_beside(domain: int) -> int:
    """Return a claimed domain's UDP port that is free for a server, because DDS never uses it."""
    return _first_port(domain) + 6


def _first_port(domain: int) -> int:
    return 7400 + 250 * domain


def _bound(address: str, port: int) -> socket.socket:
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        probe.bind((address, port))
    except OSError:
        probe.close()
        raise
    return probe


def ros_environment(domain: int) -> dict[str, str]:
    """Return the environment for processes restricted to this machine and to one ROS domain."""
    return os.environ | {
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'PYTHONUNBUFFERED': '1',
    }


class Process:
    """A running executable. Its stderr is written to the log, and its stdout, unless piped.

    It ends with this process at the latest, also after an interrupt while it was started.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        log: Path,
        environment: dict[str, str],
        run: Sequence[str] = EXECUTABLE,
    ) -> None:
        self.name = name
        self.log = log
        with log.open('ab') as file, interrupts_held():
            self._popen = subprocess.Popen(  # noqa: S603 - our own executable
                [*run, name, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if name in TELLING else file,
                stderr=file,
                env=environment,
            )
            atexit.register(self.end)
        self.process_id = self._popen.pid

    @property
    def returncode(self) -> int | None:
        return self._popen.poll()

    def wait(self, timeout: float | None = None) -> int:
        return self._popen.wait(timeout)

    def send(self, number: int) -> None:
        self._popen.send_signal(number)

    def kill(self) -> None:
        self._popen.kill()
        self._popen.wait()

    def end(self, number: int = signal.SIGINT) -> int:
        """End the process like Ctrl-C, or with SIGKILL after 5 s, and return its exit code."""
        if self._popen.poll() is None:
            self._popen.send_signal(number)
        return self.ended()

    def ended(self) -> int:
        """Wait until the process ends, and return its exit code. After 5 s, send SIGKILL."""
        try:
            return self._popen.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()
            return -signal.SIGKILL
        finally:
            atexit.unregister(self.end)
            if self._popen.stdout is not None:
                self._popen.stdout.close()

    def ports(self) -> Ports:
        """Wait for the ports of a sim_controller. If it ends, raise RunError with its log."""
        words = dict(word.split('=') for word in self._reported('listening'))
        return Ports(**{key: int(value) for key, value in words.items()})

    def address(self) -> str:
        """Wait for the URL of a panel. If it ends, raise RunError with its log."""
        return self._reported('panel')[0]

    def _reported(self, first: str) -> list[str]:
        """Wait for the process's first line. Return its words after the word `first`."""
        assert self._popen.stdout is not None  # noqa: S101 - true for the names in TELLING
        line = self._popen.stdout.readline().decode()
        if not line.startswith(f'{first} '):
            self._popen.wait()
            raise RunError(f'{self.name} did not start:\n{line}{self.log_text()}')
        return line.split()[1:]

    def check_alive(self) -> None:
        if self.returncode is not None:
            raise RunError(f'{self.name} ended with {self.returncode}:\n{self.log_text()}')

    def log_text(self) -> str:
        return self.log.read_text(encoding='utf-8', errors='replace')


def sim_controller(
    log: Path,
    *arguments: str,
    start: Sequence[float] | None = None,
    ports: Ports | None = None,
    environment: dict[str, str] | None = None,
) -> Process:
    """Start a simulated controller, by default on free ports.

    `start`: initial joint positions, rad or m.
    """
    chosen = ports or Ports(0, 0, 0, 0)
    numbers = [
        word
        for name in ('motion', 'state', 'io', 'remote')
        for word in (f'--{name}-port', str(getattr(chosen, name)))
    ]
    numbers += ['--rtmc-port', '0']
    if start is not None:
        numbers.append('--start=' + ','.join(f'{position:.9g}' for position in start))
    return Process('sim_controller', [*numbers, *arguments], log, environment or dict(os.environ))


def client(
    log: Path,
    ports: Ports,
    domain: int,
    *,
    run: Sequence[str] = EXECUTABLE,
    **parameters: object,
) -> Process:
    """Start the ROS 2 node for these ports. `__` in the name of a parameter stands for a dot."""
    values = {
        'motion_port': ports.motion,
        'state_port': ports.state,
        'io_port': ports.io,
        'remote_port': ports.remote,
    } | {name.replace('__', '.'): value for name, value in parameters.items()}
    arguments = ['--ros-args']
    for name, value in values.items():
        arguments += ['-p', f'{name}:={value}']
    return Process('client', arguments, log, ros_environment(domain), run)


def clients(
    log: Path,
    robots: Mapping[str, Ports],
    domain: int,
    *,
    run: Sequence[str] = EXECUTABLE,
    **parameters: object,
) -> Process:
    """Start one process that drives several controllers, each in its namespace.

    Writes a parameter file next to the log. `parameters` apply to all nodes.
    """
    common = {name.replace('__', '.'): value for name, value in parameters.items()}
    file = log.with_suffix('.yaml')
    content: dict[str, object] = {
        f'/{name}/epson_driver': {
            'ros__parameters': common
            | {f'{port}_port': number for port, number in dataclasses.asdict(ports).items()}
        }
        for name, ports in robots.items()
    }
    file.write_text(json.dumps(content), encoding='utf-8')  # JSON is valid YAML
    arguments = [word for name in robots for word in ('--namespace', name)]
    arguments += ['--ros-args', '--params-file', str(file)]
    return Process('client', arguments, log, ros_environment(domain), run)


def end_together(started: Sequence[Process], number: int = signal.SIGINT) -> None:
    """End processes like Ctrl-C does: signal all of them in this order, then wait for each."""
    for process in started:
        if process.returncode is None:
            process.send(number)
    for process in started:
        process.ended()


@contextlib.contextmanager
def ended_at_exit(*processes: Process) -> Iterator[None]:
    try:
        yield
    finally:
        for process in processes:
            process.end()
