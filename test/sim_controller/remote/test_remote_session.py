# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The remote port's sessions, and who makes room for whom."""

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


def secured(password='open sesame', timeout=60.0):
    profile = replace(PROFILE, remote=replace(PROFILE.remote, password=password))
    profile = replace(profile, remote=replace(profile.remote, session_timeout=timeout))
    return Harness(motors=False, profile=profile)


@pytest.mark.parametrize('name', [name for name in COMMANDS if name not in ('Login', 'Sim')])
def test_nothing_is_obeyed_before_the_login(name):
    remote = Remote(login=None)
    assert remote(f'{name},1') == f'!{name},11'
    assert remote.controller.condition.motors is Motors.OFF


def test_a_hand_on_the_simulation_needs_no_login():
    remote = Remote(login=None)
    assert remote('Sim,estop,press') == '#Sim,0'
    assert remote.controller.condition.estopped


@pytest.mark.parametrize('login', ['Login', 'Login,', 'login', 'LOGIN,', 'Login,any'])
def test_without_a_password_any_is_taken(login):
    assert Remote(login=None)(login) == f'#{login.partition(",")[0]},0'


@pytest.mark.parametrize('wrong', ['', ',', ',open', ',open sesame,', ', open sesame', ',OPEN'])
def test_a_wrong_password(wrong):
    remote = Remote(secured(), login=None)
    assert remote('Login' + wrong) == '!Login,13'
    assert remote('GetStatus') == '!GetStatus,11'


def test_the_right_password_also_with_commas():
    assert Remote(secured(), login='Login,open sesame')('GetStatus').startswith('#')
    assert Remote(secured('a, b'), login='Login,a, b')('GetStatus').startswith('#')


def test_the_password_is_not_logged(caplog):
    remote = Remote(secured(), login=None)
    assert remote('Login,not it') == '!Login,13'
    assert 'the password is wrong' in caplog.text
    assert 'not it' not in caplog.text


def test_after_the_logout_nothing_is_obeyed(remote):
    assert remote('Logout') == '#Logout,0'
    assert remote('GetStatus') == '!GetStatus,11'
    assert remote('Login') == '#Login,0'
    assert remote('GetStatus').startswith('#')


def test_lines_in_any_segmentation_and_with_any_end():
    data = b'$Login\r\n$GetCurRobot\n$GetCurRobot\r$GetCurRobot\r\n'
    expected = ['#Login,0'] + ['#GetCurRobot,1'] * 3
    assert Remote(login=None).answers(data) == expected
    for cut in range(len(data)):
        remote = Remote(login=None)
        assert remote.answers(data[:cut]) + remote.answers(data[cut:]) == expected
    remote = Remote(login=None)
    assert [each for byte in data for each in remote.answers(bytes([byte]))] == expected


def test_empty_lines_are_not_answered(remote):
    assert remote.answers(b'\r\n\n\r') == []
    assert remote.answers(b'\r\r\n$Nothing\r\r\n') == ['!Nothing,11']


def test_a_line_may_be_so_long_and_no_longer(remote):
    longest = b'$' + b'x' * (MAX_LINE_CHARACTERS - 1)
    assert remote.answers(longest + b'\n') == [f'!{"x" * (MAX_LINE_CHARACTERS - 1)},11']
    assert remote.peer.ended is None
    assert remote.answers(longest + b'x$Reset\n') == ['!,12']
    assert remote.peer.ended == 'closed'
    assert remote.answers(b'\n$GetStatus\n') == []


def test_bytes_that_are_no_characters_are_answered_with_question_marks(remote):
    assert remote.answers(b'$\x00\x1b[2J\xff,\n') == ['!??[2J\N{REPLACEMENT CHARACTER},11']


def test_silence_closes_the_connection():
    remote = Remote(secured('', 60.0))
    remote.harness.step(59.0, 1.0)
    assert remote('GetStatus').startswith('#')
    remote.harness.step(59.0, 1.0)
    assert remote.peer.ended is None
    remote.harness.step(2.0, 1.0)
    assert remote.peer.ended == 'closed'
    assert remote.answers(b'$GetStatus\n') == []


def test_without_a_timeout_silence_is_allowed():
    remote = Remote(secured('', 0.0))
    remote.harness.step(1000.0, 10.0)
    assert remote('GetStatus').startswith('#')


def test_who_does_not_log_in_is_hung_up_on():
    remote = Remote(secured('', 0.0), login=None)
    remote.harness.step(LOGIN_TIMEOUT_S - 1.0, 1.0)
    assert remote.peer.ended is None
    remote.harness.step(2.0, 1.0)
    assert remote.peer.ended == 'closed'
    other = Remote(secured('', 0.0))
    assert other('Logout') == '#Logout,0'
    other.harness.step(LOGIN_TIMEOUT_S + 1.0, 1.0)
    assert other.peer.ended == 'closed'


def test_many_lines_leave_no_heap_of_timers():
    remote = Remote(secured('', 60.0))
    for _ in range(1000):
        remote.answers(b'$GetStatus\n$Logout\n$Login\n')
    assert remote.controller.clock.timers < 10
    remote.connection.closed()
    remote.connection.closed()
    remote.harness.step(400.0, 10.0)


def test_several_clients_at_once_each_with_its_own_login_and_its_own_why(remote):
    other = Remote(remote.harness, login=None)
    assert other('GetStatus') == '!GetStatus,11'
    assert remote('GetStatus').startswith('#')
    assert remote('Continue') == '!Continue,20'
    assert other('Login') == '#Login,0'
    assert other('Sim,why') == '#Sim,nobody is logged in'
    assert remote('Sim,why') == '#Sim,nothing is paused'


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


@pytest.mark.parametrize('command', ['Login', 'Sim,identity'])
def test_who_was_obeyed_stays_while_somebody_was_not(harness, idle, command):
    """The pendant of a simulated controller does not log in."""
    assert idle[0].says(command).startswith('#')
    assert idle[3].says('Login') == '#Login,0'
    for client in idle[4:]:
        assert client.says('Nothing').startswith('!')
    more = [Client(harness) for _ in range(MAX_REMOTE_CLIENTS)]
    assert not idle[0].gone
    assert not idle[3].gone
    assert idle[0].says(command).startswith('#')
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
