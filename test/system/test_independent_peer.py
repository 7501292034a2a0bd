# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A program with nothing but Python's standard library talks to the simulated controller."""

import subprocess
import sys
from pathlib import Path

from epson_driver.cli import processes

SCRIPT = r"""
import socket, struct, sys

motion_port, state_port, remote_port = map(int, sys.argv[1:])


def connect(port):
    return socket.create_connection(('127.0.0.1', port), timeout=20)


def read(sock, count):
    data = b''
    while len(data) < count:
        chunk = sock.recv(count - len(data))
        assert chunk, 'closed'
        data += chunk
    return data


def frame(sock):
    length, = struct.unpack('<i', read(sock, 4))
    return struct.unpack('<3i', read(sock, 12)), read(sock, length - 12)


def point(sequence, joints, velocity=0.5, duration=0.5, header=(11, 2, 0)):
    joints = list(joints) + [0.0] * (10 - len(joints))
    return struct.pack('<4ii12f', 64, *header, sequence, *joints, velocity, duration)


def ask(sock, data):
    sock.sendall(data)
    (kind, comm, reply), body = frame(sock)
    assert (kind, comm, len(body)) == (10, 3, 44), (kind, comm, len(body))
    return reply


remote = connect(remote_port)
for command in (b'$Login,', b'$SetMotorsOn,1'):
    remote.sendall(command + b'\r\n')
    answer = remote.recv(100)
    assert answer.startswith(b'#'), answer

state = connect(state_port)
kinds = []
for _ in range(33):
    header, body = frame(state)
    kinds.append(header[0])
    assert header[1:] == (1, 0)
    assert len(body) == {10: 44, 13: 28}[header[0]]
where = kinds.index(13)
assert kinds[where:where + 12] == [13] + [10] * 10 + [13], kinds
state.close()

motion = connect(motion_port)
target = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
assert ask(motion, point(0, (0,) * 6)) == 1
assert ask(motion, point(1, target)) == 1
assert ask(motion, point(7, target)) == 2, 'wrong sequence'
assert ask(motion, point(2, (9.0,) + target[1:])) == 2, 'outside the limits'
assert ask(motion, point(2, (float('nan'),) + target[1:])) == 2, 'not a number'
assert ask(motion, point(2, target, header=(11, 1, 0))) == 2, 'topic'
assert ask(motion, point(2, target)) == 1, 'the next good one'
assert ask(motion, point(-4, ())) == 1, 'stop'
second = connect(motion_port)
assert second.recv(1) == b'', 'a second client is refused'
motion.sendall(struct.pack('<4i', 12, 1, 2, 0))
assert frame(motion) == ((1, 3, 1), b''), 'ping of the C++ library'
motion.sendall(struct.pack('<14i', 52, 1, 2, 0, *[0] * 10))
assert frame(motion)[0] == (1, 3, 1), 'ping of REP-I0006'
motion.sendall(struct.pack('<4i', 12, 77, 2, 0))
assert frame(motion) == ((77, 3, 2), b''), 'unknown request'

state = connect(state_port)
while True:
    header, body = frame(state)
    if header[0] == 10:
        joints = struct.unpack('<i10f', body)[1:7]
        assert all(abs(a - b) < 1e-6 for a, b in zip(joints, target)), joints
        break
print('all as the protocol says')
"""


def test_standard_library_peer(tmp_path: Path) -> None:
    controller = processes.sim_controller(tmp_path / 'controller.log')
    with processes.ended_at_exit(controller):
        ports = controller.ports()
        numbers = [str(port) for port in (ports.motion, ports.state, ports.remote)]
        run = subprocess.run(
            [sys.executable, '-I', '-S', '-c', SCRIPT, *numbers],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert run.returncode == 0, run.stderr + controller.log_text()
        assert 'all as the protocol says' in run.stdout
