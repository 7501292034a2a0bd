# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The SPEL+ program in processes: cuts, stops, slow readers, a second client, I/O."""

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from support.cell import LASTS, START, Cell, cell_with
from support.ros_peer import PATIENCE, trajectory
from test_io import DI, DO, IoPeer
from test_motion_primitives import GRIPPER, OPEN, Gripper

pytestmark = pytest.mark.slow

FAR = [1.5, *START[1:]]
CALLS = 40
TIMES = pytest.mark.parametrize('times', [5, pytest.param(20, marks=pytest.mark.soak)])
PORTS = ('', 'port=motion', 'port=state')


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One cell with the SPEL+ program and a gripper."""
    one = cell_with(tmp_path_factory.mktemp('cell'), 'spel', io_timeout=1.0, **GRIPPER)
    try:
        yield one.ready()
    finally:
        one.close()


def started_motion(cell: Cell) -> Any:
    """Start a goal of a minute, and return it once the arm moves."""
    peer = cell.peer
    here = peer.position()
    target = FAR if here[0] < 0.75 else [-FAR[0], *FAR[1:]]
    goal = peer.goal(trajectory((LASTS, target)))
    peer.wait_for_motion()
    return goal


def enabled(cell: Cell) -> None:
    """Enable the arm, and retry until both links are connected after a cut."""
    until = time.monotonic() + PATIENCE
    while not (answer := cell.peer.call('enable'))[0]:
        assert time.monotonic() < until, answer
        time.sleep(0.2)


@TIMES
@pytest.mark.invariant(3, 4)
def test_inv4_nothing_moves_after_a_cut_until_enable(cell: Cell, times: int) -> None:
    random = np.random.default_rng(1)
    enabled(cell)
    for cut in range(times):
        goal = started_motion(cell)
        time.sleep(random.uniform(0.0, 0.5))
        words = filter(None, (PORTS[cut % 3], f'for={random.uniform(0.1, 1.0):.2f}'))
        cell.pendant('fault', 'cut', *words)
        ended, _, text = goal.result()
        assert ended == 'aborted', text
        cell.peer.wait_for(lambda: 'connected' in cell.peer.link_states[-1:], 'the links')
        there = cell.peer.wait_until_still()
        ended, _, text = cell.peer.goal(trajectory((1.0, START))).result()
        assert (ended, 'enable' in text) == ('aborted', True), text
        np.testing.assert_array_equal(cell.peer.assert_still(), there)
        enabled(cell)
        np.testing.assert_array_equal(cell.peer.assert_still(), there)


@TIMES
@pytest.mark.invariant(4)
def test_inv4_arm_rests_after_stop_and_the_next_goal_succeeds(cell: Cell, times: int) -> None:
    random = np.random.default_rng(2)
    enabled(cell)
    for _ in range(times):
        goal = started_motion(cell)
        time.sleep(random.uniform(0.0, 0.5))
        success, text = cell.peer.call('stop')
        assert success, text
        assert goal.result()[0] == 'aborted'
        cell.peer.assert_still()
    assert cell.peer.goal(trajectory((3.0, START))).result()[0] == 'succeeded'


def unread(port: int) -> socket.socket:
    """Return a connection that is never read, with a minimal receive buffer."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    connection.settimeout(PATIENCE)
    connection.connect(('127.0.0.1', port))
    return connection


def test_unread_connections_do_not_block_the_driver(cell: Cell) -> None:
    enabled(cell)
    ports = cell.ports
    slow = [unread(port) for port in (ports.state, ports.motion, ports.io) for _ in range(2)]
    try:
        ended, _, text = cell.peer.goal(trajectory((3.0, FAR))).result()
        assert ended == 'succeeded', text
        assert cell.peer.goal(trajectory((3.0, START))).result()[0] == 'succeeded'
    finally:
        for connection in slow:
            connection.close()
    cell.peer.assert_still()


def test_second_motion_client_is_ignored(cell: Cell) -> None:
    enabled(cell)
    point = struct.pack('<4i i 10f 2f', 64, 11, 2, 0, 0, 0.5, *[0.0] * 9, 1.0, 1.0)
    with closing(unread(cell.ports.motion)) as second:
        second.setblocking(False)
        there = cell.peer.position()
        for _ in range(30):
            try:
                second.send(point)
            except BlockingIOError:
                continue
            except OSError:
                break
        np.testing.assert_array_equal(cell.peer.assert_still(), there)
        ended, _, text = cell.peer.goal(trajectory((2.0, FAR))).result()
        assert ended == 'succeeded', text


def test_io_and_gripper_answer_every_call_during_cuts(cell: Cell) -> None:
    """A failed write may have taken effect, so the output is read back at the end."""
    random = np.random.default_rng(3)
    peer = IoPeer(cell.domain)
    over = threading.Event()

    def cut() -> None:
        while not over.wait(random.uniform(0.3, 1.0)):
            cell.pendant('fault', 'cut', f'for={random.uniform(0.1, 0.4):.2f}')

    gripper = Gripper(cell)
    cutter = threading.Thread(target=cut)
    cutter.start()
    try:
        done = failed = call = 0
        until = time.monotonic() + PATIENCE
        while min(done, failed) < CALLS:  # one cut fails hundreds of calls
            assert time.monotonic() < until, (done, failed)
            call += 1
            read, written = peer.read((DI, 3)), peer.write((DO, 0, call % 2))
            for answer in (read, written):
                assert answer.success == (answer.message == ''), answer
                done, failed = done + answer.success, failed + (not answer.success)
            handle = gripper.send(OPEN if call % 2 else 0.0)
            if handle.accepted:
                handle.cancel_goal_async()
                gripper.result(handle)
    finally:
        over.set()
        cutter.join()
    try:
        peer.wait_until_valid()
        until = time.monotonic() + PATIENCE
        while not peer.write((DO, 0, 1)).success:
            assert time.monotonic() < until
        assert peer.read((DO, 0)).points[0].value == 1
    finally:
        peer.close()
