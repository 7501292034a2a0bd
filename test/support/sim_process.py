# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated controllers as processes, and ports without a listener."""

import functools
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable

PATIENCE_S = 120.0
"""Time limit for an event on a busy machine, s."""


def wait_for(condition: Callable[[], object]) -> None:
    """Wait in real time until another thread or process makes a condition true."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@functools.cache
def _bound_socket() -> socket.socket:
    bound = socket.socket()
    # A server of the same test may still listen there later. The kernel never chooses this port
    # for others.
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    bound.bind(('127.0.0.1', 0))
    return bound


def vacant_port() -> int:
    """Return a TCP port of 127.0.0.1 that refuses connections, one per process.

    Another process could start to listen on a free port. This port stays bound as long as the
    process lives, without a listener.
    """
    return int(_bound_socket().getsockname()[1])


COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'sim_controller']
FREE = [f'--{name}-port=0' for name in ('motion', 'state', 'io', 'remote', 'rtmc')]
LINE = re.compile(r'listening motion=(\d+) state=(\d+) io=(\d+) remote=(\d+)\n')
PORTS = ('motion', 'state', 'io', 'remote')


def started(*arguments, stderr=subprocess.DEVNULL):
    """Start a simulated controller, and return the process and its ports by name."""
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
