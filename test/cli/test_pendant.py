# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver pendant`, with a simulated controller and with scripted real ones."""

import socket
import threading
from contextlib import suppress

import pytest
from support.here import run_here
from support.sim_process import vacant_port

from epson_driver.cli import pendant
from epson_driver.remote_ethernet.hand import ACTIONS, UsageError, action
from epson_driver.sim_controller.faults.fault_kinds import FAULTS


def call(port, words, *options):
    """Run the command. Return the exit code, the text, and the controller's identity."""
    done = run_here(pendant.main, f'--port={port}', *options, *words.split(' '))
    text = (done.stdout + done.stderr).removesuffix('\n')
    before, _, identity = text.removesuffix(']').rpartition(' [')
    if not identity.endswith(f'127.0.0.1:{port}'):
        before, identity = text, ''
    return done.returncode, before, identity


# ---- a simulated controller


@pytest.fixture
def port(start):
    """The remote port of a simulated controller."""
    return start('--motion=ptp')[1]['remote']


DIALOGUE = """
motors on
estop press
reset                   | ! the E-stop is pressed
estop release
reset
motors on
pause
reset                   | ! the tasks are paused
door open
continue                | ! the safeguard door is open
door close
continue
stop
start
mode manual
motors on               | ! the key switch is at MANUAL
mode auto
motors off
io                      | io: DI=24: DO=16: AI=2:0 0 AO=2:0 0 flag=512:
io DI 3 on              | DI 3: on
io DO 5 1               | DO 5: 1
io AI 1 -2500           | AI 1: -2500
io flag 7 on            | flag 7: on
io                      | io: DI=24:3 DO=16:5 AI=2:0 -2500 AO=2:0 0 flag=512:7
io DO 16 on             | ! this controller has digital outputs 0 to 15
io lamp 3               | ! must be one of DI, DO, AI, AO, flag
fault                   | fault: none
fault late_reply seconds=3 | fault late_reply seconds=3: done
fault delay:seconds=0.2,port=state | fault delay:seconds=0.2,port=state: done
fault clear delay       | fault clear delay: done
fault clear             | fault clear: done
disturb 2 -1.5          | disturb 2 -1.5: done
disturb 9 1             | ! joint
"""


def test_simulated_controller_obeys_or_gives_the_reason(port):
    for line in DIALOGUE.strip().splitlines():
        words, _, expected = (part.strip() for part in line.partition('|'))
        code, text, identity = call(port, words)
        assert identity == f'simulated, c3_a601s, 127.0.0.1:{port}'
        if expected.startswith('!'):
            assert (code, text[:9]) == (1, 'refused: '), line
            assert expected[2:] in text
        else:
            assert (code, ' '.join(text.split())) == (0, expected or ACTIONS[words].done), line


def test_status_shows_the_condition_of_a_simulated_controller(port):
    call(port, 'estop press')
    code, text, _ = call(port, 'status')
    assert code == 0
    for row in (
        'motors=off', 'estop=pressed', 'mode=AUTO', 'joints: 0.00000 0.00000', 'timing: ',
        'state=the E-stop is pressed or not reset; release it, reset',
        'error=2261 (the motion task was stopped', '1=motion server,Normal,aborted (2261)',
    ):  # fmt: skip
        assert row in text


# ---- without a controller


def test_help_marks_actions_that_a_real_controller_refuses():
    _, text, _ = call(1, '--help')
    marked = {line[2:28].strip() for line in text.splitlines() if line[28:30] == '* '}
    assert {'estop press', 'door open', 'reboot [SECONDS]', 'fault', 'io'} <= marked
    assert not marked & {'motors on', 'pause', 'continue', 'reset', 'power low', 'io KIND INDEX'}


def test_fault_kinds_are_listed_without_a_controller():
    code, text, _ = call(1, 'fault kinds')
    assert code == 0
    assert all(f'{name}\n' in text for name in FAULTS)


def test_closed_port_is_reported():
    vacant = vacant_port()
    code, text, _ = call(vacant, 'status')
    assert code == 1
    assert f'127.0.0.1:{vacant}: Connection refused; check --host and --port' in text


def test_missing_answer_is_reported_with_the_timeout():
    with socket.create_server(('127.0.0.1', 0)) as server:  # it accepts no connection
        port = server.getsockname()[1]
        code, text, _ = call(port, 'status', '--timeout=0.2')
    assert (code, text.partition(';')[0]) == (1, f'no answer from 127.0.0.1:{port} in 0.2 s')


# ---- scripted controllers


class ScriptedPort:
    """A remote port with fixed answers. It rejects other commands, or answers `default`.

    It disconnects once at each command of `disconnects`, instead of an answer.
    """

    def __init__(self, answers=(), default=b'!%s,11\r\n', greeting=b'', disconnects=()):
        answers = {'Login,': '#Login,0', 'Logout': '#Logout,0', **dict(answers)}
        self._answers = {key.encode(): f'{line}\r\n'.encode() for key, line in answers.items()}
        self._default = default
        self._greeting = greeting
        self._disconnects = list(disconnects)
        self.commands = []

    def __enter__(self):
        self._server = socket.create_server(('127.0.0.1', 0))
        self.port = self._server.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._server.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._server.close()

    def _serve(self):
        with suppress(OSError):
            while True:
                client, _ = self._server.accept()
                with suppress(ConnectionError), client, client.makefile('rb') as lines:
                    self._serve_client(client, lines)

    def _serve_client(self, client, lines):
        client.sendall(self._greeting)
        for line in lines:
            command = line.strip().removeprefix(b'$')
            self.commands.append(command.decode())
            if self.commands[-1] in self._disconnects:
                self._disconnects.remove(self.commands[-1])
                return
            default = self._default.replace(b'%s', command.partition(b',')[0])
            client.sendall(self._answers.get(command, default))


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
            '00101001001': 'there is a critical error: error 517; switch the controller off',
            '00100100100': 'the safeguard door is open; close it',
            '01000000001': 'the mode is TEACH; turn it to AUTO',
            '00100001001': 'the controller is in error 517; reset',
            '00100000100': 'the tasks are paused; continue',
            '00100000010': 'the arm is still moving: try again when it has stopped (error 20)',
            '00100000001': 'SetMotorsOn,1: the controller does not accept it in its present',
          }.items()),
    ],
)  # fmt: skip
def test_real_controller_gets_its_own_command_or_refuses_it(words, answers, expected):
    with ScriptedPort(REAL | answers) as real:
        code, text, identity = call(real.port, words)
    assert text.startswith(expected)
    assert (code, identity) == (int('refused' in expected), f'RC90-B, 127.0.0.1:{real.port}')
    assert ('(error 20)' in text) == (answers.get('SetMotorsOn,1') is not None)
    assert {*answers} <= {*real.commands}
    assert real.commands.count('Logout') == 1 - code


@pytest.mark.parametrize(
    ('words', 'disconnects', 'sent'),
    [
        ('motors off', ['SetMotorsOff,1'] * 2, 3),
        ('pause', ['Pause'] * 2, 3),
        ('motors off', ['Sim,identity'], 1),
        ('motors on', ['SetMotorsOn,1'], 1),
    ],
)
def test_only_a_stop_is_repeated_after_a_disconnect(words, disconnects, sent):
    """docs/invariants.md, 7: a busy controller disconnects, perhaps before it has obeyed."""
    (command,) = ACTIONS[words].commands
    answers = {command: f'#{command.split(",")[0]},0'}
    with ScriptedPort(answers, disconnects=disconnects) as real:
        code, text, _ = call(real.port, words)
    assert real.commands.count(command) == sent
    if words == 'motors on':
        assert (code, text[:15]) == (1, 'no controller: ')
    else:
        assert (code, text) == (0, ACTIONS[words].done)


def test_other_protocol_is_reported():
    with ScriptedPort(greeting=b'SSH-2.0-server\r\n') as other:
        code, text, _ = call(other.port, 'motors on')
    assert code == 1
    assert 'is not a reply to Login' in text


def test_password_is_sent_but_not_printed(monkeypatch):
    monkeypatch.setenv('CELL_PASSWORD', 'secret')
    with ScriptedPort({'Login,secret': '!Login,13'}) as real:
        code, text, _ = call(real.port, 'status', '--password-variable=CELL_PASSWORD')
    assert code == 1
    assert real.commands == ['Login,secret']
    assert 'the password is wrong (error 13)' in text
    assert 'secret' not in text


@pytest.mark.parametrize(
    'answer',
    [
        b'#%s,\x1b]0;owned\x07\x9b2J\r\n',
        b'!%s,' + b'9' * 5000 + b'\r\n',
        b'#%s,1,' + b'9' * 5000 + b'\r\n',
        b'#%s,=;,;==,\xff\r\n',
        b'#%s\r\n',
        b'\x1b[2J\x07' * 1000 + b'\r\n',
    ],
    ids=['escapes', 'long error', 'long status', 'separators', 'empty', 'only escapes'],
)
@pytest.mark.parametrize('words', ['status', 'io DI 1', 'estop press'])
def test_malicious_answer_is_printed_harmlessly(answer, words):
    with ScriptedPort(default=answer) as hostile:
        code, text, identity = call(hostile.port, words)
    assert code in (0, 1)
    assert (text + identity).replace('\n', '').isprintable()
    assert len(text) < 20_000


@pytest.mark.parametrize(
    'words',
    ['io DI', 'io DI x', 'io DI -1', 'io DI 3 high', 'io DI 3 on on', 'io DO 3,1 on'],
)
def test_invalid_words_are_a_usage_error(words):
    with pytest.raises(UsageError, match='must be '):
        action(words)


def test_unknown_action_is_refused_with_the_nearest_first():
    with pytest.raises(UsageError, match=r"^'Estop': did you mean estop press or estop release\?"):
        action('Estop')
