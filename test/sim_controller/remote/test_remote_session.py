# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The remote port's sessions: lines, logins, silence."""

from dataclasses import replace

import pytest
from support.controller_harness import PROFILE, Harness
from support.remote_harness import Remote

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


@pytest.mark.parametrize('name', [name for name in COMMANDS if name != 'Login'])
def test_nothing_is_obeyed_before_the_login(name):
    remote = Remote(login=None)
    assert remote(f'{name},1') == f'!{name},11'
    assert remote.controller.condition.motors is Motors.OFF


@pytest.mark.parametrize('login', ['Login', 'Login,', 'login', 'LOGIN,', 'Login,any'])
def test_without_a_password_any_is_taken(login):
    assert Remote(login=None)(login) == '#Login,0'


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
