# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The trace of real links: complete, in order, and without effect on the links."""

import asyncio
import errno
import logging
import os
import time

import pytest
from support.event_loop import PATIENCE, until
from support.link_harness import Harness, Peer, frame, joints

from epson_driver.link import WireEvent
from epson_driver.simple_message import JointTrajPt
from epson_driver.trace import Trace, TraceError, open_trace
from epson_driver.trace import trace as trace_module
from epson_driver.trace.recording import read_recording

REAL_TIME = True
"""Real time, because a thread writes the trace."""


def bytes_of(steps, event, number=0):
    return b''.join(s.data for s in steps if s.event is event and s.number == number)


def events_of(steps, number=0):
    """Return the events of a connection, without repetitions."""
    events = [step.event for step in steps if step.number == number]
    return [e for i, e in enumerate(events) if i == 0 or e is not events[i - 1]]


async def test_trace_contains_all_bytes_of_all_connections(tmp_path):
    path = tmp_path / 'a.pcap'
    points = []

    async def talk(connection):
        await connection.send(joints(float(connection.number)))
        points.append(await connection.read_frame())
        await connection.send(frame(11, 3, 1))
        if connection.number == 2:
            await connection.stay()

    async with Peer(talk) as peer:
        harness = Harness(peer.port)
        trace = Trace([harness.link])
        before = time.time()
        trace.begin(open_trace(str(path.parent), path.name))
        async with harness:
            for number in (1, 2):
                await until(lambda n=number: len(harness.packets) == n)
                answers = []
                harness.link.post(JointTrajPt(number), lambda *a, to=answers: to.append(a))
                await until(lambda to=answers: to)
        trace.end('the test ends', PATIENCE)
        after = time.time()
        assert harness.link.trace is None
    steps = read_recording(path)
    assert {step.number for step in steps} == {0, 1}
    assert all(step.server == ('127.0.0.1', peer.port) for step in steps)
    for number in (0, 1):
        assert bytes_of(steps, WireEvent.SENT, number) == points[number]
        expected = joints(number + 1.0) + frame(11, 3, 1)
        assert bytes_of(steps, WireEvent.RECEIVED, number) == expected
    usual = ['opened', 'received', 'sent', 'received']
    assert events_of(steps, 0) == [*usual, 'ended', 'closed']
    assert events_of(steps, 1) == [*usual, 'closed']
    times = [step.time for step in steps]
    assert times == sorted(times)
    assert before - 1e-3 <= times[0]
    assert times[-1] <= after


async def test_reset_connection_is_recorded_as_reset(tmp_path):
    async def talk(connection):
        await connection.receive(1)
        connection.reset()

    async with Peer(talk) as peer:
        harness = Harness(peer.port)
        trace = Trace([harness.link])
        trace.begin(open_trace(str(tmp_path), 'a.pcap'))
        async with harness:
            await harness.connected()
            harness.link.post(JointTrajPt(0), lambda *_: None)
            await until(lambda: 'backing_off' in harness.states)
        trace.end('', PATIENCE)
    assert events_of(read_recording(tmp_path / 'a.pcap')) == ['opened', 'sent', 'reset']


async def test_trace_started_within_a_frame_contains_that_frame(tmp_path):
    path = tmp_path / 'a.pcap'
    state = joints(1.0)
    go_on = asyncio.Event()

    async def talk(connection):
        await connection.send(state + state[:20])
        await go_on.wait()
        await connection.send(state[20:])
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: harness.link.statistics.bytes_received == len(state) + 20)
        trace = Trace([harness.link])
        trace.begin(open_trace(str(path.parent), path.name))
        go_on.set()
        await until(lambda: len(harness.packets) == 2)
        trace.end('', PATIENCE)
        assert harness.link.trace is None
    steps = read_recording(path)
    assert bytes_of(steps, WireEvent.RECEIVED) == state
    assert events_of(steps) == ['opened', 'received']  # still open at the end


async def test_trace_ends_at_its_size_limit_with_a_log_line(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    path = tmp_path / 'a.pcap'

    async def talk(connection):
        for _ in range(100):
            await connection.send(joints(1.0))
        await connection.stay()

    async with Peer(talk) as peer:
        harness = Harness(peer.port)
        trace = Trace([harness.link])
        trace.largest = 2000
        trace.begin(open_trace(str(path.parent), path.name))
        assert harness.link.trace is not None
        async with harness:
            await until(lambda: len(harness.packets) == 100)  # the link continues
            assert harness.link.trace is None
            await until(lambda: 'reached its maximum size, 0.002 MB' in caplog.text)
    assert 2000 <= path.stat().st_size < 2000 + 100 * 60
    assert read_recording(path)


class BrokenFile:
    """A file whose writes call `write`, which may fail or block."""

    name = 'broken.pcap'

    def __init__(self, write):
        self.write = write
        self.closed = False

    def close(self):
        self.closed = True


async def test_disk_error_ends_the_trace_but_not_the_link(caplog, monkeypatch):
    monkeypatch.setattr(trace_module, 'WRITE_PERIOD_S', 0.001)

    def full(_data):
        raise OSError(errno.ENOSPC, 'x')

    file = BrokenFile(full)

    async def talk(connection):
        while True:
            await connection.send(joints(1.0))
            await asyncio.sleep(0.001)

    async with Peer(talk) as peer:
        harness = Harness(peer.port)
        trace = Trace([harness.link])
        trace.begin(file)
        async with harness:
            await until(lambda: harness.link.trace is None)
            count = len(harness.packets)
            await until(lambda: len(harness.packets) > count + 3)
            assert harness.link.statistics.connections == 1
    assert file.closed
    assert os.strerror(errno.ENOSPC) in caplog.text


async def test_blocked_disk_does_not_block_the_link(caplog, monkeypatch):
    monkeypatch.setattr(trace_module, 'WRITE_PERIOD_S', 0.001)
    monkeypatch.setattr(trace_module, 'MAX_UNWRITTEN_BYTES', 2000)
    going = trace_module.threading.Event()
    file = BrokenFile(lambda data: going.wait(60) and len(data))

    async def talk(connection):
        for _ in range(200):
            await connection.send(joints(1.0))
            await asyncio.sleep(0)
        await connection.stay()

    async with Peer(talk) as peer:
        harness = Harness(peer.port)
        trace = Trace([harness.link])
        trace.begin(file)
        async with harness:
            await until(lambda: len(harness.packets) == 200)
            assert harness.link.trace is None
    assert 'is too slow' in caplog.text
    going.set()


@pytest.mark.parametrize(
    'name',
    [
        *('/tmp/a', 'b/a', '../a', '..', '.', '.hidden', '~', '~/a', '~nosuchuser/x', 'a\0b'),
        *('a\nb', '%D', '%n'),
    ],
)
def test_trace_file_must_be_in_its_folder(tmp_path, name):
    """Any ROS peer may set trace_file, so it must not reach other files."""
    folder = tmp_path / 'traces'
    with pytest.raises(TraceError, match='must be the name of a file'):
        open_trace(str(folder), name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('folder', 'why'),
    [('', 'trace_folder is empty'), ('~nosuchuser/x', 'home'), ('/dev/null/x', 'Not a directory')],
)
def test_unusable_folder_is_refused_with_the_reason(folder, why):
    with pytest.raises(TraceError, match=why):
        open_trace(folder, 'a.pcap')


@pytest.mark.invariant(7)
def test_existing_file_and_symbolic_link_are_not_followed(tmp_path):
    old, outside = tmp_path / 'old.pcap', tmp_path / 'outside'
    old.write_text('evidence')
    (tmp_path / 'a.pcap').symlink_to(outside)
    for name in ('old.pcap', 'a.pcap'):
        with pytest.raises(TraceError, match=f'cannot create the trace .*{name}: File exists'):
            open_trace(str(tmp_path), name)
    assert old.read_text() == 'evidence'
    assert not outside.exists()


async def test_unexpected_error_ends_the_trace_but_not_the_link(tmp_path, caplog, monkeypatch):
    async def talk(connection):
        await connection.send(joints(1.0))
        await connection.stay()

    async with Peer(talk) as peer:
        harness = Harness(peer.port)
        trace = Trace([harness.link])
        trace.begin(open_trace(str(tmp_path), 'a.pcap'))
        monkeypatch.setattr(Trace, '_record', lambda *_: 1 / 0)
        async with harness:
            await until(lambda: harness.packets)
            assert harness.link.connected
        assert harness.link.trace is None
    assert 'ZeroDivisionError' in caplog.text


@pytest.mark.parametrize('name', ['\ud800', 'a%H\udcff'])
def test_invalid_file_name_is_refused(tmp_path, name):
    with pytest.raises(TraceError, match='trace_file'):
        open_trace(str(tmp_path / 'traces'), name)
    assert not list(tmp_path.iterdir())
