# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ports of a SPEL+ program: servers in SPEL+, lost clients, garbage, the real process."""

import logging
import re
import socket
import struct
import subprocess
import threading

import numpy as np
import pytest
from support.controller_harness import split
from support.sim_process import COMMAND, connect, receive, started
from support.spel_program_harness import SpelProgramHarness

from epson_driver.sim_controller.spel_host.program_network import MAX_UNREAD_BYTES

BYTES = """
Global Integer g_out(63)

' Whole numbers below 2^24 as binary32, little endian: all that these tests need.
Function PutReal(at As Integer, whole As Long)
  Integer e
  Long m, sign
  For e = 0 To 3
    g_out(at + e) = 0
  Next
  If whole = 0 Then Exit Function
  sign = 0
  If whole < 0 Then sign = 128; whole = -whole
  m = whole; e = 150
  Do While m < 8388608
    m = m * 2; e = e - 1
  Loop
  g_out(at) = m And 255
  g_out(at + 1) = RShift(m, 8) And 255
  g_out(at + 2) = (RShift(m, 16) And 127) + (e And 1) * 128
  g_out(at + 3) = sign + RShift(e, 1)
Fend
"""

STATE = """
Function StateServer
  Integer i
  OnErr GoTo lost
reopen:
  CloseNet #201
  SetNet #201, "127.0.0.1", 11002, CRLF, NONE, 0
  OpenNet #201 As Server
  WaitNet #201
  For i = 0 To 59
    g_out(i) = 0
  Next
  g_out(0) = 56; g_out(4) = 10; g_out(8) = 1
  Do
    For i = 1 To 6
      PutReal(20 + 4 * (i - 1), RealPls(i))
    Next
    WriteBin #201, g_out(), 60
    Wait 0.01
  Loop
lost:
  EResume reopen
Fend
"""

MOTION = """
Function MotionServer
  Integer b(3), length
  OnErr GoTo lost
reopen:
  g_lost = g_lost + 1
  MemOn 1
  CloseNet #202
  SetNet #202, "127.0.0.1", 11000, CRLF, NONE, 0
  OpenNet #202 As Server
  WaitNet #202
  MemOff 1
  Do
    ReadBin #202, b(), 4
    If b(0) <> 1 Or b(1) <> 2 Then
      Print "garbage", b(0)
      GoTo reopen
    EndIf
    g_degrees(g_head) = b(2)
    If b(3) = 1 Then MemOn 2
    g_head = g_head + 1
    WriteBin #202, b(), 4
  Loop
lost:
  EResume reopen
Fend
"""

MAIN = """
Global Integer g_degrees(255), g_head, g_lost

Function BgMain
  Xqt 66, MotionServer
  Xqt 67, StateServer
Fend

Function main
  Integer tail
  tail = g_head
  Till MemSw(1) = On
  Power High
  Speed 20; Accel 20, 20
  Do
    Wait g_head <> tail
    Power High
    If g_head > tail + 1 Then
      Go AglToPls(g_degrees(tail), 0, 0, 0, 0, 0) CP Till
    Else
      Go AglToPls(g_degrees(tail), 0, 0, 0, 0, 0) Till
    EndIf
    If TillOn Then
      Print "stopped"
      tail = g_head
    Else
      tail = tail + 1
    EndIf
  Loop
Fend
"""
FILES = {'bytes': BYTES, 'state': STATE, 'motion': MOTION}


@pytest.fixture(autouse=True)
def _all_is_logged(caplog):
    caplog.set_level(logging.INFO)


def going(*degrees):
    return b''.join(bytes([1, 2, each, 0]) for each in degrees)


def harness(caplog):
    made = SpelProgramHarness(MAIN, caplog, **FILES)
    made.do('motors on')
    made.step(0.1)
    return made


def joints(peer):
    """Return the joints of the state messages since the last call, in pulses."""
    messages = split(peer.take())
    assert all(each[:3] == (10, 1, 0) for each in messages)
    return [struct.unpack_from('<6f', body, 4) for *_, body in messages]


def test_points_move_the_arm_smoothly_and_the_state_port_tells_where_it_is(caplog):
    made = harness(caplog)
    state, state_peer = made.client('state')
    motion, peer = made.client('motion')
    assert state_peer.ended is None
    motion.receive(going(10, 20, 30))
    made.until(lambda: len(peer.got) == 12)
    assert peer.take() == going(10, 20, 30)
    made.until(lambda: abs(made.position[0] - np.radians(30.0)) < 1e-9)
    made.step(0.1)
    sent = joints(state_peer)
    pulses = made.controller.model.pulses_per_unit
    assert sent[-1] == pytest.approx(np.rint(made.position * pulses), abs=1e-6)
    first = np.array(made.positions)[:, 0]
    passing = (first > np.radians(5.0)) & (first < np.radians(25.0))
    assert np.diff(first)[passing[:-1]].min() > 0.0  # it does not stop on its way
    velocity, acceleration = made.within_limits()
    assert velocity <= 1.001
    assert acceleration <= 1.01
    state.closed()


@pytest.mark.invariant(3)
def test_a_lost_motion_client_stops_the_arm_and_the_port_serves_the_next_one(caplog):
    """Invariant: nothing moves any more for a client that is gone."""
    made = harness(caplog)
    motion, _ = made.client('motion')
    motion.receive(going(90))
    made.until(lambda: made.position[0] > 0.1)
    motion.closed()
    with pytest.raises(ConnectionRefusedError, match='lost its client'):
        made.client('motion')
    made.until(lambda: 'stopped' in made.printed)
    made.step(0.2)
    stands = made.position
    assert stands[0] < np.radians(80.0)
    motion, peer = made.client('motion')
    made.step(1.0)
    assert np.array_equal(made.position, stands)
    motion.receive(going(5))
    made.until(lambda: abs(made.position[0] - np.radians(5.0)) < 1e-9)
    assert peer.got == going(5)


@pytest.mark.invariant(7)
def test_garbage_moves_nothing_and_the_next_client_is_served(caplog):
    made = harness(caplog)
    motion, peer = made.client('motion')
    motion.receive(b'\xff' * 64)
    made.until(lambda: peer.ended is not None)
    motion.closed()
    made.step(0.5)
    assert made.printed == ['garbage 255']
    assert not np.any(np.diff(made.positions, axis=0))
    motion, _ = made.client('motion')
    motion.receive(going(3))
    made.until(lambda: abs(made.position[0] - np.radians(3.0)) < 1e-9)


@pytest.mark.invariant(4)
def test_background_tasks_survive_an_estop_and_the_state_port_goes_on(caplog):
    made = harness(caplog)
    _, state = made.client('state')
    motion, _ = made.client('motion')
    motion.receive(going(90))
    made.until(lambda: made.position[0] > 0.1)
    made.do('E-stop press')
    made.step(1.0)
    state.take()
    made.step(0.5)
    assert len(joints(state)) > 10
    stands = made.position
    motion.receive(going(5))
    made.do('E-stop release', 'reset', 'motors on')
    made.step(1.0)
    assert np.array_equal(made.position, stands)
    made.do('start')
    made.step(1.0)
    assert np.array_equal(made.position, stands)  # what came before the start is not moved to
    motion.receive(going(5))
    made.until(lambda: abs(made.position[0] - np.radians(5.0)) < 1e-9)


def test_a_port_that_the_program_has_not_opened_refuses_and_one_client_is_all(caplog):
    made = harness(caplog)
    with pytest.raises(ConnectionRefusedError, match='has not opened the io port'):
        made.client('io')
    made.client('motion')
    with pytest.raises(ConnectionRefusedError, match='has a client already'):
        made.client('motion')


def test_the_port_of_a_task_that_has_ended_takes_no_client_until_it_is_opened_again(caplog):
    """Invariant: nobody is let in whom nothing will ever answer."""
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
    assert peer.ended is None  # it was let in, and is not thrown out
    first.closed()
    with pytest.raises(ConnectionRefusedError, match='the task that opened the 2001 port has end'):
        made.client('2001')
    made.do('start')
    made.step(0.1)
    made.client('2001')


@pytest.mark.invariant(7)
def test_a_client_that_is_not_read_is_cut_off_and_memory_stays_bounded(caplog):
    source = """
    Function main
      SetNet #201, "127.0.0.1", 2001, CRLF, NONE, 0
      OpenNet #201 As Server
      WaitNet #201
      Wait 1000
    Fend
    """
    made = SpelProgramHarness(source, caplog)
    made.step(0.1)
    connection, peer = made.client('2001')
    for _ in range(MAX_UNREAD_BYTES // 4096):
        connection.receive(bytes(4096))
    assert peer.ended is None
    connection.receive(b'1')
    assert peer.ended == 'closed'


def test_a_client_without_anybody_who_listens_waits(caplog):
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


def test_two_runs_send_the_same_bytes(caplog):
    sent = []
    for _ in range(2):
        made = harness(caplog)
        _, state = made.client('state')
        motion, peer = made.client('motion')
        motion.receive(going(10, 20))
        made.step(1.0)
        sent.append((bytes(state.got), bytes(peer.got)))
    assert sent[0] == sent[1]
    assert all(sent[0])


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


def test_the_process_serves_real_sockets(tmp_path):
    for name, text in {**FILES, 'main': MAIN}.items():
        (tmp_path / f'{name}.prg').write_text(text)
    process, ports = started('--program', str(tmp_path))
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
        tasks = dict(each.split('=') for each in ask('Sim,tasks').partition(',')[2].split(';'))
        assert tasks['1'].startswith('main,Normal,waits main.prg:')
        assert tasks['66'].startswith('MotionServer,background,waits motion.prg:')
        state, motion = connect(ports['state']), connect(ports['motion'])
        motion.sendall(going(4, 8))
        assert receive(motion, 8) == going(4, 8)
        final = None
        while final is None or final[0] == 0.0 or final != receive_joints(state):
            final = receive_joints(state)
        assert ask('Sim,print,Agl(1)') == '#Sim,8'
        for each in (state, motion, pendant):
            each.close()
    finally:
        process.terminate()
        assert process.wait(60) == 0
        process.stdout.close()


def receive_joints(sock):
    return struct.unpack_from('<6f', receive(sock, 60), 20)


def test_the_process_listens_where_the_program_opens_other_ports(tmp_path):
    (tmp_path / 'main.prg').write_text(ECHO)
    process, _ = started(
        '--program', str(tmp_path), '--program-port', '2001=0', stderr=subprocess.PIPE
    )
    try:
        port = None
        for line in process.stderr:
            found = re.search(r'port 2001 of the program is 127\.0\.0\.1:(\d+)', line)
            port = int(found[1]) if found else port
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


def test_a_program_with_faults_is_refused_with_file_and_line(tmp_path):
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
def test_a_port_that_another_program_has_becomes_any_free_one_unless_one_was_asked_for(tmp_path):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        busy = taken.getsockname()[1]
        source = f'Function main\n  SetNet #203, "", {busy}\n  OpenNet #203 As Server\nFend\n'
        (tmp_path / 'main.prg').write_text(source)
        for asked, said in (
            ([], rf'port {busy} of the program is 127\.0\.0\.1:(?!{busy}\b)\d+'),
            (['--program-port', f'{busy}={busy}'], 'error 2900 .*OpenNet #203: '),
        ):
            process, _ = started('--program', str(tmp_path), *asked, stderr=subprocess.PIPE)
            patience = threading.Timer(60.0, process.kill)
            patience.start()
            try:
                assert any(re.search(said, line) for line in process.stderr)
            finally:
                patience.cancel()
                process.terminate()
                process.communicate()
