# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Many clients at once, and the log of their messages."""

import asyncio
import errno
import logging
import socket
from functools import partial

import pytest
from support.controller_harness import Harness, Peer, frame
from support.event_loop import until
from support.examples import one_in
from test_controller_servers import HOST, on_sockets, read_frame, rejected

from epson_driver.log_lines import BURST_LINES, StderrLog
from epson_driver.remote_ethernet.client import execute
from epson_driver.sim_controller.client_connections import (
    MAX_NEWCOMERS,
    MAX_REMOTE_CLIENTS,
    ClientConnection,
)
from epson_driver.sim_controller.network.port_server import (
    INITIAL_S,
    MAX_SAVED_S,
    MAX_WAITING_CLIENTS,
    CpuBudget,
    port_rules,
)

CROWD = 200

on_sockets_in_real_time = partial(on_sockets, real_time=True)


async def connect_many(served, port, count=CROWD):
    return [await served.connect(port) for _ in range(count)]


@pytest.mark.invariant(7)
@pytest.mark.parametrize('port', one_in(4, ['remote', 'motion', 'state', 'io']))
def test_inv7_each_of_many_clients_is_served_or_refused(port, monkeypatch):
    async def test(served):
        rules = next(
            rule for rule in port_rules(served.controller.profile.server) if rule.name == port
        )
        most = (
            MAX_REMOTE_CLIENTS
            if rules.max_clients is None
            else rules.max_clients + MAX_WAITING_CLIENTS
        )
        seen = []
        real = asyncio.open_connection

        async def counted(*where, **options):
            if 'sock' in options:  # an accepted client
                seen.append(served.servers.clients(port))
            return await real(*where, **options)

        monkeypatch.setattr(asyncio, 'open_connection', counted)
        clients = await connect_many(served, port)
        capacity = rules.max_clients or MAX_REMOTE_CLIENTS
        ends = [asyncio.create_task(rejected(reader)) for reader, _ in clients]
        await until(lambda: sum(end.done() for end in ends) >= CROWD - capacity)
        assert max(seen) <= most + MAX_NEWCOMERS  # displaced clients close a little later
        await until(lambda: served.servers.clients(port) == capacity)
        assert sum(end.done() for end in ends) == CROWD - capacity

    on_sockets(test, real_time=True)()


@pytest.mark.invariant(7)
@on_sockets_in_real_time
async def test_inv7_remote_command_is_answered_beside_many_clients(served):
    await connect_many(served, 'remote')
    assert await execute(HOST, served.ports.remote, ['Sim,estop,press'], 60) == ['0']


@on_sockets_in_real_time
async def test_refused_clients_do_not_disturb_the_others(served):
    state, _ = await served.connect('state')
    await read_frame(state)
    await connect_many(served, 'state')
    for _ in range(50):
        await read_frame(state)


@pytest.mark.invariant(9)
@pytest.mark.parametrize('number', [errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.EPROTO])
def test_inv9_failed_accept_is_logged_and_retried(number, caplog, monkeypatch):
    async def test(served):
        failures = 3
        real = socket.socket.accept

        def accept(listening):
            nonlocal failures
            failures -= 1
            if failures < 0:
                return real(listening)
            raise OSError(number, 'as injected')

        monkeypatch.setattr(socket.socket, 'accept', accept)
        reader, writer = await served.connect()
        writer.write(frame(1, 2, 0))
        assert (await read_frame(reader))[:3] == (1, 3, 1)

    on_sockets(test)()
    lines = [text for text in caplog.messages if 'cannot accept connections' in text]
    assert lines == ['motion port: cannot accept connections: as injected'] * 3
    assert 'Traceback' not in caplog.text


@pytest.mark.invariant(7)
@pytest.mark.slow
@on_sockets
async def test_inv7_one_client_is_read_per_iteration_of_the_loop(served):
    """The work between two timer checks is bounded, and all clients are served."""
    loop = asyncio.get_running_loop()
    turn = 0
    received = []

    def next_turn():
        nonlocal turn
        turn += 1
        loop.call_soon(next_turn)

    def receive(connection, data, real=ClientConnection.receive):
        received.append((turn, connection, len(data)))
        real(connection, data)

    loop.call_soon(next_turn)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ClientConnection, 'receive', receive)
        for port in ('state', 'io', 'remote', 'motion'):
            for _ in range(1 if port == 'motion' else 5):
                _, writer = await served.connect(port)
                writer.write(b'$GetStatus\n' * 500 if port == 'remote' else frame(1, 2, 0) * 500)
        await until(lambda: len(received) > 150)
    turns = [at for at, _, _ in received]
    assert len(set(turns)) == len(turns)
    connections = {connection for _, connection, _ in received}
    assert len(connections) == 16
    assert all(size <= 128 for _, connection, size in received if connection.port == 'remote')
    assert all(size <= 1024 for _, connection, size in received if connection.port != 'motion')


def test_cpu_budget_delays_heavy_use_and_saves_unused_time():
    budget = CpuBudget(0.0)
    assert budget.used(INITIAL_S, 0.1, 0.0) == 0.0
    assert budget.used(0.01, 0.1, 0.0) == pytest.approx(0.1)
    assert budget.used(0.01, 0.1, 0.1) == pytest.approx(0.1)
    assert budget.used(0.6 * MAX_SAVED_S, 0.1, 1000.0) == 0.0
    assert budget.used(0.4 * MAX_SAVED_S, 0.1, 1000.0) == pytest.approx(0.0)
    assert budget.used(MAX_SAVED_S, 0.1, 2000.0) == pytest.approx(0.0)  # the maximum is saved
    assert budget.used(0.01, 0.1, 2000.0) == pytest.approx(0.1)


@pytest.mark.parametrize('clients', [1, 4, 16])
def test_clients_of_a_port_share_its_cpu_budget(clients):
    budgets = [CpuBudget(0.0) for _ in range(clients)]
    due = [0.0] * clients
    used = 0.0
    while min(due) < 100.0:
        index = due.index(min(due))
        used += 0.001
        due[index] += max(budgets[index].used(0.001, 0.2 / clients, due[index]), 1e-6)
    assert used == pytest.approx(0.2 * 100.0 + clients * INITIAL_S, rel=0.01)


MANY = 20_000


class Log:
    """The lines that a controller writes to stderr, on a manual clock."""

    def __init__(self, capfd):
        self.now = 100.0
        self._capfd = capfd
        self.handler = StderrLog(clock=lambda: self.now)

    def lines(self):
        self.handler.finish()
        return self._capfd.readouterr().err.splitlines()


@pytest.fixture
def log(capfd):
    log = Log(capfd)
    logger = logging.getLogger('epson_driver')
    level = logger.level
    logger.addHandler(log.handler)
    logger.setLevel(logging.INFO)
    yield log
    logger.removeHandler(log.handler)
    logger.setLevel(level)


@pytest.fixture
def client():
    harness = Harness(motors=False)
    return harness.controller.connect('remote', Peer())


@pytest.mark.slow
@pytest.mark.invariant(7)
def test_inv7_repeated_rejections_are_counted_not_logged(log, client):
    client.receive(b'$Nothing\n' * MANY)
    log.now += 1.0
    client.receive(b'$Nothing\n' * MANY)
    lines = log.lines()
    assert len(lines) == BURST_LINES + 1
    assert all('unknown command Nothing' in line for line in lines)
    assert lines[-1].endswith(f'(and {MANY - BURST_LINES} like it before)')


@pytest.mark.slow
def test_other_lines_are_logged_while_one_kind_is_suppressed(log, client):
    client.receive(b'$Login\n' + b'$Nothing\n' * MANY + b'$Sim,estop,press\n')
    lines = log.lines()
    assert len(lines) == BURST_LINES + 1
    assert 'E-stop press: ' in lines[-1]


@pytest.mark.invariant(7)
@pytest.mark.parametrize('port', ['motion', 'state', 'io'])
def test_inv7_log_of_refused_messages_is_limited_on_every_port(log, port):
    connection = Harness(motors=False, connect=False).controller.connect(port, Peer())
    for kind in (11, 12, 13, 65_201, 999, 0, -1):  # too short for their types
        connection.receive(
            b'\x0f\0\0\0' + kind.to_bytes(4, 'little', signed=True) + b'\2' + bytes(10)
        )
    for _ in range(MANY // 10):
        connection.receive(b'\x0f\0\0\0\x0b\0\0\0\2' + bytes(10))
    assert 1 <= len(log.lines()) <= 3 * BURST_LINES
