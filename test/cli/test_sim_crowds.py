# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process `sim_controller` in a crowd of hostile clients, and the process `pendant` there."""

import re
import socket
import subprocess
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from support.sim_process import COMMAND, FREE, LINE, PORTS, connect, receive

from epson_driver.sim_controller.network.stderr_log import BURST_LINES

PENDANT = [*COMMAND[:-1], 'pendant']
REFUSED = b'x\n$\x1b]0;owned\x07\n$Login,a\n$SetMotorsOn,\x9b9\n' * 500


@pytest.fixture
def crowded(tmp_path):
    """Start a controller with so many descriptors; return its process, ports and log."""
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
    """Open connections that say nothing, and do not wait until they are accepted."""
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
    """Send bytes for ever, over as many connections at once, each opened again when it ends."""
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

    def begin(port, data, connections):
        for _ in range(connections):
            threads.append(threading.Thread(target=flood, args=(port, data)))
            threads[-1].start()

    yield begin
    over.set()
    for thread in threads:
        thread.join()


def descriptors(process):
    return len(list(Path(f'/proc/{process.pid}/fd').iterdir()))


def pressed(port):
    """Press the E-stop as a person does; return what the pendant says."""
    run = subprocess.run(
        [*PENDANT, '--port', str(port), '--timeout', '120', 'estop', 'press'],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return run.returncode, run.stdout + run.stderr


def assert_pressed(port):
    """Press the E-stop, and see that it worked; a controller that hung up then is not named."""
    code, said = pressed(port)
    assert code == 0, said
    assert re.fullmatch(
        rf'E-stop pressed \[(rc620 \(simulated\), c3_a601s, )?127\.0\.0\.1:{port}\]\n', said
    )


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'idle', [64, *(pytest.param(count, marks=pytest.mark.slow) for count in (16, 1000))]
)
def test_invariant_7_idle_clients_do_not_keep_the_pendant_out(crowded, crowd, idle):
    process, ports, log = crowded()
    crowd([ports['remote']], idle)
    assert_pressed(ports['remote'])
    assert descriptors(process) < 64
    assert b'Traceback' not in log.read_bytes()


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    'limit', [32, *(pytest.param(count, marks=pytest.mark.slow) for count in (64, 48))]
)
def test_invariant_9_without_descriptors_left_the_pendant_gets_in_and_no_traceback_is_logged(
    crowded, crowd, limit
):
    process, ports, log = crowded(limit)
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
def test_invariant_7_a_flood_of_refused_commands_neither_fills_the_log_nor_keeps_the_pendant_out(
    crowded, flooding
):
    process, ports, log = crowded()
    flooding(ports['remote'], REFUSED, 16)
    with connect(ports['state']) as state:
        for _ in range(3):
            assert_pressed(ports['remote'])
            receive(state, 6000)
    size = log.stat().st_size
    data = log.read_bytes()
    assert b'there is no command' in data
    assert b'Traceback' not in data
    assert not set(data) & {0x1B, 0x07, 0x9B}
    # a few kinds of lines (connected, gone, makes room, refused), each with its burst and its pace
    assert data.count(b'refused (') <= BURST_LINES + 2 + _seconds(data)
    assert size < 200 * 6 * (BURST_LINES + 2 + _seconds(data))
    assert process.poll() is None


def _seconds(log):
    """Return how long the lines of a log took, s, rounded up."""
    times = [line.split(b',')[0].split(b' ')[1] for line in log.splitlines() if b',' in line]
    first, last = (
        int(hours) * 3600 + int(minutes) * 60 + int(seconds)
        for hours, minutes, seconds in (time.split(b':') for time in (times[0], times[-1]))
    )
    return (last - first) % 86_400 + 1
