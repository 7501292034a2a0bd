# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sessions of the remote port, and the order in which clients are replaced."""

from dataclasses import replace

import pytest
from support.controller_harness import PROFILE, Harness, Peer, Remote

from epson_driver.sim_controller.client_connections import GRACE_S, MAX_REMOTE_CLIENTS
from epson_driver.sim_controller.condition.states import Motors
from epson_driver.sim_controller.remote.remote_commands import COMMANDS
from epson_driver.sim_controller.remote.remote_session import LOGIN_TIMEOUT_S, MAX_LINE_CHARACTERS


@pytest.fixture
def remote():
    return Remote()


def harness_with_password(password='open sesame', timeout=60.0):
    profile = replace(PROFILE, remote=replace(PROFILE.remote, password=password))
    profile = replace(profile, remote=replace(profile.remote, session_timeout=timeout))
    return Harness(motors=False, profile=profile)


@pytest.mark.parametrize('name', [name for name in COMMANDS if name not in ('Login', 'Sim')])
def test_commands_before_the_login_are_refused(name):
    remote = Remote(login=None)
    assert remote(f'{name},1') == f'!{name},11'
    assert remote.controller.condition.motors is Motors.OFF


def test_sim_commands_need_no_login():
    remote = Remote(login=None)
    assert remote('Sim,estop,press') == '#Sim,0'
    assert remote.controller.condition.estopped


@pytest.mark.parametrize('login', ['Login', 'Login,', 'login', 'LOGIN,', 'Login,any'])
def test_any_password_is_accepted_if_none_is_set(login):
    assert Remote(login=None)(login) == f'#{login.partition(",")[0]},0'


@pytest.mark.parametrize('wrong', ['', ',', ',open', ',open sesame,', ', open sesame', ',OPEN'])
def test_wrong_password_is_refused(wrong):
    remote = Remote(harness_with_password(), login=None)
    assert remote('Login' + wrong) == '!Login,13'
    assert remote('GetStatus') == '!GetStatus,11'


def test_correct_password_may_contain_commas():
    assert Remote(harness_with_password(), login='Login,open sesame')('GetStatus').startswith('#')
    assert Remote(harness_with_password('a, b'), login='Login,a, b')('GetStatus').startswith('#')


def test_second_login_of_the_only_client_is_accepted():
    profile = replace(PROFILE, remote=replace(PROFILE.remote, clients=1))
    assert Remote(Harness(profile=profile))('Login') == '#Login,0'


def test_password_is_not_logged(caplog):
    remote = Remote(harness_with_password(), login=None)
    assert remote('Login,not it') == '!Login,13'
    assert 'the password is wrong' in caplog.text
    assert 'not it' not in caplog.text


def test_commands_after_the_logout_are_refused(remote):
    assert remote('Logout') == '#Logout,0'
    assert remote('GetStatus') == '!GetStatus,11'
    assert remote('Login') == '#Login,0'
    assert remote('GetStatus').startswith('#')


def test_lines_are_read_in_any_segmentation_and_with_any_line_end():
    data = b'$Login\r\n$GetCurRobot\n$GetCurRobot\r$GetCurRobot\r\n'
    expected = ['#Login,0'] + ['#GetCurRobot,1'] * 3
    assert Remote(login=None).answers(data) == expected
    for cut in range(len(data)):
        remote = Remote(login=None)
        assert remote.answers(data[:cut]) + remote.answers(data[cut:]) == expected
    remote = Remote(login=None)
    assert [answer for byte in data for answer in remote.answers(bytes([byte]))] == expected


def test_empty_lines_are_not_answered(remote):
    assert remote.answers(b'\r\n\n\r') == []
    assert remote.answers(b'\r\r\n$Nothing\r\r\n') == ['!Nothing,11']


@pytest.mark.invariant(7)
def test_inv7_too_long_line_closes_the_connection(remote):
    longest = b'$' + b'x' * (MAX_LINE_CHARACTERS - 1)
    assert remote.answers(longest + b'\n') == [f'!{"x" * (MAX_LINE_CHARACTERS - 1)},11']
    assert remote.peer.ended is None
    assert remote.answers(longest + b'x$Reset\n') == ['!,12']
    assert remote.peer.ended == 'closed'
    assert remote.answers(b'\n$GetStatus\n') == []


def test_reply_replaces_unprintable_and_non_ascii_bytes(remote):
    assert remote.answers(b'$\x00\x1b[2J\xff,\n') == ['!??[2J\N{REPLACEMENT CHARACTER},11']


def test_silent_remote_client_is_disconnected_after_the_timeout():
    remote = Remote(harness_with_password('', 60.0))
    remote.harness.step(59.0, 1.0)
    assert remote('GetStatus').startswith('#')
    remote.harness.step(59.0, 1.0)
    assert remote.peer.ended is None
    remote.harness.step(2.0, 1.0)
    assert remote.peer.ended == 'closed'
    assert remote.answers(b'$GetStatus\n') == []


def test_without_a_timeout_silence_is_allowed():
    remote = Remote(harness_with_password('', 0.0))
    remote.harness.step(1000.0, 10.0)
    assert remote('GetStatus').startswith('#')


def test_client_without_login_is_disconnected():
    remote = Remote(harness_with_password('', 0.0), login=None)
    remote.harness.step(LOGIN_TIMEOUT_S - 1.0, 1.0)
    assert remote.peer.ended is None
    remote.harness.step(2.0, 1.0)
    assert remote.peer.ended == 'closed'
    other = Remote(harness_with_password('', 0.0))
    assert other('Logout') == '#Logout,0'
    other.harness.step(LOGIN_TIMEOUT_S + 1.0, 1.0)
    assert other.peer.ended == 'closed'


def test_many_commands_leave_few_timers():
    remote = Remote(harness_with_password('', 60.0))
    for _ in range(1000):
        remote.answers(b'$GetStatus\n$Logout\n$Login\n')
    assert remote.controller.clock.timers < 10
    remote.connection.closed()
    remote.connection.closed()
    remote.harness.step(400.0, 10.0)


def test_each_client_has_its_own_login_and_last_rejection(remote):
    other = Remote(remote.harness, login=None)
    assert other('GetStatus') == '!GetStatus,11'
    assert remote('GetStatus').startswith('#')
    assert remote('Continue') == '!Continue,20'
    assert other('Login') == '#Login,0'
    assert other('Sim,why') == '#Sim,no client is logged in'
    assert remote('Sim,why') == '#Sim,nothing is paused'


class Client:
    """A remote client that sends only on request."""

    def __init__(self, harness, local=True, waiting=2 * GRACE_S):
        self.harness = harness
        self.peer = Peer(local)
        self.connection = harness.controller.connect('remote', self.peer)
        harness.step(waiting, GRACE_S)

    @property
    def gone(self):
        return self.peer.ended is not None

    def ask(self, command):
        self.connection.receive(f'${command}\r\n'.encode())
        self.harness.step(GRACE_S, GRACE_S)
        return self.peer.take().decode().strip()


@pytest.fixture
def harness():
    return Harness(motors=False)


@pytest.fixture
def idle(harness):
    """Fill the port with silent clients."""
    return [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]


def gone(clients):
    return [index for index, client in enumerate(clients) if client.gone]


@pytest.mark.invariant(7)
def test_inv7_surplus_client_replaces_the_longest_idle_one(harness, idle):
    for count in range(1, 2 * MAX_REMOTE_CLIENTS):
        newest = Client(harness)
        assert newest.ask('Login') == '#Login,0'
        assert newest.ask('Sim,estop,press') == '#Sim,0'
        newest.connection.closed()
        assert gone(idle) == [0], count  # the freed place is available again
    others = [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]
    assert gone(idle) == list(range(MAX_REMOTE_CLIENTS))
    assert gone(others) == []


@pytest.mark.parametrize('command', ['Login', 'Sim,identity'])
def test_client_with_accepted_commands_stays_longer(harness, idle, command):
    """The pendant of a simulated controller does not log in."""
    assert idle[0].ask(command).startswith('#')
    assert idle[3].ask('Login') == '#Login,0'
    for client in idle[4:]:
        assert client.ask('Nothing').startswith('!')
    more = [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]
    assert not idle[0].gone
    assert not idle[3].gone
    assert idle[0].ask(command).startswith('#')
    assert sum(not client.gone for client in [*idle, *more]) == MAX_REMOTE_CLIENTS


def test_logged_in_client_with_the_oldest_command_is_replaced(harness, idle):
    for client in idle:
        client.ask('Login')
    for client in reversed(idle[:-1]):
        client.ask('GetStatus')
    Client(harness)
    assert gone(idle) == [MAX_REMOTE_CLIENTS - 1]
    idle[0].connection.receive(b'$GetSt')  # an incomplete command does not count
    newest = Client(harness)
    assert newest.peer.ended is None


def test_remote_host_does_not_replace_a_local_client(harness, idle):
    with pytest.raises(ConnectionRefusedError, match='clients of this machine'):
        harness.controller.connect('remote', Peer(local=False))
    assert gone(idle) == []


def test_clients_of_other_hosts_are_replaced_first(harness):
    far = [Client(harness, local=False) for _ in range(MAX_REMOTE_CLIENTS - 1)]
    near = Client(harness)
    for client in far:
        client.ask('Login')
    Client(harness)
    assert not near.gone
    assert gone(far) == [0]
    Client(harness, local=False)
    assert gone(far) == [0, 1]
    assert not near.gone


def test_new_client_is_not_replaced_during_its_grace_period(harness, idle):
    for client in idle[: MAX_REMOTE_CLIENTS // 2]:
        client.ask('Login')
    new = [Client(harness, waiting=0.0) for _ in range(MAX_REMOTE_CLIENTS // 2 + 2)]
    assert not any(client.gone for client in new)
    assert gone(idle) == [0, 1, *range(MAX_REMOTE_CLIENTS // 2, MAX_REMOTE_CLIENTS)]
    harness.step(2 * GRACE_S, GRACE_S)
    Client(harness, waiting=0.0)
    assert gone(new) == [0]
    assert len(gone(idle)) == MAX_REMOTE_CLIENTS // 2 + 2


def test_other_ports_keep_their_clients(harness):
    state = harness.controller.connect('state', Peer())
    with pytest.raises(TypeError, match='state port is never evicted'):
        _ = state.eviction_priority
    harness.controller.clients.dismiss_remote('no client: no error')
