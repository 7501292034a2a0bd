# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ports of SPEL+ programs: rejections, limits, and the process on sockets."""

import re
import socket
import struct
import subprocess
import threading

import pytest
from support.controller_harness import SUCCESS, frame, point
from support.sim_process import COMMAND, connect, receive, started
from support.spel_program_harness import SpelProgramHarness

from epson_driver.sim_controller.spel_host.program_network import MAX_UNREAD_BYTES

WAITING = """
Function main
  SetNet #201, "127.0.0.1", 2001, CRLF, NONE, 0
  OpenNet #201 As Server
  WaitNet #201
  Wait 1000
Fend
"""


def test_port_is_refused_unless_open_and_free(caplog):
    made = SpelProgramHarness(WAITING, caplog)
    made.step(0.1)
    with pytest.raises(ConnectionRefusedError, match='has not opened the io port'):
        made.client('io')
    connection, _ = made.client('2001')
    with pytest.raises(ConnectionRefusedError, match='already has a client'):
        made.client('2001')
    connection.closed()
    with pytest.raises(ConnectionRefusedError, match='lost its client'):
        made.client('2001')


def test_port_of_an_ended_task_is_refused_until_reopened(caplog):
    source = """
    Function main
      SetNet #201, "127.0.0.1", 2001, CRLF, NONE, 0
      OpenNet #201 As Server
      WaitNet #201, 0.5
    Fend
    """
    made = SpelProgramHarness(source, caplog)
    made.step(0.1)
    first, peer = made.client('2001')
    made.step(1.0)
    assert made.tasks == []
    assert peer.ended is None  # an accepted client is kept
    first.closed()
    with pytest.raises(ConnectionRefusedError, match='the task that opened the 2001 port has end'):
        made.client('2001')
    made.do('start')
    made.step(0.1)
    made.client('2001')


@pytest.mark.invariant(7)
def test_inv7_client_with_too_many_unread_bytes_is_disconnected(caplog):
    made = SpelProgramHarness(WAITING, caplog)
    made.step(0.1)
    connection, peer = made.client('2001')
    for _ in range(MAX_UNREAD_BYTES // 4096):
        connection.receive(bytes(4096))
    assert peer.ended is None
    connection.receive(b'1')
    assert peer.ended == 'closed'


def test_client_port_without_a_server_waits(caplog):
    source = """
    Function main
      SetNet #201, "127.0.0.1", 2001, CRLF, NONE, 0
      OpenNet #201 As Client
      WaitNet #201, 0.05
      Print TW, ChkNet(201)
    Fend
    """
    made = SpelProgramHarness(source, caplog)
    made.step(0.2)
    assert made.printed == ['-1 -1']


ECHO = """
Function main
  String s$
  SetNet #201, "127.0.0.1", 2001, CRLF, NONE, 0
  OpenNet #201 As Server
  Print "ready"
  Do
    WaitNet #201
    Line Input #201, s$
    Print #201, "you said ", s$
  Loop
Fend
"""


def test_process_serves_the_ports_of_the_shipped_program():
    process, ports = started('--controller', 'spel')
    try:
        pendant = connect(ports['remote'])
        remote = pendant.makefile('rwb', buffering=0)

        def ask(command):
            remote.write(f'${command}\r\n'.encode())
            return remote.readline().decode().strip()

        assert ask('Login') == '#Login,0'
        assert ask('SetMotorsOn,0') == '!SetMotorsOn,20'
        assert ask('Sim,why') == '#Sim,the program runs: stop first'
        for command in ('Stop', 'SetMotorsOn,0', 'Start,0'):
            assert ask(command) == f'#{command.partition(",")[0]},0'
        tasks = dict(item.split('=') for item in ask('Sim,tasks').partition(',')[2].split(';'))
        assert tasks['1'].startswith('main,Normal,')
        assert tasks['65'].startswith('BgMain,background,waits main.prg:')
        state, motion = connect(ports['state']), connect(ports['motion'])
        motion.sendall(point(0, (0.125,), 0.0, 0.2))
        assert receive(motion, 60) == frame(10, 3, SUCCESS, bytes(44))
        while True:
            length, kind = struct.unpack('<2i', receive(state, 8))
            body = receive(state, length - 4)
            if kind == 10 and abs(struct.unpack_from('<f', body, 12)[0] - 0.125) < 1e-5:
                break
        for element in (state, motion, pendant):
            element.close()
    finally:
        process.terminate()
        assert process.wait(60) == 0
        process.stdout.close()


@pytest.mark.slow
def test_process_listens_on_other_ports_of_a_program(tmp_path):
    (tmp_path / 'main.prg').write_text(ECHO)
    process, _ = started(
        '--program', str(tmp_path), '--program-port', '2001=0', stderr=subprocess.PIPE
    )
    try:
        port = None
        for line in process.stderr:
            result = re.search(r'port 2001 of the program is 127\.0\.0\.1:(\d+)', line)
            port = int(result[1]) if result else port
            if 's task 1 main: ready' in line:
                break
        threading.Thread(target=process.stderr.read, daemon=True).start()
        with socket.create_connection(('127.0.0.1', port), timeout=60) as sock:
            sock.sendall(b'hello\r\n')
            assert receive(sock, 17) == b'you said  hello\r\n'
    finally:
        process.terminate()
        assert process.wait(60) == 0
        process.stdout.close()


@pytest.mark.slow
def test_process_reads_the_settings_beside_a_program(tmp_path):
    (tmp_path / 'main.prg').write_text(
        'Function main\n  Tool 1\n  OpenNet #201 As Server\n  WaitNet #201\n'
        '  Print #201, CZ(TLSet(1))\nFend\n'
    )
    (tmp_path / 'spel.yaml').write_text(
        'robot: t3_401s\ntools:\n  1: [0, 0, 20, 0]\nports:\n  201: 192.168.0.1:2000:LF\n'
    )
    options = ('--program-port', '2001=0', '--set', 'ports.201=192.168.0.1:2001:CR')
    process, _ = started('--program', str(tmp_path), *options, stderr=subprocess.PIPE)
    try:
        text = r'port 2001 of the program is 127\.0\.0\.1:(\d+)'
        port = next(int(found[1]) for line in process.stderr if (found := re.search(text, line)))
        threading.Thread(target=process.stderr.read, daemon=True).start()
        with socket.create_connection(('127.0.0.1', port), timeout=60) as sock:
            assert receive(sock, 3) == b'20\r'
    finally:
        process.terminate()
        assert process.wait(60) == 0
        process.stdout.close()


def test_invalid_program_is_refused_with_file_and_line(tmp_path):
    (tmp_path / 'main.prg').write_text('Function main\n  Jumps P1\nFend\n')
    command = ['--program', str(tmp_path)]
    process = subprocess.run(
        [*COMMAND, *command],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert process.returncode == 2
    assert 'main.prg:2' in process.stderr
    assert 'Jumps' in process.stderr


@pytest.mark.slow
def test_occupied_port_is_replaced_by_a_free_one_unless_requested(tmp_path):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        busy = taken.getsockname()[1]
        source = f'Function main\n  SetNet #203, "", {busy}\n  OpenNet #203 As Server\nFend\n'
        (tmp_path / 'main.prg').write_text(source)
        for options, text in (
            ([], rf'port {busy} of the program is 127\.0\.0\.1:(?!{busy}\b)\d+'),
            (['--program-port', f'{busy}={busy}'], 'error 2900 .*OpenNet #203: '),
        ):
            process, _ = started('--program', str(tmp_path), *options, stderr=subprocess.PIPE)
            watchdog = threading.Timer(60.0, process.kill)
            watchdog.start()
            try:
                assert any(re.search(text, line) for line in process.stderr)
            finally:
                watchdog.cancel()
                process.terminate()
                process.communicate()
