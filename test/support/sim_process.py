# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process `sim_controller` on free ports, and plain sockets to it."""

import re
import socket
import subprocess
import sys

COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'sim_controller']
FREE = ['--motion-port', '0', '--state-port', '0', '--io-port', '0', '--remote-port', '0']
LINE = re.compile(r'listening motion=(\d+) state=(\d+) io=(\d+) remote=(\d+)\n')
PORTS = ('motion', 'state', 'io', 'remote')


def started(*arguments, stderr=subprocess.DEVNULL):
    """Start it; return the process and its ports by name."""
    process = subprocess.Popen(
        [*COMMAND, *FREE, *arguments], stdout=subprocess.PIPE, stderr=stderr, text=True
    )
    match = LINE.fullmatch(process.stdout.readline())
    assert match
    return process, dict(zip(PORTS, map(int, match.groups()), strict=True))


def connect(port):
    return socket.create_connection(('127.0.0.1', port), timeout=60)


def receive(sock, count):
    data = b''
    while len(data) < count:
        chunk = sock.recv(count - len(data))
        assert chunk
        data += chunk
    return data
