# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Who has to make room on a full remote port, on a manual clock."""

import pytest
from support.controller_harness import Harness, Peer

from epson_driver.sim_controller.client_connections import GRACE_S, MAX_REMOTE_CLIENTS


class Client:
    """A remote client that says nothing of itself."""

    def __init__(self, harness, local=True, stays=2 * GRACE_S):
        self.harness = harness
        self.peer = Peer(local)
        self.connection = harness.controller.connect('remote', self.peer)
        harness.step(stays, GRACE_S)

    @property
    def gone(self):
        return self.peer.ended is not None

    def says(self, command):
        self.connection.receive(f'${command}\r\n'.encode())
        self.harness.step(GRACE_S, GRACE_S)
        return self.peer.take().decode().strip()


@pytest.fixture
def harness():
    return Harness(motors=False)


@pytest.fixture
def idle(harness):
    """Fill the port with clients that say nothing."""
    return [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]


def gone(clients):
    return [index for index, client in enumerate(clients) if client.gone]


@pytest.mark.invariant(7)
def test_invariant_7_the_one_too_many_gets_in_and_the_one_idle_longest_makes_room(harness, idle):
    for count in range(1, 2 * MAX_REMOTE_CLIENTS):
        newest = Client(harness)
        assert newest.says('Login') == '#Login,0'
        assert newest.says('Sim,estop,press') == '#Sim,0'
        newest.connection.closed()
        assert gone(idle) == [0], count  # the place that was made is free again
    others = [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]
    assert gone(idle) == list(range(MAX_REMOTE_CLIENTS))
    assert gone(others) == []


def test_who_is_logged_in_stays_while_somebody_is_not(harness, idle):
    assert idle[0].says('Login') == '#Login,0'
    assert idle[3].says('Login') == '#Login,0'
    more = [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]
    assert not idle[0].gone
    assert not idle[3].gone
    assert idle[0].says('GetStatus').startswith('#')
    assert sum(not client.gone for client in [*idle, *more]) == MAX_REMOTE_CLIENTS


def test_of_those_logged_in_the_one_whose_last_command_is_oldest_makes_room(harness, idle):
    for client in idle:
        client.says('Login')
    for client in reversed(idle[:-1]):
        client.says('GetStatus')
    Client(harness)
    assert gone(idle) == [MAX_REMOTE_CLIENTS - 1]
    idle[0].connection.receive(b'$GetSt')  # half a command is none
    newest = Client(harness)
    assert newest.peer.ended is None


def test_a_client_of_this_machine_does_not_make_room_for_one_of_another(harness, idle):
    with pytest.raises(ConnectionRefusedError, match='clients of this machine'):
        harness.controller.connect('remote', Peer(local=False))
    assert gone(idle) == []


def test_clients_of_other_machines_make_room_first_be_they_logged_in(harness):
    far = [Client(harness, local=False) for _ in range(MAX_REMOTE_CLIENTS - 1)]
    near = Client(harness)
    for client in far:
        client.says('Login')
    Client(harness)
    assert not near.gone
    assert gone(far) == [0]
    Client(harness, local=False)
    assert gone(far) == [0, 1]
    assert not near.gone


def test_who_has_just_come_is_heard_before_it_makes_room(harness, idle):
    for client in idle[: MAX_REMOTE_CLIENTS // 2]:
        client.says('Login')
    new = [Client(harness, stays=0.0) for _ in range(MAX_REMOTE_CLIENTS // 2 + 2)]
    assert not any(client.gone for client in new)
    assert gone(idle) == [0, 1, *range(MAX_REMOTE_CLIENTS // 2, MAX_REMOTE_CLIENTS)]
    harness.step(2 * GRACE_S, GRACE_S)
    Client(harness, stays=0.0)
    assert gone(new) == [0]
    assert len(gone(idle)) == MAX_REMOTE_CLIENTS // 2 + 2


def test_other_ports_keep_their_clients(harness):
    state = harness.controller.connect('state', Peer())
    with pytest.raises(TypeError, match='state port keeps its place'):
        _ = state.claim
    harness.controller.clients.dismiss_remote('nobody is there: no error')
