# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Remote Ethernet lines against the core, without sockets."""

import pytest
from controller_bench import PROFILE, Bench, point

from epson_driver.controller.remote_commands import RemoteSession
from epson_driver.controller.states import Condition


@pytest.fixture
def bench():
    return Bench(motors=False)


@pytest.fixture
def ask(bench):
    session = RemoteSession()
    assert session.answer('$Login,any password', bench.controller) == '#Login,0'
    return lambda line: session.answer(line, bench.controller)


@pytest.mark.parametrize(
    'line',
    [
        '$Reset',
        '$SetMotorsOn,1',
        '$SetMotorsOff,1',
        '$GetStatus',
        '$GetMotor,0',
        '$Sim,estop,press',
    ],
)
def test_nothing_is_obeyed_before_the_login(bench, line):
    answer = RemoteSession().answer(line, bench.controller)
    assert answer == f'!{line[1:].split(",")[0]},11'
    assert bench.controller.condition is Condition.MOTORS_OFF


@pytest.mark.parametrize(
    'login', ['$Login', '$Login,', '$Login,secret', '$login,x', '$Login, a,b']
)
def test_any_password_logs_in(bench, login):
    session = RemoteSession()
    assert session.answer(login, bench.controller) == '#Login,0'
    assert session.answer('$GetStatus', bench.controller) == '#GetStatus,00100000001,0000'


def test_after_the_logout_nothing_is_obeyed(ask):
    assert ask('$Logout') == '#Logout,0'
    assert ask('$GetStatus') == '!GetStatus,11'


@pytest.mark.parametrize('robot', ['', ',1', ',0', ', 1'])
def test_motors_with_and_without_the_robots_number(ask, bench, robot):
    assert ask('$SetMotorsOn' + robot) == '#SetMotorsOn,0'
    assert bench.controller.condition is Condition.MOTORS_ON
    assert ask('$GetMotor,0') == '#GetMotor,1,1,1'
    assert ask('$SetMotorsOff' + robot) == '#SetMotorsOff,0'
    assert bench.controller.condition is Condition.MOTORS_OFF
    assert ask('$GetMotor,0') == '#GetMotor,1,0,0'


@pytest.mark.parametrize(
    ('line', 'answer'),
    [
        ('GetStatus', '!GetStatus,10'),
        ('#GetStatus', '!#GetStatus,10'),
        ('', '!,10'),
        ('$', '!,11'),
        ('$Dance', '!Dance,11'),
        ('$Dance,1,2', '!Dance,11'),
        ('$SetMotorsOn,2', '!SetMotorsOn,15'),
        ('$SetMotorsOn,one', '!SetMotorsOn,15'),
        ('$SetMotorsOn,1,1', '!SetMotorsOn,12'),
        ('$Reset,1', '!Reset,12'),
        ('$GetStatus,', '!GetStatus,12'),
        ('$Sim', '!Sim,15'),
        ('$Sim,estop', '!Sim,15'),
        ('$Sim,estop,kick', '!Sim,15'),
        ('$Sim,estop,press,twice', '!Sim,15'),
        ('$\N{REPLACEMENT CHARACTER}', '!\N{REPLACEMENT CHARACTER},11'),
    ],
)
def test_error_numbers(ask, bench, line, answer):
    assert ask(line) == answer
    assert bench.controller.condition is Condition.MOTORS_OFF
    assert ask('$SetMotorsOn,1') == '#SetMotorsOn,0'


def test_estop_and_the_way_back(ask):
    assert ask('$SetMotorsOn,1') == '#SetMotorsOn,0'
    assert ask('$Sim,estop,press') == '#Sim,0'
    assert ask('$GetStatus') == '#GetStatus,00100011001,2261'
    assert ask('$SetMotorsOn,1') == '!SetMotorsOn,20'
    assert ask('$Reset') == '!Reset,20'
    assert ask('$Sim,estop,release') == '#Sim,0'
    assert ask('$SetMotorsOn,1') == '!SetMotorsOn,20'
    assert ask('$Reset') == '#Reset,0'
    assert ask('$GetStatus') == '#GetStatus,00100000001,0000'
    assert ask('$GetMotor,0') == '#GetMotor,1,0,0'
    assert ask('$SetMotorsOn,1') == '#SetMotorsOn,0'


def test_what_came_too_late_can_be_asked_for(ask, bench):
    assert ask('$Sim,timing') == '#Sim,0,0,0'
    bench.controller.timing.deadline_misses = 7
    bench.controller.timing.late_plans = 2
    bench.controller.timing.planner_failures = 1
    assert ask('$Sim,timing') == '#Sim,7,2,1'


def test_status_flags_while_it_moves_and_with_an_error(ask, bench):
    ask('$SetMotorsOn')
    bench.send(point(0, (1.0,)))
    assert ask('$GetStatus') == '#GetStatus,00100000010,0000'
    bench.send(point(9))
    bench.rest()
    assert ask('$GetStatus') == '#GetStatus,00100001001,8000'
    assert PROFILE.mode.name == 'AUTO'
