# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two hosts as network namespaces: a robot's driver on one, who listens to it on another.

Where a machine lets nobody make network namespaces, these tests are skipped, and say so.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
from support.network_hosts import SERVER, Network, NoNamespacesError, Sight, environment

from epson_driver.fleet.fleet_processes import discovery_server
from epson_driver.processes.processes import EXECUTABLE, Process, end_together

CELL, OFFICE = 'cell', 'office'
BARE = (sys.executable, '-I', '-S', '-c')

RECEIVE = """
import socket
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
    receiver.bind(('', 5000))
    print('ready', flush=True)
    while True:
        print(receiver.recv(100).decode(), flush=True)
"""
SEND = """
import socket, sys
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
    sender.sendto(sys.argv[2].encode(), (sys.argv[1], 5000))
"""


@pytest.fixture
def make_network() -> Iterator[Callable[..., Network]]:
    with ExitStack() as stack:

        def make(*names: str) -> Network:
            try:
                return stack.enter_context(Network(names))
            except NoNamespacesError as error:
                pytest.skip(str(error))

        yield make


def test_a_cable_that_is_cut_passes_nothing(make_network: Callable[..., Network]) -> None:
    network = make_network(CELL, OFFICE)

    def send(word: str) -> None:
        words = [*network.run(CELL), *BARE, SEND, network.address(OFFICE), word]
        subprocess.run(words, check=True)

    receiver = subprocess.Popen(
        [*network.run(OFFICE), *BARE, RECEIVE], stdout=subprocess.PIPE, text=True
    )
    try:
        assert receiver.stdout is not None
        assert receiver.stdout.readline() == 'ready\n'
        before = network.traffic(CELL)
        send('first')
        assert receiver.stdout.readline() == 'first\n'
        assert network.traffic(CELL).since(before).packets >= 1
        network.cut(CELL)
        before = network.traffic(CELL)
        send('in vain')  # the kernel may keep it, and send it when the cable is back
        assert network.traffic(CELL) == before
        network.mend(CELL)
        send('last')
        while (line := receiver.stdout.readline()) != 'last\n':
            assert line == 'in vain\n'
    finally:
        receiver.kill()
        receiver.wait()
        if receiver.stdout is not None:
            receiver.stdout.close()


class Floor:
    """Robots and listeners on the hosts of a network; all processes end with it."""

    def __init__(self, network: Network, folder: Path, *, server: bool) -> None:
        self.network = network
        self._folder = folder
        self._environment = environment(network, server=server)
        self._processes: list[Process] = []
        self._sights: list[Sight] = []

    def robot(self, host: str, name: str) -> Process:
        """Start a controller and its driver on a host; return the driver."""
        run = (*self.network.run(host), *EXECUTABLE)
        motion, state, io, remote = (str(20_000 + 10 * self._count() + i) for i in range(4))
        ports = ('--motion-port', motion, '--state-port', state, '--io-port', io)
        words: tuple[str, ...] = (
            '--motion=ptp',
            '--state-period=0.05',
            *ports,
            '--remote-port',
            remote,
        )
        controller = self._start('sim_controller', words, f'controller_{name}', run)
        controller.ports()
        settings = {'motion': motion, 'state': state, 'io': io, 'remote': remote}
        words = ('--namespace', name, '--ros-args')
        for port, number in settings.items():
            words = (*words, '-p', f'{port}_port:={number}')
        return self._start('client', words, f'client_{name}', run)

    def server(self) -> Process:
        """Start the discovery server on its host."""
        log, address = self._folder / 'server.log', self.network.address(SERVER)
        self._processes.append(discovery_server(log, address, run=self.network.run(SERVER)))
        return self._processes[-1]

    def listener(self, host: str, *names: str) -> Sight:
        """Start a listener to the joint states of these robots."""
        sight = Sight(self.network.run(host), names, self._environment, '--states')
        self._sights.append(sight)
        return sight

    def close(self) -> None:
        for sight in self._sights:
            sight.close()
        end_together(self._processes[::-1])

    def _count(self) -> int:
        return len(self._processes)

    def _start(self, name: str, words: Sequence[str], log: str, run: Sequence[str]) -> Process:
        path = self._folder / f'{log}.log'
        self._processes.append(Process(name, words, path, self._environment, run))
        return self._processes[-1]


@pytest.fixture
def make_floor(
    make_network: Callable[..., Network], tmp_path: Path
) -> Iterator[Callable[..., Floor]]:
    made: list[Floor] = []

    def make(*names: str, server: bool) -> Floor:
        made.append(Floor(make_network(*names), tmp_path, server=server))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.slow
@pytest.mark.parametrize('server', [False, True], ids=['simple', 'server'])
def test_a_robot_is_heard_again_after_its_cable_was_pulled(
    make_floor: Callable[..., Floor], server: bool
) -> None:
    """So long that DDS gives it up: both sides must find each other anew."""
    floor = make_floor(CELL, OFFICE, SERVER, server=server)
    if server:
        floor.server()
    driver = floor.robot(CELL, 'robot_1')
    listener = floor.listener(OFFICE, 'robot_1')
    listener.wait_for('heard')
    floor.network.cut(CELL)
    listener.wait_for('silent')
    listener.wait_for('gone')
    assert driver.returncode is None
    floor.network.mend(CELL)
    listener.wait_for('heard')
    log = driver.log_text()  # the controller is beside it: that link never broke
    assert log.count('state link connected') == 1
    assert 'link lost' not in log


@pytest.mark.slow
def test_robots_go_on_while_the_discovery_server_is_dead_and_newcomers_are_found_afterwards(
    make_floor: Callable[..., Floor],
) -> None:
    floor = make_floor(CELL, OFFICE, SERVER, server=True)
    server = floor.server()
    floor.robot(CELL, 'robot_1')
    listener = floor.listener(OFFICE, 'robot_1', 'robot_2')
    listener.wait_for('heard', 'robot_1')
    server.kill()
    floor.robot(CELL, 'robot_2')
    later = floor.listener(CELL, 'robot_2')  # on its host, yet only the server tells of it
    floor.server()
    listener.wait_for('heard', 'robot_2')
    later.wait_for('heard')
    assert ('gone', 'robot_1') not in listener.said


@pytest.mark.slow
@pytest.mark.parametrize('server', [False, True], ids=['simple', 'server'])
def test_a_robot_that_joins_late_is_heard(make_floor: Callable[..., Floor], server: bool) -> None:
    floor = make_floor(CELL, OFFICE, SERVER, server=server)
    if server:
        floor.server()
    listener = floor.listener(OFFICE, 'robot_1', 'robot_2')
    floor.robot(CELL, 'robot_1')
    listener.wait_for('heard', 'robot_1')
    floor.robot(CELL, 'robot_2')
    listener.wait_for('heard', 'robot_2')
    assert ('gone', 'robot_1') not in listener.said
