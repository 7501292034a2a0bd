# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The pendant's answers, against a simulated controller in the same event loop."""

import asyncio
import socket
import subprocess
import sys
import threading

import pytest

from epson_driver.cli import pendant
from epson_driver.controller.core import Controller
from epson_driver.controller.profile import load_controller_profile
from epson_driver.controller.servers import ControllerServers, Ports
from epson_driver.robots import load_robot_model


@pytest.fixture
def port():
    """Serve a controller from a thread; return its remote port."""
    ready = threading.Event()
    found = []

    async def serve():
        controller = Controller(load_robot_model('c3_a601s'), load_controller_profile('rc620'))
        servers = ControllerServers(controller)
        ports = await servers.open('127.0.0.1', Ports(0, 0, 0, 0))
        end = asyncio.Event()
        found.extend([ports.remote, asyncio.get_running_loop(), end])
        ready.set()
        await end.wait()
        await servers.close()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(60)
    remote, loop, end = found
    yield remote
    loop.call_soon_threadsafe(end.set)
    thread.join()


@pytest.fixture
def ask(port, monkeypatch, capsys):
    def ask_pendant(*words):
        monkeypatch.setattr(sys, 'argv', ['pendant', '--port', str(port), *words])
        code = pendant.main()
        output = capsys.readouterr()
        return code, output.out + output.err

    return ask_pendant


def test_motors_estop_and_reset(ask):
    assert ask('motors', 'on') == (0, 'motors on\n')
    assert 'motors: on\n' in ask('status')[1]
    assert ask('estop', 'press') == (0, 'E-stop pressed\n')
    for words in (('motors', 'on'), ('reset',)):
        code, text = ask(*words)
        assert code == 1
        assert text.startswith('refused: ')
        assert 'release the E-stop, then reset' in text
    code, text = ask('status')
    assert code == 0
    assert 'motors: off\n' in text
    assert 'E-stop: active (release, then reset)\n' in text
    assert 'error:  2261 (the motion task does not exist' in text
    assert ask('estop', 'release')[0] == 0
    assert ask('motors', 'on')[0] == 1
    assert ask('reset')[0] == 0
    assert ask('motors', 'on') == (0, 'motors on\n')
    assert ask('motors', 'off') == (0, 'motors off\n')


def test_status_of_a_controller_that_just_booted(ask):
    code, text = ask('status')
    assert code == 0
    assert text.splitlines() == [
        'motors: off',
        'E-stop: not active',
        'arm:    stands',
        'error:  none',
        'mode:   AUTO',
        'flags:  Auto Ready',
        'late:   0 cycles, 0 plans; 0 plans failed',
    ]


@pytest.mark.parametrize('words', [['motors'], ['motors', 'up'], ['dance'], ['status', 'now']])
def test_words_that_mean_nothing(ask, capsys, words):
    with pytest.raises(SystemExit) as caught:
        ask(*words)
    assert caught.value.code == 2
    assert 'must be one of status, motors on, motors off, estop press' in capsys.readouterr().err


@pytest.mark.parametrize('number', ['0', '70000', '-1', 'five'])
def test_a_port_that_cannot_be(monkeypatch, capsys, number):
    monkeypatch.setattr(sys, 'argv', ['pendant', f'--port={number}', 'status'])
    with pytest.raises(SystemExit) as caught:
        pendant.main()
    assert caught.value.code == 2
    assert f'{number}: must be a port from 1 to 65535' in capsys.readouterr().err


def test_nobody_listens():
    with socket.create_server(('127.0.0.1', 0)) as server:
        free = server.getsockname()[1]
    result = subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'pendant', '--port', str(free), 'status'],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 1
    assert f'127.0.0.1:{free}: Connection refused' in result.stderr
    assert 'Traceback' not in result.stderr


def test_somebody_else_listens(monkeypatch, capsys):
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]

        def serve():
            sock, _ = server.accept()
            with sock:
                sock.sendall(b'SSH-2.0-server\r\n')
                sock.recv(100)

        thread = threading.Thread(target=serve)
        thread.start()
        monkeypatch.setattr(sys, 'argv', ['pendant', '--port', str(port), 'motors', 'on'])
        assert pendant.main() == 1
        thread.join()
    assert 'is no answer to Login' in capsys.readouterr().err


def test_status_of_an_older_firmware(monkeypatch, capsys):
    """Ten flags, without Test, and no GetMotor."""
    answers = {b'$GetStatus': b'#GetStatus,0100000110,4031', b'$GetMotor,0': b'!GetMotor,11'}
    answers[b'$Sim,timing'] = b'!Sim,11'

    async def older_firmware(reader, writer):
        while line := await reader.readline():
            command = line.strip()
            name = command[1:].split(b',')[0]
            writer.write(answers.get(command, b'#' + name + b',0') + b'\r\n')
        writer.close()

    async def main():
        server = await asyncio.start_server(older_firmware, '127.0.0.1', 0)
        status = await pendant._status('127.0.0.1', server.sockets[0].getsockname()[1])
        server.close()
        return status

    text = asyncio.run(main())
    assert 'motors: unknown' in text
    assert 'error:  4031 (motion attempted with the motors off)' in text
    assert 'flags:  Auto Paused Running' in text
    assert 'late' not in text
