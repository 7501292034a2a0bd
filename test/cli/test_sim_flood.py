# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Floods of every kind on every port: the memory stays bounded and the state goes on.

docs/controller.md states the bound.
"""

import re
import socket
import struct
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from support.sim_process import connect, receive

BOUND = 12
"""MiB that a flood may add, of any port and size."""

MIB = 2**20
CHUNK = 64 * 1024


def frame(msg_type, comm_type, body):
    return struct.pack('<4i', 12 + len(body), msg_type, comm_type, 0) + body


def trajectory_point(sequence):
    return frame(11, 2, struct.pack('<i12f', sequence, *[0.001 * sequence] * 6, *[0.0] * 6))


READ = frame(65201, 2, struct.pack('<4i', 1, 1, 1, 0))
SUBSCRIBE = frame(65204, 2, struct.pack('<5i', 1, 1, 1, 0, 8))

FLOODS = {
    'garbage': b'\xff' * CHUNK,
    'requests': frame(1, 2, bytes(40)) * (CHUNK // 56),
    'unknown requests': frame(999, 2, bytes(1000)) * (CHUNK // 1016),
    'topics': frame(999, 1, bytes(60_000)),
    'a length that is never filled': struct.pack('<i', 65_000) + bytes(1000),
    'points': b''.join(trajectory_point(i) for i in range(900)),
    'downloads': frame(11, 1, struct.pack('<i12f', -1, *[0.0] * 12)) * 900,
    'readings': READ * (CHUNK // len(READ)),
    'subscriptions': SUBSCRIBE * (CHUNK // len(SUBSCRIBE)),
    'commands': b'$Login\r\n$GetStatus\r\n$Execute,"Print CtrlInfo(1)"\r\n' * 1000,
    'faults': b'$Login\r\n' + b'$Sim,fault,delay,after=3600\r\n$Sim,fault,clear\r\n' * 1000,
    'a line without end': b'$' + b'x' * CHUNK,
}


def resident(pid):
    """Return the memory of a process, MiB."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    return int(re.search(r'VmRSS:\s+(\d+) kB', status).group(1)) / 1024


def flood(port, data, reads):
    """Send up to 8 MiB over as many connections as it takes; read what comes, or do not.

    A client that uses more than its share of the processor is listened to slowly: the flood is
    over then, with all buffers full.
    """
    sent = 0
    for _ in range(20):
        with suppress(ConnectionError), connect(port) as sock:
            sock.settimeout(1.0)
            if reads:
                threading.Thread(target=read_all, args=(sock,), daemon=True).start()
            try:
                while sent < 8 * MIB:
                    sock.sendall(data)
                    sent += len(data)
            except TimeoutError:
                return


def read_all(sock):
    with suppress(OSError):
        while sock.recv(CHUNK):
            pass


PTP = ('--motion', 'ptp')
SPEL = ('--controller', 'spel')


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    ('arguments', 'port'),
    [
        (PTP, 'motion'),
        *(pytest.param(PTP, name, marks=pytest.mark.slow) for name in ('state', 'io', 'remote')),
        *(pytest.param(SPEL, name, marks=pytest.mark.slow) for name in ('motion', 'io', 'remote')),
    ],
)
def test_invariant_7_floods_do_not_add_memory_and_the_state_goes_on(start, arguments, port):
    """The SPEL+ program has one state client, who sees here that the state goes on."""
    process, ports = start(*arguments)
    with connect(ports['state']) as state:
        receive(state, 6000)
        flood(ports[port], FLOODS['requests'], reads=True)  # what a first use allocates
        before = resident(process.pid)
        for name, data in FLOODS.items():
            for reads in (True, False):
                flood(ports[port], data, reads)
                grown = resident(process.pid) - before
                assert process.poll() is None, name
                assert grown < BOUND, f'{name}: {grown:.0f} MiB'
                state.settimeout(60.0)
                with suppress(BlockingIOError):
                    while len(state.recv(MIB, socket.MSG_DONTWAIT)) == MIB:
                        pass
                receive(state, 60)
