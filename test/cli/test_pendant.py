# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver pendant`, with a simulated controller and with scripted real ones."""

import asyncio
import socket

import pytest
from support.here import run_here
from support.remote_peer import RemotePeer
from support.sim_process import vacant_port

from epson_driver.cli import pendant
from epson_driver.remote_ethernet.hand import ACTIONS, UsageError, action
from epson_driver.sim_controller.faults.fault_kinds import FAULTS

REAL_TIME = True


def call(port, words, *options):
    """Run the command. Return the exit code, the text, and the controller's identity."""
    done = run_here(pendant.main, f'--port={port}', *options, *words.split(' '))
    text = (done.stdout + done.stderr).removesuffix('\n')
    before, _, identity = text.removesuffix(']').rpartition(' [')
    if not identity.endswith(f'127.0.0.1:{port}'):
        before, identity = text, ''
    return done.returncode, before, identity


DIALOGUE = """
motors on
estop press
reset                   | ! the E-stop is pressed
estop release
reset
pause
door open
continue                | ! the safeguard door is open
door close
continue
stop
start
mode manual
mode auto
motors off
io DI 3 on              | DI 3: on
io AI 1 -2500           | AI 1: -2500
io                      | io: DI=24:3 DO=16: AI=2:0 -2500 AO=2:0 0 flag=512:
io DO 16 on             | ! this controller has digital outputs 0 to 15
fault late_reply seconds=3 | fault late_reply seconds=3: done
fault clear             | fault clear: done
fault                   | fault: none
disturb 2 -1.5          | disturb 2 -1.5: done
"""


def test_simulated_controller_obeys_or_gives_the_reason(start):
    port = start('--motion=ptp')[1]['remote']
    for line in DIALOGUE.strip().splitlines():
        words, _, expected = (part.strip() for part in line.partition('|'))
        code, text, identity = call(port, words)
        assert identity == f'simulated, c3_a601s, 127.0.0.1:{port}'
        if expected.startswith('!'):
            assert (code, text[:9]) == (1, 'refused: '), line
            assert expected[2:] in text
        else:
            assert (code, ' '.join(text.split())) == (0, expected or ACTIONS[words].done), line
    call(port, 'estop press')
    code, text, _ = call(port, 'status')
    assert code == 0
    for row in (
        'motors=off', 'estop=pressed', 'mode=AUTO', 'joints: 0.00000 -', 'timing: ',
        'state=the E-stop is pressed or not reset; release it, reset',
        'error=2261 (the motion task was stopped', '1=motion server,Normal,aborted (2261)',
    ):  # fmt: skip
        assert row in text


def test_help_marks_actions_that_a_real_controller_refuses():
    _, text, _ = call(1, '--help')
    marked = {line[2:28].strip() for line in text.splitlines() if line[28:30] == '* '}
    assert {'estop press', 'door open', 'reboot [SECONDS]', 'fault', 'io'} <= marked
    assert not marked & {'motors on', 'pause', 'continue', 'reset', 'power low', 'io KIND INDEX'}


def test_fault_kinds_are_listed_without_a_controller():
    code, text, _ = call(1, 'fault kinds')
    assert code == 0
    assert all(f'{name}\n' in text for name in FAULTS)


def test_closed_or_silent_port_is_reported():
    vacant = vacant_port()
    code, text, _ = call(vacant, 'status')
    assert code == 1
    assert f'127.0.0.1:{vacant}: Connection refused; check --host and --port' in text
    with socket.create_server(('127.0.0.1', 0)) as server:  # it accepts no connection
        port = server.getsockname()[1]
        code, text, _ = call(port, 'status', '--timeout=0.2')
    assert (code, text.partition(';')[0]) == (1, f'no answer from 127.0.0.1:{port} in 0.2 s')


async def at(words, *options, default='!%s,11', **answers):
    """Return the outcome of words at a real port, and the commands that it got."""
    async with RemotePeer(default=default, **{'Logout': '#Logout,0'} | answers) as real:
        outcome = await asyncio.to_thread(call, real.port, words, *options)
        return *outcome, [line[1:] for line in real.lines]


REAL = {'GetContType': '#GetContType,RC90-B', 'GetRobotInfo': '#GetRobotInfo,=;,;==,7'}
BUSY = {'SetMotorsOn,1': '!SetMotorsOn,20'}  # refused: the condition does not allow it
BY_HAND = 'refused: not possible remotely at a real controller: do it there by hand'


@pytest.mark.parametrize(
    ('words', 'answers', 'expected'),
    [
        ('status', {'GetStatus': '#GetStatus,0100100110,4031'},  # ten flags, like older firmware
         'status: motors=\nstate=the safeguard door is open; close it, continue at the '
         'controller if paused, then enable the arm\nerror=4031 (motion attempted with'),
        ('status', {'GetStatus': '#GetStatus,00100000001,0000', 'GetMotor,0': '#GetMotor,1,1,1'},
         'status: motors=1\nflags=Auto Ready'),
        ('power high', {'Execute,"Power High"': '#Execute,0'}, 'power high'),
        ('power low', {'Execute,"Power Low"': '#Execute,0'}, 'low power forced'),
        ('io DI 3', {'GetIO,3': '#GetIO,1'}, 'io DI 3: 1'),
        ('io DO 3', {'Execute,"Print Oport(3)"': '#Execute,"0"'}, 'io DO 3: "0"'),
        ('io DO 3 on', {'SetIO,3,1': '#SetIO,0'}, 'DO 3: on'),
        ('io flag 9 off', {'SetMemIO,9,0': '#SetMemIO,0'}, 'flag 9: off'),
        *((words, {}, BY_HAND) for words in ('estop press', 'door open', 'io DI 3 on', 'fault')),
        *(('motors on', BUSY | {'GetStatus': f'#GetStatus,{flags},0517'}, f'refused: {reason}')
          for flags, reason in {
            '00100010001': 'the E-stop is pressed or not reset; release it, reset',
            '00100000010': 'the arm is still moving: try again when it has stopped (error 20)',
            '00100000001': 'SetMotorsOn,1: the controller does not accept it in its present',
          }.items()),
    ],
)  # fmt: skip
async def test_real_controller_gets_its_own_command_or_refuses_it(words, answers, expected):
    code, text, identity, commands = await at(words, **REAL | answers)
    assert text.startswith(expected)
    assert code == int('refused' in expected)
    assert identity.startswith('RC90-B, 127.0.0.1:')
    assert {*answers} <= {*commands}
    assert commands.count('Logout') == 1 - code


@pytest.mark.parametrize(
    ('words', 'disconnects', 'sent'),
    [('motors off', 2, 3), ('motors off', 0, 1), ('motors on', 1, 1)],
)
async def test_only_a_stop_is_repeated_after_a_disconnect(words, disconnects, sent):
    """docs/invariants.md, 7: a busy controller disconnects, perhaps before it has obeyed."""
    (command,) = ACTIONS[words].commands
    done = [f'#{command.split(",")[0]},0']
    code, text, _, commands = await at(words, **{command: [ConnectionError] * disconnects + done})
    assert commands.count(command) == sent
    wanted = (1, 'no controller: ') if words == 'motors on' else (0, ACTIONS[words].done)
    assert (code, text[: len(wanted[1])]) == wanted


async def test_password_is_sent_but_not_printed(monkeypatch):
    monkeypatch.setenv('CELL_PASSWORD', 'secret')
    option = '--password-variable=CELL_PASSWORD'
    code, text, _, commands = await at('status', option, Login='!Login,13')
    assert code == 1
    assert commands == ['Login,secret']
    assert 'the password is wrong (error 13)' in text
    assert 'secret' not in text


@pytest.mark.parametrize(
    'answer',
    ['SSH-2.0-\x1b]0;owned\x07\x9b2J', '#%s,\x1b]0;owned\x07\x9b2J', '#%s,1,' + '9' * 5000],
    ids=['other protocol', 'escapes', 'long'],
)
@pytest.mark.parametrize('words', ['status', 'io DI 1'])
async def test_malicious_answer_is_printed_harmlessly(answer, words):
    other = answer.startswith('SSH')
    hostile = ('Login', 'GetStatus') if other else ('GetStatus',)
    exact = {name: answer.replace('%s', name) for name in hostile}
    code, text, identity, _ = await at(words, default=answer, **exact)
    assert ('is not a reply to ' in text and code == 1) or not other
    assert (text + identity).replace('\n', '').isprintable()
    assert len(text) < 20_000


@pytest.mark.parametrize(
    'words', ['io DI', 'io DI x', 'io DI -1', 'io DI 3 high', 'io DI 3 on on', 'io DO 3,1 on']
)
def test_invalid_words_are_a_usage_error(words):
    with pytest.raises(UsageError, match='must be '):
        action(words)


def test_unknown_action_is_refused_with_the_nearest_first():
    with pytest.raises(UsageError, match=r"^'Estop': did you mean estop press or estop release\?"):
        action('Estop')
