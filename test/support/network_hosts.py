# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Networks of hosts in namespaces, and who sees whom there."""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import NamedTuple

from epson_driver.fleet.fleet_processes import USUAL_PORT, VARIABLE

NETWORK = '10.77.0'
END_TIMEOUT_S = 5.0

_SWITCH = ('unshare', '--user', '--map-root-user', '--net')
_HOLD = 'echo ready && exec cat'
"""A namespace lives as long as a process in it: here one that ends with the pipe to it."""


class NoNamespacesError(RuntimeError):
    """This machine does not let us make network namespaces; the text says what it said."""


class Traffic(NamedTuple):
    """What hosts have sent to the switch since it was made."""

    packets: int
    bytes: int

    def since(self, before: 'Traffic') -> 'Traffic':
        """Return what came after."""
        return Traffic(self.packets - before.packets, self.bytes - before.bytes)


class Network:
    """A switch with a cable to each host. Raises NoNamespacesError if it cannot be made."""

    def __init__(self, names: Sequence[str]) -> None:
        self._ports = {name: number for number, name in enumerate(names, 1)}
        self._holders: list[subprocess.Popen[str]] = []
        self._hosts: dict[str, int] = {}
        try:
            self._switch = self._hold(*_SWITCH, 'sh', '-c', _HOLD)
            self._ip(self._switch, 'link add switch type bridge mcast_snooping 0')
            self._ip(self._switch, 'link set switch up')
            for name in names:
                self._add(name)
            for name in names:
                self._introduce(name)
        except (OSError, NoNamespacesError) as error:
            self.close()
            raise NoNamespacesError(f'no network namespaces here: {error}') from error

    def __enter__(self) -> 'Network':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all hosts. Whoever has started processes in them ends those before."""
        for holder in reversed(self._holders):
            if holder.stdin is not None:
                holder.stdin.close()
            try:
                holder.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                holder.kill()
                holder.wait()
            if holder.stdout is not None:
                holder.stdout.close()

    def address(self, name: str) -> str:
        """Return the IPv4 address of a host."""
        return f'{NETWORK}.{self._ports[name]}'

    def run(self, name: str) -> tuple[str, ...]:
        """Return the words before a command that make it run on a host."""
        return _inside(self._hosts[name])

    def cut(self, name: str) -> None:
        """Pull the cable between a host and the switch."""
        self._ip(self._switch, f'link set port{self._ports[name]} down')

    def mend(self, name: str) -> None:
        """Plug it in again."""
        self._ip(self._switch, f'link set port{self._ports[name]} up')

    def traffic(self, *names: str) -> Traffic:
        """Return what these hosts, or all of them, have sent to the switch so far."""
        text = Path(f'/proc/{self._switch}/net/dev').read_text(encoding='ascii')
        counters = {
            line.split(':')[0].strip(): line.split(':')[1].split()
            for line in text.splitlines()
            if ':' in line
        }
        found = [counters[f'port{self._ports[name]}'] for name in names or self._ports]
        return Traffic(sum(int(each[1]) for each in found), sum(int(each[0]) for each in found))

    def _add(self, name: str) -> None:
        port = self._ports[name]
        own_memory = f'mount -t tmpfs shm /dev/shm && {_HOLD}'  # as another machine has
        words = ('unshare', '--net', '--mount', 'sh', '-c', own_memory)
        holder = self._hold(*_inside(self._switch, mount=False), *words)
        self._hosts[name] = holder
        self._ip(self._switch, f'link add port{port} type veth peer name eth0 netns {holder}')
        self._ip(self._switch, f'link set port{port} master switch')
        self._ip(self._switch, f'link set port{port} up')
        for command in (
            'link set lo up',
            f'link set eth0 address {_hardware_address(port)}',
            'link set eth0 addrgenmode none',  # no IPv6, which would ask for routers
            f'addr add {NETWORK}.{port}/24 dev eth0',
            'link set eth0 up',
            'route add 224.0.0.0/4 dev eth0',
        ):
            self._ip(holder, command)

    def _introduce(self, name: str) -> None:
        """Tell a host the hardware addresses of the others.

        All hosts share the kernel's table of neighbours, which 32 of them would overflow
        (gc_thresh3 = 1024 entries); permanent ones do not count.
        """
        lines = [
            f'neigh add {NETWORK}.{port} lladdr {_hardware_address(port)} dev eth0 nud permanent'
            for other, port in self._ports.items()
            if other != name
        ]
        self._ip(self._hosts[name], '-batch -', '\n'.join(lines))

    def _hold(self, *words: str) -> int:
        """Start a process that keeps a namespace, and return its id once it has it."""
        holder = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # Ctrl-C is for the programs, not for the network
        )
        self._holders.append(holder)
        said = '' if holder.stdout is None else holder.stdout.readline()
        if said != 'ready\n':
            with suppress(subprocess.TimeoutExpired):
                holder.wait(END_TIMEOUT_S)
            raise NoNamespacesError(said.strip() or f'{words[0]} ended')
        return holder.pid

    @staticmethod
    def _ip(holder: int, command: str, text: str = '') -> None:
        words = [*_inside(holder, mount=False), 'ip', *command.split()]
        run = subprocess.run(words, input=text, capture_output=True, text=True, check=False)
        if run.returncode:
            raise NoNamespacesError(f'ip {command}: {run.stderr.strip()}')


def _hardware_address(port: int) -> str:
    return f'02:00:00:00:{port >> 8:02x}:{port & 255:02x}'


def _inside(holder: int, *, mount: bool = True) -> tuple[str, ...]:
    """Return the words that run a command in the namespaces of a process."""
    spaces = ['--user', '--net', *(['--mount'] if mount else [])]
    folder = f'--wd={Path.cwd()}'
    return ('nsenter', f'--target={holder}', '--preserve-credentials', *spaces, folder, '--')


PATIENCE_S = 240.0

DOMAIN = '1'

SERVER = 'server'

OBSERVER = (sys.executable, str(Path(__file__).with_name('robot_observer.py')))


class Sight:
    """An observer on a host: its lines, as they come."""

    def __init__(
        self, host: Sequence[str], names: Sequence[str], environment: dict[str, str], *words: str
    ) -> None:
        self._names = tuple(names)
        self._process = subprocess.Popen(
            [*host, *OBSERVER, *names, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self._lines: SimpleQueue[list[str]] = SimpleQueue()
        self.said: list[tuple[str, str]] = []
        """What it has said of which robot, as far as somebody has waited for it."""
        self.created = 0.0
        """When it became a participant, s."""
        Thread(target=self._read, daemon=True).start()

    def wait_for(self, what: str, *names: str, patience: float = PATIENCE_S) -> float:
        """Wait until it has said this of these robots, or of all, since then; return when, s.

        Raises TimeoutError if it does not say it of some of them.
        """
        left = set(names or self._names)
        until = time.monotonic() + patience
        last = self.created
        while left:
            try:
                words = self._lines.get(timeout=max(until - time.monotonic(), 0.0))
            except Empty:
                text = f'{what}: not said of {", ".join(sorted(left))} in {patience:g} s'
                raise TimeoutError(text) from None
            if words[0] == 'created':
                self.created = float(words[1])
                continue
            self.said.append((words[0], words[1]))
            if words[0] == what and words[1] in left:
                left.discard(words[1])
                last = float(words[2])
        return last

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()

    def _read(self) -> None:
        if self._process.stdout is not None:
            with self._process.stdout as lines:
                for line in lines:
                    self._lines.put(line.split())


def environment(network: Network, *, server: bool) -> dict[str, str]:
    """Return that of the programs on all hosts: ROS as it is by default, but for the server."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith('ROS_')}
    own = {'ROS_DOMAIN_ID': DOMAIN, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    if server:
        own[VARIABLE] = f'{network.address(SERVER)}:{USUAL_PORT}'
    return kept | own
