# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process `sim_controller`."""

import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.examples import one_in
from support.here import run_here
from support.longer_arm import arm_file
from support.sim_process import FREE, connect, receive

from epson_driver.cli import sim_controller


def remote(port, *commands):
    with connect(port) as sock, sock.makefile('rw', newline='\r\n') as lines:
        answers = []
        for command in ('$Login,', *commands):
            lines.write(command + '\r\n')
            lines.flush()
            answers.append(lines.readline().strip())
        return answers[1:]


def point(sequence, joints, velocity=0.0, duration=0.0):
    return struct.pack('<5i12f', 64, 11, 2, 0, sequence, *joints, 0, 0, 0, 0, velocity, duration)


def ask(sock, frame):
    """Send a point and return its reply code."""
    sock.sendall(frame)
    return struct.unpack_from('<4i', receive(sock, 60))[3]


def children(pid):
    return [int(child) for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]


def running(pid):
    try:
        status = Path(f'/proc/{pid}/stat').read_text()
    except FileNotFoundError:
        return False
    return status.rpartition(')')[2].split()[0] != 'Z'


def until(condition):
    while not condition():
        time.sleep(0.02)


@pytest.mark.parametrize(
    ('number', 'motion'), [(signal.SIGTERM, 'smooth'), (signal.SIGINT, 'ptp')]
)
def test_signal_during_motion_exits_with_0(start, number, motion):
    process, ports = start('--motion', motion)
    planners = children(process.pid)
    assert len(planners) == (motion == 'smooth')
    clients = [connect(port) for port in ports.values() for _ in range(2)]
    assert remote(ports['remote'], '$SetMotorsOn,1') == ['#SetMotorsOn,0']
    clients[0].sendall(point(0, (1.0, 0, 0, 0, 0, 0), 0.01))
    receive(clients[2], 600)
    process.send_signal(number)
    assert process.wait(timeout=120) == 0
    for client in clients:
        client.close()
    assert not any(map(running, planners))


@pytest.mark.quick
@pytest.mark.parametrize(
    'arguments',
    one_in(2, [['--start', '-1.5,0.25,0,0,-0.5,6'], ['--start=-1.5,0.25,0,0,-0.5,6']]),
)
def test_start_option_sets_the_arm_position(start, arguments):
    _, ports = start(*arguments)
    with connect(ports['state']) as sock:
        data = receive(sock, 60)
    assert struct.unpack_from('<5i', data) == (56, 10, 1, 0, 0)
    joints = struct.unpack_from('<10f', data, 20)
    assert joints == pytest.approx((-1.5, 0.25, 0, 0, -0.5, 6, 0, 0, 0, 0), abs=1e-6)


def test_byte_order_and_state_period_can_be_set(start):
    _, ports = start('--byte-order', 'big', '--state-period', '0.02')
    with connect(ports['state']) as sock:
        assert receive(sock, 16) == bytes.fromhex('00000038 0000000a 00000001 00000000')


@pytest.mark.quick
@pytest.mark.parametrize('motion', one_in(2, ['smooth', 'ptp']))
def test_killed_client_stops_the_arm_and_another_can_connect(start, motion):
    _, ports = start('--motion', motion)
    script = (
        'import socket, struct, sys, time\n'
        f's = socket.create_connection(("127.0.0.1", {ports["motion"]}))\n'
        's.sendall(bytes.fromhex(sys.argv[1]))\n'
        'print("sent", flush=True)\n'
        'time.sleep(60)\n'
    )
    assert remote(ports['remote'], '$SetMotorsOn') == ['#SetMotorsOn,0']
    data = point(0, (2.0, 0, 0, 0, 0, 0), 0.01).hex()
    client = subprocess.Popen([sys.executable, '-c', script, data], stdout=subprocess.PIPE)
    client.stdout.readline()
    while remote(ports['remote'], '$GetStatus') != ['#GetStatus,00100000010,0000']:
        time.sleep(0.02)
    client.kill()
    client.communicate()
    while remote(ports['remote'], '$GetMotor,0') != ['#GetMotor,1,0,0']:
        time.sleep(0.02)
    assert remote(ports['remote'], '$GetStatus') == ['#GetStatus,00100000001,0000']
    with connect(ports['motion']) as sock:
        sock.sendall(point(0, (0.0,) * 6))
        assert struct.unpack_from('<4i', receive(sock, 60)) == (56, 10, 3, 2)
        assert remote(ports['remote'], '$SetMotorsOn') == ['#SetMotorsOn,0']
        sock.sendall(point(0, (0.0,) * 6))
        assert struct.unpack_from('<4i', receive(sock, 60)) == (56, 10, 3, 1)


def test_killed_planner_stops_the_arm_and_is_restarted(start):
    process, ports = start('--motion', 'smooth')
    assert remote(ports['remote'], '$SetMotorsOn') == ['#SetMotorsOn,0']
    with connect(ports['motion']) as sock:
        assert ask(sock, point(0, (0.0,) * 6)) == 1
        assert ask(sock, point(1, (2.0, 0, 0, 0, 0, 0), 0.0, 60.0)) == 1
        until(lambda: remote(ports['remote'], '$GetStatus') == ['#GetStatus,00100000010,0000'])
        (planner,) = children(process.pid)
        os.kill(planner, signal.SIGKILL)
        until(lambda: remote(ports['remote'], '$GetStatus') == ['#GetStatus,00100001001,8001'])
        assert remote(ports['remote'], '$Sim,timing')[0].endswith(',1,0')
        until(lambda: children(process.pid) not in ([], [planner]))
        until(lambda: ask(sock, point(0, (0.1, 0, 0, 0, 0, 0))) == 1)
        until(lambda: remote(ports['remote'], '$GetStatus') == ['#GetStatus,00100000001,0000'])
    with connect(ports['state']) as sock:
        assert struct.unpack_from('<f', receive(sock, 60), 20)[0] == pytest.approx(0.1, abs=1e-6)


def test_killed_controller_leaves_no_planner(start):
    process, ports = start('--motion', 'smooth')
    (planner,) = children(process.pid)
    assert remote(ports['remote'], '$SetMotorsOn') == ['#SetMotorsOn,0']
    with connect(ports['motion']) as sock:
        assert ask(sock, point(0, (2.0, 0, 0, 0, 0, 0), 0.01)) == 1
        process.kill()
        process.wait()
    until(lambda: not running(planner))


def test_unread_log_does_not_block_the_controller(start):
    process, ports = start(stderr=subprocess.PIPE)
    refused = point(7, (0.0,) * 6)
    with connect(ports['motion']) as sock:
        for _ in range(30):
            sock.sendall(refused * 100)
            receive(sock, 6000)
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=120) == 0


def test_port_in_use_is_reported_by_name(start):
    _, ports = start()
    arguments = list(FREE)
    arguments[1] = f'--state-port={ports["state"]}'
    result = run_here(sim_controller.main, *arguments)
    assert result.returncode == 1
    assert result.stdout == ''
    assert f'state port 127.0.0.1:{ports["state"]}: Address already in use; ' in result.stderr
    assert '--state-port … (0: any free port)' in result.stderr
    assert 'Traceback' not in result.stderr


@pytest.mark.quick
@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['--start', '-9,0,0,0,0,0'], 'joint_1 = -9 rad is outside the limits -2.96706 … 2.96706'),
        (['--start', '0,90,0,0,0,0'], '1.134464 rad. Angles are in rad: 90° are 1.5708'),
        (['--start', '0,0,0,0,2.5,0'], 'joint_5 = 2.5 rad is outside the limits'),
        (['--start', 'nan,0,0,0,0,0'], 'joint_1 = nan rad is outside'),
        (['--start', '0,0,0'], '3 angles for 6 joints'),
        (['--start', '1,2,three,0,0,0'], 'must be numbers separated by commas'),
        (['--start='], 'must be numbers'),
        (['--start'], 'expected one argument'),
        (['--look-ahead', '0'], 'must be a number from 0.01 to 60 s'),
        (['--look-ahead', 'far'], 'must be a number from 0.01 to 60 s'),
        (['--motion', 'jump'], "'jump': must be smooth, ptp"),
        (['--byte-order', 'middle'], 'must be little, big'),
        (['--robot', 'c9'], r'no robot model c9'),
        (['--controller', 'rc9'], 'no controller profile rc9'),
        (['--robot', '/nowhere/r.yaml'], '/nowhere/r.yaml'),
        (['--motion-port', '70000'], 'must be a port from 0 to 65535'),
        (['--state-period', '0'], 'must be a number from 0.001 to 3600 s'),
        (['--state-period', 'nan'], 'must be a number from 0.001 to 3600 s'),
    ],
)
def test_invalid_argument_exits_with_2_and_a_reason(arguments, text):
    result = run_here(sim_controller.main, *FREE, *arguments)
    assert result.returncode == 2
    assert text in result.stderr
    assert 'Traceback' not in result.stderr


@pytest.mark.quick
def test_robot_with_too_many_joints_is_refused(tmp_path):
    result = run_here(sim_controller.main, *FREE, '--robot', arm_file(tmp_path, 11))
    assert result.returncode == 2
    assert '11 joints: a message carries at most 10' in result.stderr
    assert 'Traceback' not in result.stderr


@pytest.mark.slow
def test_fault_and_look_ahead_options_are_applied(start):
    process, ports = start('--look-ahead', '0.4', '--fault', 'cut:port=state,after=3600')
    (faults,) = remote(ports['remote'], '$Sim,fault,list')
    assert faults.startswith('#Sim,cut')
    assert 'port=state' in faults
    process.terminate()
    assert process.wait(60) == 0


@pytest.mark.quick
@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--define', 'A=1'], '--define: needs a SPEL+ program'),
        (['--set', 'ports.201=:1'], '--set: needs a SPEL+ program'),
        (['--program-port', '2001'], "'2001', PORT=PORT: '': must be a port from 0"),
        (['--program-port', 'x=0'], "'x=0', PORT=PORT: x: must be a port from 1"),
        (['--program-port', '2001=70000'], "'2001=70000', PORT=PORT: 70000: must be a port"),
    ],
)
def test_spel_options_without_a_program_are_rejected(monkeypatch, capsys, words, message):
    monkeypatch.setattr(sys, 'argv', ['sim_controller', *words])
    with pytest.raises(SystemExit, match='2'):
        sim_controller.main()
    assert message in capsys.readouterr().err
