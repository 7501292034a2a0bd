# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Hosts on a switch, each a network namespace of Linux: a network that only its processes are in.

Nothing of it reaches this machine's own network. It needs no privileges where users may have
namespaces of their own (as root, where a container allows it), and `ip` of iproute2. A host has a
network interface, a loopback and shared memory of its own, so that DDS takes it for another
machine; files and processes are this machine's.
"""

import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

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
