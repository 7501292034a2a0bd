# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated controllers as processes, and ports that nobody listens on."""

import functools
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable

PATIENCE_S = 120.0
"""How long a busy machine may take for what is waited for, s."""


def wait_for(condition: Callable[[], object]) -> None:
    """Wait in real time until a condition holds that another thread or process makes true."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@functools.cache
def _held() -> socket.socket:
    held = socket.socket()
    # A server of the same test may still listen there later; ports that the kernel chooses for
    # others are never this one.
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(('127.0.0.1', 0))
    return held


def vacant_port() -> int:
    """Return a TCP port of 127.0.0.1 that refuses connections: one for each process.

    A port that was merely free a moment ago may be somebody's server a moment later. This one is
    bound for as long as the process lives, and nobody listens.
    """
    return int(_held().getsockname()[1])


COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'sim_controller']
FREE = ['--motion-port', '0', '--state-port', '0', '--io-port', '0', '--remote-port', '0']
LINE = re.compile(r'listening motion=(\d+) state=(\d+) io=(\d+) remote=(\d+)\n')
PORTS = ('motion', 'state', 'io', 'remote')


def started(*arguments, stderr=subprocess.DEVNULL):
    """Start it; return the process and its ports by name."""
    process = subprocess.Popen(
        [*COMMAND, *FREE, *arguments], stdout=subprocess.PIPE, stderr=stderr, text=True
    )
    assert process.stdout is not None
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
