# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Start the executables as processes on free ports and in a ROS domain that nobody uses."""

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

SAFE_DOMAINS = range(1, 102)
"""ROS domains whose ports lie below the ephemeral range of every common system."""

MAX_CLAIMS = 5
"""How many of the chosen domains stay claimed; the oldest claim is dropped first.

Who chose a domain soon has participants in it. Each further claim takes a domain from others: two
runs of the tests at once have eight processes that choose."""

claims: deque[socket.socket] = deque()
"""Sockets that keep other processes from choosing the same domains, the oldest first."""

END_TIMEOUT_S = 5.0

TELLING = ('panel', 'sim_controller')
"""Executables that print where they are reached, once they are."""

EXECUTABLE = tuple(module_command('epson_driver.cli'))
"""The command that runs an executable of this package; its name and arguments follow."""


class RunError(RuntimeError):
    """The run cannot go on, with the reason as its text."""


@dataclass(frozen=True)
class Ports:
    """Where a simulated controller listens, as its `listening` line says."""

    motion: int
    state: int
    io: int
    remote: int


def free_ros_domain() -> int:
    """Return a ROS_DOMAIN_ID that nobody on this machine uses now, and claim it for a while.

    Each domain has UDP ports of its own, 250 apart from 7400 on (DDSI-RTPS 9.6.1); the first
    participant takes 7410. Until it does, another process could find the domain free, so a port
    that DDS leaves unused says that the domain is taken: until this process ends, or has chosen
    MAX_CLAIMS others.
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
    """Return a UDP port for a program that serves a domain: nobody else's while it is claimed.

    It is one of the domain's that DDS leaves unused, below those that the system hands out.
    """
    return _first_port(domain) + 6


def _first_port(domain: int) -> int:
    return 7400 + 250 * domain


def _bound(address: str, port: int) -> socket.socket:
    """Return a UDP socket. Raises OSError if the port is taken."""
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        probe.bind((address, port))
    except OSError:
        probe.close()
        raise
    return probe


def ros_environment(domain: int) -> dict[str, str]:
    """Return the environment for processes that keep to this machine and to one ROS domain."""
    return os.environ | {
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'PYTHONUNBUFFERED': '1',
    }


class Process:
    """One executable of this package, running. Its stderr (and stdout) go to a log file."""

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
        with log.open('ab') as file:
            self._popen = subprocess.Popen(  # noqa: S603 - our own executable
                [*run, name, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if name in TELLING else file,
                stderr=file,
                env=environment,
            )

    @property
    def process_id(self) -> int:
        """The process id."""
        return self._popen.pid

    @property
    def returncode(self) -> int | None:
        """The exit code, or None while it runs."""
        return self._popen.poll()

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return its exit code. Raises subprocess.TimeoutExpired."""
        return self._popen.wait(timeout)

    def send(self, number: int) -> None:
        """Send it a signal."""
        self._popen.send_signal(number)

    def kill(self) -> None:
        """End it with SIGKILL, as a crash or a power cut does."""
        self._popen.kill()
        self._popen.wait()

    def end(self, number: int = signal.SIGINT) -> int:
        """End it as Ctrl-C does, or after 5 s with SIGKILL, and return its exit code."""
        if self._popen.poll() is None:
            self._popen.send_signal(number)
        return self.ended()

    def ended(self) -> int:
        """Wait for the end, for which SIGKILL is sent after 5 s, and return the exit code."""
        try:
            return self._popen.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()
            return -signal.SIGKILL
        finally:
            if self._popen.stdout is not None:
                self._popen.stdout.close()

    def ports(self) -> Ports:
        """Return the ports of a sim_controller, once it listens.

        Raises RunError with its log if it ends instead.
        """
        words = dict(word.split('=') for word in self._told('listening'))
        return Ports(**{key: int(value) for key, value in words.items()})

    def address(self) -> str:
        """Return what a browser opens, once a panel serves it. Raises RunError like `ports`."""
        return self._told('panel')[0]

    def _told(self, first: str) -> list[str]:
        """Return the words after the first one of the line that it prints when it is ready."""
        assert self._popen.stdout is not None  # noqa: S101 - only those of TELLING are asked
        line = self._popen.stdout.readline().decode()
        if not line.startswith(f'{first} '):
            self._popen.wait()
            raise RunError(f'{self.name} did not start:\n{line}{self.log_text()}')
        return line.split()[1:]

    def check_alive(self) -> None:
        """Raise RunError with its log if it has ended."""
        if self.returncode is not None:
            raise RunError(f'{self.name} ended with {self.returncode}:\n{self.log_text()}')

    def log_text(self) -> str:
        """Return what it has logged so far."""
        return self.log.read_text(encoding='utf-8', errors='replace')


def sim_controller(
    log: Path,
    *arguments: str,
    start: Sequence[float] | None = None,
    ports: Ports | None = None,
    environment: dict[str, str] | None = None,
) -> Process:
    """Start a simulated controller, on free ports unless `ports` says which.

    `start`: where its joints are at first, rad or m; None: where the executable puts them.
    """
    wanted = ports or Ports(0, 0, 0, 0)
    numbers = [
        word
        for name in ('motion', 'state', 'io', 'remote')
        for word in (f'--{name}-port', str(getattr(wanted, name)))
    ]
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
    """Start the ROS 2 node for a controller on these ports. Parameters: `__` for a dot."""
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

    Beside the log there is a parameter file for them. `parameters` hold for all: `__` for a dot.
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
    file.write_text(json.dumps(content), encoding='utf-8')  # which is YAML as well
    arguments = [word for name in robots for word in ('--namespace', name)]
    arguments += ['--ros-args', '--params-file', str(file)]
    return Process('client', arguments, log, ros_environment(domain), run)


def end_together(started: Sequence[Process], number: int = signal.SIGINT) -> None:
    """End processes as Ctrl-C does: tell all of them, in this order, then wait for each."""
    for process in started:
        if process.returncode is None:
            process.send(number)
    for process in started:
        process.ended()


@contextlib.contextmanager
def ended_at_exit(*processes: Process) -> Iterator[None]:
    """End the processes when the block is left, whatever happens in it."""
    try:
        yield
    finally:
        for process in processes:
            process.end()
