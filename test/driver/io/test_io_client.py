# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O client with each backend, against simulated controllers and faulty servers."""

import asyncio
import contextlib
import logging
import random
import re
import struct
from dataclasses import replace

import pytest
from support.driver_harness import Harness, simulated
from support.event_loop import now, until
from support.sim_process import vacant_port

from epson_driver.driver.io.io_client import MAX_POINTS, make_io
from epson_driver.driver.io.points import (
    IoUnavailableError,
    PointReply,
    ranges_of,
    rejection,
    sentence,
)
from epson_driver.driver.stopping.motors import Action, RemoteEthernetMotors
from epson_driver.profiles import load_controller_profile
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.client import RemoteTurns
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    ByteOrder,
    IoAddress,
    IoRange,
    IoResult,
    IoSetting,
)

DI, DO, AI, AO, GI, GO, FLAG = range(1, 8)
INFO, READ, WRITE = range(65200, 65203)
SUCCESS, FAILURE = 1, 2

EVERY = pytest.mark.parametrize('profile', ['simulated', 'remote', 'motoman'])


class Client:
    """The I/O of a driver, and its reported states: the values, or the reason for their lack."""

    def __init__(
        self,
        port,
        *,
        profile=None,
        timeout=1.0,
        dialect=LITTLE_ENDIAN,
        byte_order=None,
        turns=None,
    ):
        self.io = make_io(
            profile or load_controller_profile('simulated').io,
            '127.0.0.1',
            (port, port),
            byte_order=byte_order,
            timeout=timeout,
            turns=turns or RemoteTurns(),
        )
        if dialect is not None:
            self.io.follow(dialect)
        self.reports = []
        self.io.on_states = self._report

    def _report(self):
        self.reports.append(self.io.reason or self.values)

    @property
    def values(self):
        return {(item.io_type, item.start): item.values for item in self.io.states}

    async def __aenter__(self):
        self._task = asyncio.create_task(self.io.run())
        return self

    async def __aexit__(self, *_):
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task

    async def known(self):
        await until(lambda: self.io.states)

    async def rejection(self, *addresses):
        """Return why a read is refused."""
        with pytest.raises(IoUnavailableError) as error:
            await self.io.read([IoAddress(*address) for address in addresses or [(DI, 0)]])
        return str(error.value)


def frame(msg_type, *words, comm_type=3, reply_code=SUCCESS):
    length = 12 + 4 * len(words)
    return struct.pack(f'<{4 + len(words)}i', length, msg_type, comm_type, reply_code, *words)


def readings(message_id, words, value):
    """Return the reply to a READ, with value(index) for each of its points."""
    points = list(zip(words[1::2], words[2::2], strict=True))
    items = [word for kind, index in points for word in (kind, index, 1, value(index))]
    return frame(READ, message_id, 0, len(points), *items)


class ScriptedServer:
    """A server scripted by `answer(number, msg_type, message_id, words)`.

    The answer is the bytes to send, or None to close the connection. `requests` are
    (msg_type, words) of all connections.
    """

    def __init__(self, answer):
        self._answer = answer
        self._tasks = set()
        self.requests = []
        self.writers = []

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._attend, '127.0.0.1', 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_):
        self._server.close()
        for writer in self.writers:
            writer.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _attend(self, reader, writer):
        self._tasks.add(asyncio.current_task())
        self.writers.append(writer)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                (length,) = struct.unpack('<i', await reader.readexactly(4))
                words = struct.unpack(f'<{length // 4}i', await reader.readexactly(length))
                self.requests.append((words[0], words[3:]))
                data = self._answer(len(self.requests), words[0], words[3], words[4:])
                if data is None:
                    break
                writer.write(data)
        writer.close()


def four_inputs(_number, msg_type, message_id, words):
    """Answer like a controller with four digital inputs, whose values are 0 0 0 1."""
    if msg_type == INFO:
        return frame(INFO, message_id, 0, 1, DI, 0, 4, 2)
    return readings(message_id, words, lambda index: int(index == 3))


def is_user_read(msg_type, words):
    """Return whether a user sent the request, because the client itself reads all four inputs."""
    return msg_type == READ and words[0] != 4


@contextlib.asynccontextmanager
async def cell(profile, **options):
    """Run a client with a simulated controller until it knows the values; yield both."""
    async with simulated(profile=profile) as (controller, ports):
        io_profile = load_controller_profile(profile).io
        port = ports.remote if io_profile.access == 'remote_ethernet' else ports.io
        async with Client(port, profile=io_profile, **options) as client:
            await client.known()
            yield client, controller


# --- with the simulated controller ------------------------------------------------------------


@pytest.mark.parametrize('dialect', [LITTLE_ENDIAN, BIG_ENDIAN])
async def test_io_values_are_reported_initially_and_on_change(dialect):
    async with (
        simulated(dialect) as (controller, ports),
        Client(ports.io, dialect=dialect) as client,
    ):
        await client.known()
        assert client.values[DI, 0] == (0,) * 24
        assert client.values[DO, 0] == (0,) * 16
        await asyncio.sleep(0.3)  # polled values are unchanged
        assert len(client.reports) == 1
        controller.io.set_input(DI, 3, 1)
        await until(lambda: len(client.reports) > 1)
        assert client.values[DI, 0][3] == 1
        assert client.values[GI, 0][0] == 8
        await asyncio.sleep(0.3)
        assert len(client.reports) == 2


@pytest.mark.parametrize(
    'profile', ['simulated', 'spel', 'remote', 'generic', 'fanuc', 'abb', 'motoman']
)
async def test_driver_io_works_with_every_profile(profile):
    io_profile = load_controller_profile(profile).io
    async with (
        simulated(profile=profile) as (controller, ports),
        Harness(ports, io_port=ports.io, io=io_profile) as harness,
    ):
        io = harness.driver.io
        await until(lambda: io.states)
        (answer,) = await io.write([IoSetting(DO, 2, 1)])
        assert answer.text == ''
        assert controller.io.read(DO, 2) == 1
        (answer,) = await io.read([IoAddress(DO, 2)])
        assert (answer.value, answer.text) == (1, '')


async def test_every_request_ends_if_the_connection_is_cut():
    """Pending requests return a value or a reason if the link is cut at a random time."""
    times = random.Random(11)

    async def read(io):
        try:
            (answer,) = await io.read([IoAddress(DI, 3)])
        except IoUnavailableError as error:
            return str(error)
        return answer.value

    async with simulated() as (_, ports), Client(ports.io) as client:
        for _cut in range(20):
            await client.known()
            reads = [asyncio.create_task(read(client.io)) for _ in range(5)]
            await asyncio.sleep(times.uniform(0.0, 0.004))
            client.io.link.transport.abort()
            for answer in await asyncio.gather(*reads):
                assert answer == 0 or 'no I/O link' in answer
            await until(lambda: not client.io.states)
        await client.known()
        assert [isinstance(r, dict) for r in client.reports] == [True, False] * 20 + [True]


@pytest.mark.invariant(6)
async def test_inv6_values_are_unknown_while_the_io_server_is_stopped_by_an_estop():
    async with simulated() as (controller, ports), Client(ports.io, timeout=0.3) as client:
        await client.known()
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: not client.io.states)
        (reason,) = client.reports[1:]
        assert 'its I/O server is stopped (E-stop' in reason
        assert reason == await client.rejection()
        with pytest.raises(IoUnavailableError, match='refused'):
            await client.io.write([IoSetting(DO, 0, 1)])
        await asyncio.sleep(1.0)
        assert len(client.reports) == 2
        controller.apply(Event.ESTOP_RELEASE)
        controller.apply(Event.RESET)
        await client.known()
        assert client.reports[2] == client.values
        assert client.io.link.statistics.connections == 1  # a new one would reset the outputs


# --- controllers without I/O, and faulty ones -------------------------------------------------


@pytest.mark.parametrize(
    ('greeting', 'reason'), [(b'', 'closed by'), (b'SSH-2.0-OpenSSH_9.6\r\n', 'length')]
)
async def test_server_without_io_messages_is_reported_once(greeting, reason, caplog):
    caplog.set_level(logging.INFO)

    async def greet(_reader, writer):
        writer.write(greeting)
        with contextlib.suppress(ConnectionError):
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(greet, '127.0.0.1', 0)
    async with server, Client(server.sockets[0].getsockname()[1]) as client:
        await until(lambda: client.io.link.statistics.connections >= 4)
        (report,) = client.reports
        assert reason in report
        if greeting:
            assert client.io.link.statistics.bad_frames['length'] >= 3
    assert len(caplog.messages) == 1


async def test_server_without_io_is_polled_less_and_reported_once(caplog):
    caplog.set_level(logging.INFO)

    rejection = frame(INFO, reply_code=FAILURE)
    async with ScriptedServer(lambda *_: rejection) as server, Client(server.port) as client:
        await until(lambda: len(server.requests) == 3)
        start = now()
        await until(lambda: len(server.requests) == 4)
        assert now() - start > 0.9
        assert len(client.reports) == 1
        assert 'does not support I/O requests' in client.reports[0]
        assert client.io.link.statistics.connections == 1
    assert len(caplog.messages) == 1


async def test_late_reply_does_not_answer_the_next_request():
    """The reply to the first read arrives after its timeout, with the reply to the second."""
    late = []

    def answer(number, msg_type, message_id, words):
        if not is_user_read(msg_type, words):
            return four_inputs(number, msg_type, message_id, words)
        late.append(frame(READ, message_id, 0, 1, DI, 3, 1, len(late)))
        return b'' if len(late) == 1 else late[0] + late[1]

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        assert await client.rejection((DI, 3)) == 'no reply from the I/O server within 0.2 s'
        (second,) = await client.io.read([IoAddress(DI, 3)])
        assert second.value == 1
        assert client.io.link.statistics.unsolicited_replies == 1


async def test_simultaneous_requests_are_sent_in_sequence():
    requests = []

    def answer(number, msg_type, message_id, words):
        if is_user_read(msg_type, words):
            requests.append(number)
        return four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        reads = [client.io.read([IoAddress(DI, index)]) for index in (2, 3)]
        answers = await asyncio.gather(*reads)
        assert [answer.value for (answer,) in answers] == [0, 1]
        assert len(requests) == 2


@pytest.mark.parametrize(
    ('reply', 'reason'),
    [
        (
            lambda message_id: frame(READ, message_id, 0, 1, DI, 1, 1, 1),
            'are not the requested ones',
        ),
        (lambda message_id: frame(READ, message_id, 0, 0), 'are not the requested ones'),
        (lambda message_id: frame(READ), 'invalid reply of the I/O server'),
        (lambda message_id: frame(READ, reply_code=FAILURE), 'refused'),
        (lambda message_id: None, 'no I/O link'),
    ],
    ids=['other address', 'no items', 'no body', 'FAILURE', 'cut'],
)
async def test_invalid_reply_is_reported(reply, reason):
    def answer(number, msg_type, message_id, words):
        if not is_user_read(msg_type, words):
            return four_inputs(number, msg_type, message_id, words)
        return reply(message_id)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert reason in await client.rejection((DI, 3))


async def test_write_without_a_reply_reports_an_unknown_result():
    def answer(number, msg_type, message_id, words):
        if msg_type == INFO:
            return frame(INFO, message_id, 0, 1, DO, 0, 4, 2)
        return b'' if msg_type == WRITE else four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        with pytest.raises(IoUnavailableError, match='may have been written'):
            await client.io.write([IoSetting(DO, 0, 1)])
        await asyncio.sleep(10.0)
        assert [msg_type for msg_type, _ in server.requests].count(WRITE) == 1


@pytest.mark.invariant(6)
async def test_inv6_values_without_a_reply_become_unknown_and_are_polled_again():
    silent = False

    def answer(number, msg_type, message_id, words):
        return b'' if silent else four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        silent = True
        await until(lambda: len(client.reports) == 2)
        silent = False
        await until(lambda: len(client.reports) == 3)
        known = {(DI, 0): (0, 0, 0, 1)}
        assert client.reports == [known, 'no reply from the I/O server within 0.2 s', known]
        assert client.io.link.statistics.connections == 1


async def test_refused_range_does_not_prevent_polling_of_others():
    def answer(_number, msg_type, message_id, _words):
        if msg_type == INFO:
            return frame(INFO, message_id, 0, 2, AI, 0, 1, 2, DI, 0, 1, 2)
        return frame(READ, message_id, 0, 2, AI, 0, 1003, 0, DI, 0, 1, 1)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert client.values == {(DI, 0): (1,)}


HUGE = (DI, 0, 2**31 - 1, 2)


@pytest.mark.invariant(7)
async def test_inv7_huge_announced_range_is_not_polled():
    def answer(number, msg_type, message_id, words):
        if msg_type == INFO:
            return frame(INFO, message_id, 0, 3, *HUGE, DI, 0, 100, 2, AI, -5, -1, 2)
        return four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert client.values == {(DI, 0): (0, 0, 0, 1, *[0] * 96)}
        assert max(words[1] for msg_type, words in server.requests if msg_type == READ) == 60


async def test_requests_wait_for_a_byte_order():
    async with (
        ScriptedServer(four_inputs) as server,
        Client(server.port, dialect=None) as client,
    ):
        await until(lambda: client.io.link.connected)
        await asyncio.sleep(0.1)
        assert not server.requests
        client.io.follow(LITTLE_ENDIAN)
        await client.known()
    order = ByteOrder.LITTLE
    async with (
        ScriptedServer(four_inputs) as server,
        Client(server.port, dialect=None, byte_order=order) as client,
    ):
        await client.known()


async def test_driver_works_without_an_io_server():
    async with (
        simulated() as (_, ports),
        Harness(ports, io_port=vacant_port()) as harness,
    ):
        await harness.ready()
        await until(lambda: 'refused' in harness.driver.io.reason)
        assert harness.events.links[-1][0] == 'connected'
        assert harness.running


def test_point_is_refused_with_its_reason_while_ranges_are_unknown():
    assert sentence(2001, DO, 16, 1, ()) == 'DO 16 = 1: unknown index'
    assert sentence(1001, AI, 0, None, ()) == 'AI 0: the controller has no AI'
    assert sentence(2002, GO, 1000, -1, ()) == 'GO 1000 = -1: must be 0 to 65535'
    assert sentence(2002, AO, 0, 10001, ()).startswith('AO 0 = 10001: beyond the range of ')
    assert sentence(77, DO, 1, 1, ()) == 'DO 1 = 1: result 77, which is unknown'
    twelve = [IoRange(DO, 0, 12, 3)]
    assert sentence(2002, GO, 1, 16, twelve) == 'GO 1 = 16: must be 0 to 15'


@pytest.mark.invariant(9)
async def test_inv9_controller_without_points_is_reported():
    def talk(_number, _msg_type, message_id, _words):
        return frame(INFO, message_id, 0, 0)

    async with ScriptedServer(talk) as server, Client(server.port) as client:
        await until(lambda: client.reports)
        assert client.reports == ['the controller has no readable I/O']
        assert client.io.place == f'127.0.0.1:{server.port}'
        assert not client.io.states


# --- all backends------------------------------------------------------------------------------


@EVERY
async def test_changing_inputs_are_reported(profile):
    async with cell(profile) as (client, controller):
        controller.io.set_input(DI, 3, 1)
        await until(lambda: client.values[DI, 0][3] == 1)
        assert len(client.values[DI, 0]) == controller.io.profile.digital_inputs
        assert client.values[GI, 0][0] == 8
        controller.io.set_input(DI, 3, 0)
        await until(lambda: client.values[DI, 0][3] == 0)


@EVERY
async def test_points_and_groups_are_read_and_written(profile):
    async with cell(profile) as (client, controller):
        controller.io.set_input(GI, 1, 0x81)
        written = await client.io.write([IoSetting(DO, 1, 1), IoSetting(GO, 1, 0x5A)])
        assert [answer.text for answer in written] == ['', '']
        addresses = [(DI, 8), (DI, 9), (GI, 1), (DO, 1), (GO, 0), (GO, 1)]
        answers = await client.io.read([IoAddress(*address) for address in addresses])
        assert [answer.value for answer in answers] == [1, 0, 0x81, 1, 2, 0x5A]
        assert all(answer.result == IoResult.SUCCESS for answer in answers)


WORDS = {(GO, 1000): 0xF00F, (FLAG, 511): 1}
"""Outputs that both Remote Ethernet and the I/O server have."""


@pytest.mark.parametrize(
    ('profile', 'outputs', 'inputs'),
    [
        ('simulated', WORDS | {(AO, 0): 5000}, {(GI, 1000): 0xA55A, (AI, 1): -2500}),
        ('remote', WORDS, {(GI, 1000): 0xA55A}),
    ],
)
async def test_words_flags_and_analogue_points_are_read_and_written(profile, outputs, inputs):
    async with cell(profile) as (client, controller):
        for address, value in inputs.items():
            controller.io.set_input(*address, value)
        settings = [IoSetting(*address, value) for address, value in outputs.items()]
        assert {answer.text for answer in await client.io.write(settings)} == {''}
        values = outputs | inputs
        answers = await client.io.read([IoAddress(*address) for address in values])
        assert [answer.value for answer in answers] == [*values.values()]


async def test_motoman_outputs_are_reported():
    async with cell('motoman') as (client, _):
        await client.io.write([IoSetting(DO, 39, 1)])
        await until(lambda: client.values[DO, 0][39] == 1)


@EVERY
@pytest.mark.parametrize(
    ('item', 'expected'),
    [
        ((AI, 2), 'AI 2: the controller has '),
        ((9, 0), 'type 9, index 0: unknown type'),
        ((DI, 4000), 'DI 4000: the controller has 0 to '),
        ((DO, -1), 'DO -1: the controller has 0 to '),
        ((DI, 0, 1), 'DI 0 = 1: an input cannot be written'),
        ((DO, 0, 2), 'DO 0 = 2: must be 0 or 1'),
        ((GO, 0, 256), 'GO 0 = 256: must be 0 to 255'),
    ],
)
async def test_invalid_points_are_refused_and_the_others_are_handled(profile, item, expected):
    async with cell(profile) as (client, _):
        ask, kind = (client.io.write, IoSetting) if len(item) == 3 else (client.io.read, IoAddress)
        good = (DO, 0, 1)[: len(item)]
        wrong, right = await ask([kind(*item), kind(*good)])
        assert wrong.text.startswith(expected)
        assert right.text == ''


def test_last_group_is_limited_to_its_points():
    ranges = ranges_of(IoProfile(digital_outputs=12), words=True, flags=False)
    values = ((1, 15), (1, 16), (1000, 4095), (1000, 4096))
    results = [rejection(GO, index, value, ranges) for index, value in values]
    good, bad = IoResult.SUCCESS, IoResult.VALUE_OUT_OF_RANGE
    assert results == [good, bad, good, bad]
    assert rejection(FLAG, 0, None, ranges) is IoResult.TYPE_UNSUPPORTED


@EVERY
@pytest.mark.invariant(6)
async def test_inv6_closed_port_is_reported_once_and_requests_end(profile, caplog):
    caplog.set_level(logging.INFO)
    async with Client(vacant_port(), profile=load_controller_profile(profile).io) as client:
        await asyncio.sleep(5.0)
        assert len(client.reports) == 1
        assert 'refused' in client.reports[0]
        assert 'Connection refused' in await client.rejection()
    assert len(caplog.messages) == 1


@pytest.mark.invariant(6)
async def test_inv6_cut_link_is_reported_and_the_values_return():
    async with cell('motoman') as (client, controller):
        controller.faults.start(parse('cut port=io for=2'))
        await until(lambda: not client.io.states)
        assert 'no I/O link' in client.reports[-1]
        await until(lambda: client.io.states)
        assert [isinstance(report, dict) for report in client.reports] == [True, False, True]


@pytest.mark.invariant(9)
async def test_inv9_link_lost_between_two_points_leaves_the_result_unknown():
    """MotoROS needs a request for each point."""
    client = Client(1, profile=load_controller_profile('motoman').io)
    answers = iter([PointReply(), IoUnavailableError('no I/O link')])

    async def ask(_message, _timeout):
        if isinstance(answer := next(answers), Exception):
            raise answer
        return answer

    client.io._backend._ask = ask
    with pytest.raises(IoUnavailableError, match='no I/O link; the points may have been written'):
        await client.io.write([IoSetting(DO, 0, 1), IoSetting(DO, 1, 1)])


@EVERY
@pytest.mark.invariant(9)
async def test_inv9_silent_port_ends_each_request_in_time(profile):
    async def read(reader, writer):
        await reader.read()
        writer.close()

    silent = await asyncio.start_server(read, '127.0.0.1', 0)
    port = silent.sockets[0].getsockname()[1]
    io_profile = load_controller_profile(profile).io
    text = 'no I/O link: a reply is missing' if profile == 'motoman' else 'may have been written'
    async with silent, Client(port, profile=io_profile, timeout=0.5) as client:
        await asyncio.sleep(0.2)
        async with asyncio.timeout(20.0):
            with pytest.raises(IoUnavailableError, match=text):
                await client.io.write([IoSetting(DO, 0, 1)])
        assert not client.io.states


@EVERY
@pytest.mark.invariant(9)
async def test_inv9_io_without_a_port_is_reported_and_sends_nothing(profile, caplog):
    async with Client(0, profile=load_controller_profile(profile).io, timeout=0.25) as client:
        await until(lambda: client.reports)
        assert not client.io.used
        assert client.reports == [client.io.reason]
        assert re.match(r'I/O is not used: .*port.* is 0', client.io.reason)
        assert await client.rejection() == client.io.reason
    assert not caplog.messages


@EVERY
async def test_too_many_points_in_a_request_are_refused(profile):
    async with Client(1, profile=load_controller_profile(profile).io) as client:
        points = [(DI, 0)] * (MAX_POINTS + 1)
        assert await client.rejection(*points) == '1025 points in one request: at most 1024'


async def test_outputs_are_unavailable_while_the_controller_is_not_ready():
    async with cell('remote') as (client, controller):
        controller.apply(Event.ESTOP_PRESS)
        (answer,) = await client.io.read([IoAddress(DI, 0)])
        assert answer.text == ''
        (answer,) = await client.io.read([IoAddress(DO, 0)])
        assert answer.text.startswith('DO 0: not ready (error 20)')
        assert answer.result == 0


@pytest.mark.invariant(3)
async def test_inv3_motor_command_preempts_io_at_the_remote_port():
    """A real controller serves one client there, so an I/O request ends with a reason."""
    holds = asyncio.Event()
    turns = RemoteTurns()

    async def hold():
        holds.set()
        await asyncio.Event().wait()

    async with cell('remote', turns=turns) as (client, controller):
        holding = asyncio.create_task(turns.patient(hold))
        await holds.wait()
        read = asyncio.create_task(client.io.read([IoAddress(DI, 0)]))
        await asyncio.sleep(0.1)
        port = int(client.io.place.rpartition(':')[2])
        await RemoteEthernetMotors('127.0.0.1', port, turns).act(Action.MOTORS_OFF, 2.0)
        assert not controller.condition.powered
        await asyncio.gather(holding, return_exceptions=True)
        with pytest.raises(IoUnavailableError, match='needed for the motors'):
            await read
        await until(lambda: client.io.states)


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('profile', 'reason'),
    [('remote', '(error 15)'), ('motoman', 'the controller refused it: ')],
)
async def test_inv9_points_missing_at_the_controller_are_reported(profile, reason):
    io_profile = load_controller_profile(profile).io
    more = replace(io_profile, digital_inputs=4000, digital_outputs=4000)
    async with simulated(profile=profile) as (_, ports):
        port = ports.remote if profile == 'remote' else ports.io
        async with Client(port, profile=more) as client:
            await until(lambda: any(reason in report for report in client.reports))
            assert client.io.states == ()
            (answer,) = await client.io.read([IoAddress(DI, 3999)])
            assert answer.text
            assert answer.result != IoResult.SUCCESS


@pytest.mark.invariant(9)
async def test_inv9_non_numeric_answer_is_reported_with_its_command():
    async def attend(reader, writer):
        while line := await reader.readline():
            name = line.decode().strip('$\r\n').split(',')[0]
            writer.write(f'#{name},{"0" if name == "Login" else "zz"}\r\n'.encode())
        writer.close()

    server = await asyncio.start_server(attend, '127.0.0.1', 0)
    port = server.sockets[0].getsockname()[1]
    async with Client(port, profile=load_controller_profile('remote').io) as client:
        await until(lambda: any("'zz' is not a reply to " in report for report in client.reports))
        assert client.io.states == ()
    server.close()
