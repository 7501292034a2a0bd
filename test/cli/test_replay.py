# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A run with the simulated controller, recorded, and played back by the real executable."""

import asyncio
import contextlib
import shutil
import signal
import subprocess
import sys

import pytest
from support.event_loop import run, until
from support.recorded_run import Recorder, nanoseconds

from epson_driver.cli import replay
from epson_driver.link import Link
from epson_driver.simple_message import CommType, JointTrajPt, Ping, Status
from epson_driver.trace import Trace, open_trace
from epson_driver.trace.player import Player
from epson_driver.trace.recording import read_recording
from epson_driver.trace.script import make_script

COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'replay']
PATIENCE = 60.0
REQUESTS = [Ping(), JointTrajPt(0), Ping(), JointTrajPt(3)]
STATES = 40


class Run:
    """Two links to a controller, real or played, and all that came from it."""

    def __init__(self, motion, state):
        self.replies = []
        self.states = []
        self.motion = Link(
            'motion', '127.0.0.1', motion, on_packet=self._unexpected, on_state=self._changed
        )
        self.state = Link(
            'state', '127.0.0.1', state, on_packet=self.states.append, on_state=self._changed
        )

    @staticmethod
    def _unexpected(packet):
        raise AssertionError(packet)

    def _changed(self, _state, _why):
        pass

    async def go(self, requests, trace_file=None):
        """Connect, see some states, send the requests, each after the reply before it."""
        trace = Trace([self.motion, self.state])
        tasks = [asyncio.create_task(link.run()) for link in (self.motion, self.state)]
        try:
            await until(lambda: self.motion.connected and self.state.connected)
            if trace_file is not None:
                trace.begin(open_trace(str(trace_file.parent), trace_file.name))
            enough = len(self.states) + STATES
            await until(lambda: len(self.states) > enough)
            for message in requests:
                count = len(self.replies)
                self.motion.post(message, lambda packet, _: self.replies.append(packet))
                await until(lambda n=count: len(self.replies) > n)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        trace.end('the run is over', PATIENCE)


@pytest.fixture
def recorded(start, tmp_path):
    """Return the trace of a run, and the run."""
    path = tmp_path / 'run.pcap'
    _, ports = start('--motion', 'ptp')
    a_run = Run(ports['motion'], ports['state'])
    run(a_run.go(REQUESTS, path), real_time=True)
    return path, a_run, ports


@contextlib.contextmanager
def playing(path, *arguments):
    """Start `replay` on free ports; yield it and a run to it."""
    free = ['--motion-port', '0', '--state-port', '0']
    process = subprocess.Popen(
        [*COMMAND, str(path), *free, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        words = process.stdout.readline().split()
        assert words[0] == 'listening', process.stderr.read()
        ports = {name: int(port) for name, port in (word.split('=') for word in words[1:])}
        assert list(ports) == ['motion', 'state']
        yield process, Run(ports['motion'], ports['state'])
    finally:
        process.kill()
        process.communicate()


def test_a_client_that_does_the_same_sees_the_same(recorded):
    path, first, _ = recorded
    with playing(path) as (process, again):
        run(again.go(REQUESTS), real_time=True)
        output, errors = process.communicate(timeout=PATIENCE)
    assert again.replies == first.replies
    seen = {packet.message for packet in first.states}
    assert {type(message) for message in seen} >= {Status}
    assert all(packet.comm_type is CommType.TOPIC for packet in again.states)
    assert {packet.message for packet in again.states} <= seen
    assert process.returncode == 0, errors
    assert 'requests: 4 as recorded (4 to the byte), 0 not recorded, 0 missing' in output
    assert not errors


def test_a_client_that_does_something_else_is_told_apart(recorded):
    path, first, _ = recorded
    with playing(path, '--speed', '2') as (process, again):
        run(again.go([Ping(), JointTrajPt(0, (0.1, *[0.0] * 9))]), real_time=True)
        output, errors = process.communicate(timeout=PATIENCE)
    assert again.replies == first.replies[:2]
    assert process.returncode == 1
    assert '2 as recorded (1 to the byte), 0 not recorded, 2 missing' in output
    assert 'JOINT_TRAJ_PT 0 was recorded with other values' in errors
    assert 'the client closed the motion port before 2 requests' in errors


@pytest.mark.slow
def test_an_unrecorded_request_has_no_answer_and_ctrl_c_ends_with_the_report(recorded):
    path, _, _ = recorded
    with playing(path) as (process, again):

        async def scenario():
            task = asyncio.create_task(again.go([JointTrajPt(9)]))
            await asyncio.to_thread(process.stderr.readline)
            process.send_signal(signal.SIGINT)
            await asyncio.to_thread(process.wait, PATIENCE)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

        run(scenario(), real_time=True)
        output, _ = process.communicate(timeout=PATIENCE)
    assert not again.replies
    assert process.returncode == 1
    assert '0 as recorded (0 to the byte), 1 not recorded, 4 missing' in output


@pytest.mark.parametrize(
    ('content', 'text'),
    [(None, 'No such file'), (b'', 'not a capture'), (bytes(100), 'not a capture')],
    ids=['missing', 'empty', 'garbage'],
)
def test_a_file_that_cannot_be_played_is_refused_with_the_reason(content, text, tmp_path):
    path = tmp_path / 'a.pcap'
    if content is not None:
        path.write_bytes(content)
    ended = subprocess.run(
        [*COMMAND, str(path)], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert ended.returncode == 2
    assert text in ended.stderr
    assert 'Traceback' not in ended.stderr


def test_a_port_in_use_is_told(recorded):
    path, _, ports = recorded  # whose controller still runs
    ended = subprocess.run(
        [*COMMAND, str(path)], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert ended.returncode == 2
    first = next(iter(ports))
    assert f'{first} port 127.0.0.1:{ports[first]}: Address already in use; ' in ended.stderr
    assert '--motion-port' in ended.stderr
    assert 'Traceback' not in ended.stderr


def test_the_recorded_ports_are_the_real_ones(recorded):
    path, _, ports = recorded
    servers = {step.server for step in read_recording(path)}
    assert servers == {('127.0.0.1', ports[name]) for name in ('motion', 'state')}


@pytest.mark.skipif(shutil.which('tshark') is None, reason='tshark is not installed')
@pytest.mark.parametrize(
    'fault',
    [
        '_ws.malformed',
        'tcp.analysis.flags',
        'tcp.checksum.status == 0 || ip.checksum.status == 0',
    ],
)
def test_wireshark_finds_no_fault(fault, recorded):
    path, _, _ = recorded
    checks = ['-o', 'tcp.check_checksum:TRUE', '-o', 'ip.check_checksum:TRUE']

    def matching(rule):
        command = ['tshark', '-r', str(path), *checks, '-Y', rule]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        return ended.stdout

    assert matching(fault) == ''
    assert len(matching('tcp.checksum.status == 1').splitlines()) > STATES


# --- in this process ----------------------------------------------------------------------------


class Listening:
    """What `replay` prints, and the ports in it."""

    def __init__(self, monkeypatch):
        self.lines = []
        monkeypatch.setattr('builtins.print', lambda *words, **_: self.lines.append(words))

    @property
    def ports(self):
        return dict(word.split('=') for word in self.lines[0][1:])


def played(recorder, tmp_path, monkeypatch, client):
    """Play a trace to a client, in virtual time; return what was printed, and the score."""
    script = make_script(read_recording(recorder.write(tmp_path / 'run.pcap')))
    player = Player(script, 1.0, replay._tell)
    said = Listening(monkeypatch)

    async def scenario():
        playing = asyncio.create_task(
            replay._run(player, script, '127.0.0.1', dict.fromkeys(script.ports, 0))
        )
        await until(lambda: said.lines)
        await client(said.ports)
        await playing

    run(scenario())
    return [words[0] for words in said.lines[1:]], player.finish()


@pytest.mark.parametrize('ending', ['closed', 'broken off'])
def test_a_connection_that_the_controller_ended_ends_in_the_same_way(
    ending, tmp_path, monkeypatch
):
    """One that was broken off was closed in order: the driver said another sentence then."""
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    recorder.says(0.1, 11002, Status())
    if ending == 'closed':
        recorder.lose(0.2, 11002)
    else:
        recorder._conversations[11002].reset(nanoseconds(0.2), from_client=False)
    seen = []

    async def client(ports):
        reader, writer = await asyncio.open_connection('127.0.0.1', int(ports['state']))
        try:
            seen.append(len(await reader.read()))
        except ConnectionResetError:
            seen.append('reset')
        writer.close()

    _, score = played(recorder, tmp_path, monkeypatch, client)
    assert seen == (['reset'] if ending == 'broken off' else [44])
    assert (score.sent, score.missing) == (1, 0)


def test_a_client_more_than_recorded_is_let_go_and_what_is_missing_is_said_once(
    tmp_path, monkeypatch
):
    recorder = Recorder()
    for port in (11002, 11000):
        recorder.connect(0.0, port)
    recorder.says(0.1, 11002, Status())
    recorder.lose(0.2, 11002)
    recorder.lose(0.2, 11000)

    async def client(ports):
        one = await asyncio.open_connection('127.0.0.1', int(ports['state']))
        more = await asyncio.open_connection('127.0.0.1', int(ports['state']))
        assert await more[0].read() == b''
        await asyncio.sleep(30.0)
        other = await asyncio.open_connection('127.0.0.1', int(ports['motion']))
        await one[0].read()
        await other[0].read()
        for _, writer in (one, more, other):
            writer.close()

    said, _ = played(recorder, tmp_path, monkeypatch, client)
    (waiting,) = [line for line in said if 'waiting for' in line]
    assert 'motion' in waiting
