# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated controller under crowds and floods of clients."""

import re
import socket
import struct
import subprocess
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from support.sim_process import COMMAND, FREE, LINE, PORTS, connect, receive

from epson_driver.log_lines import BURST_LINES

PENDANT = [*COMMAND[:-1], 'pendant']
REFUSED = b'x\n$\x1b]0;owned\x07\n$Login,a\n$SetMotorsOn,\x9b9\n' * 500


@pytest.fixture
def crowded(tmp_path):
    """Start a controller with a descriptor limit. Return its process, ports and log."""
    processes = []

    def start_process(descriptors=1024):
        log = tmp_path / 'stderr'
        limited = ['sh', '-c', f'ulimit -n {descriptors}; exec "$@"', 'sh', *COMMAND, *FREE]
        with log.open('wb') as stderr:
            process = subprocess.Popen(
                [*limited, '--motion', 'ptp'], stdout=subprocess.PIPE, stderr=stderr, text=True
            )
        processes.append(process)
        match = LINE.fullmatch(process.stdout.readline())
        assert match
        return process, dict(zip(PORTS, map(int, match.groups()), strict=True)), log

    yield start_process
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def crowd():
    """Open silent connections, without waiting until they are accepted."""
    socks = []

    def connect_all(ports, count):
        for index in range(count):
            sock = socket.socket()
            sock.setblocking(False)
            socks.append(sock)
            with suppress(BlockingIOError):
                sock.connect(('127.0.0.1', ports[index % len(ports)]))

    yield connect_all
    for sock in socks:
        sock.close()


@pytest.fixture
def flooding():
    """Send bytes continuously over several connections, and reconnect when they close."""
    over = threading.Event()
    threads = []

    def flood(port, data):
        while not over.is_set():
            with suppress(OSError), connect(port) as sock:
                sock.settimeout(0.2)
                threading.Thread(target=drained, args=(sock.dup(),), daemon=True).start()
                while not over.is_set():
                    with suppress(TimeoutError):
                        sock.sendall(data)

    def drained(sock):
        with suppress(OSError), sock:
            sock.settimeout(60.0)
            while sock.recv(65_536):
                pass

    def start(port, data, connections):
        for _ in range(connections):
            threads.append(threading.Thread(target=flood, args=(port, data)))
            threads[-1].start()

    yield start
    over.set()
    for thread in threads:
        thread.join()


def descriptors(process):
    return len(list(Path(f'/proc/{process.pid}/fd').iterdir()))


def pressed(port):
    """Press the E-stop with the pendant. Return its exit code and output."""
    run = subprocess.run(
        [*PENDANT, '--port', str(port), '--timeout', '120', 'estop', 'press'],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return run.returncode, run.stdout + run.stderr


def assert_pressed(port):
    """Press the E-stop successfully. The controller may disconnect before its identity."""
    code, text = pressed(port)
    assert code == 0, text
    assert re.fullmatch(rf'E-stop pressed \[(simulated, c3_a601s, )?127\.0\.0\.1:{port}\]\n', text)


@pytest.mark.invariant(7)
@pytest.mark.parametrize('idle', [16, 1000])
def test_inv7_idle_clients_do_not_block_the_pendant(crowded, crowd, idle):
    process, ports, log = crowded()
    crowd([ports['remote']], idle)
    assert_pressed(ports['remote'])
    assert descriptors(process) < 64
    assert b'Traceback' not in log.read_bytes()


@pytest.mark.invariant(9)
def test_inv9_pendant_connects_when_descriptors_are_exhausted(crowded, crowd):
    process, ports, log = crowded(32)
    with connect(ports['state']) as state:
        receive(state, 60)
        crowd(list(ports.values()), 1200)
        for _ in range(3):
            assert_pressed(ports['remote'])
            receive(state, 600)
    lines = log.read_text(encoding='utf-8').splitlines()
    assert not any('Traceback' in line for line in lines)
    assert process.poll() is None


@pytest.mark.invariant(7)
def test_inv7_flood_of_refused_commands_blocks_neither_log_nor_pendant(crowded, flooding):
    process, ports, log = crowded()
    flooding(ports['remote'], REFUSED, 16)
    with connect(ports['state']) as state:
        for _ in range(3):
            assert_pressed(ports['remote'])
            receive(state, 6000)
    size = log.stat().st_size
    data = log.read_bytes()
    assert b'unknown command' in data
    assert b'Traceback' not in data
    assert not set(data) & {0x1B, 0x07, 0x9B}
    # a few kinds of lines (connected, gone, makes room, refused), each with burst and rate limit
    assert data.count(b'refused (') <= BURST_LINES + 2 + _seconds(data)
    assert size < 200 * 6 * (BURST_LINES + 2 + _seconds(data))
    assert process.poll() is None


def _seconds(log):
    """Return the duration of a log, s, rounded up."""
    times = [line.split(b',')[0].split(b' ')[1] for line in log.splitlines() if b',' in line]
    first, last = (
        int(hours) * 3600 + int(minutes) * 60 + int(seconds)
        for hours, minutes, seconds in (time.split(b':') for time in (times[0], times[-1]))
    )
    return (last - first) % 86_400 + 1


BOUND = 12
"""Maximum additional memory during a flood, MiB."""

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
    """Send up to 8 MiB, reconnecting as needed, and read the replies if `reads`.

    The controller reads slowly from a client that uses too much processor time. The flood ends
    then, with all buffers full.
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
@pytest.mark.parametrize(('arguments', 'port'), [(PTP, 'motion'), (SPEL, 'remote')])
def test_inv7_floods_neither_use_memory_nor_stop_the_state(start, arguments, port):
    """The SPEL+ program has one state client, which is this test."""
    process, ports = start(*arguments)
    with connect(ports['state']) as state:
        receive(state, 6000)
        flood(ports[port], FLOODS['requests'], reads=True)  # first-use allocations
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
