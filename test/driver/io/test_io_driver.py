# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client's I/O against the simulated controller, and against servers that behave badly."""

import asyncio
import contextlib
import logging
import random
import re
import struct
from pathlib import Path

import pytest
from support.driver_harness import Harness, simulated
from support.event_loop import now, run, until
from support.sim_process import vacant_port

from epson_driver.driver.io.io_driver import MAX_POINTS, IoDriver, IoUnavailableError
from epson_driver.driver.io.io_results import sentence
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    ByteOrder,
    IoAddress,
    IoRange,
    IoSetting,
)

DI, DO, AI, AO, GI, GO, FLAG = range(1, 8)
INFO, READ, WRITE, _RESET, SUB, _UNSUB, PUB = range(65200, 65207)
SUCCESS, FAILURE = 1, 2


class Client:
    """An I/O driver that runs, and every state that it told: the values, or the reason."""

    def __init__(self, port, *, timeout=1.0, dialect=LITTLE_ENDIAN, byte_order=None):
        self.io = IoDriver('127.0.0.1', port, byte_order=byte_order, timeout=timeout)
        if dialect is not None:
            self.io.follow(dialect)
        self.told = []
        self.io.on_states = self._tell

    def _tell(self):
        self.told.append(self.io.reason or self.values)

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
        """Return why a read has no answer."""
        with pytest.raises(IoUnavailableError) as error:
            await self.io.read([IoAddress(*each) for each in addresses or [(DI, 0)]])
        return str(error.value)


def frame(msg_type, *words, comm_type=3, reply_code=SUCCESS):
    length = 12 + 4 * len(words)
    return struct.pack(f'<{4 + len(words)}i', length, msg_type, comm_type, reply_code, *words)


def publication(*values, start=0):
    return frame(PUB, 0, 1, DI, start, len(values), *values, comm_type=1, reply_code=0)


class ScriptedServer:
    """A server whose `answer(number, msg_type, message_id, words)` is the test's.

    It returns the bytes to send, or None to hang up. `requests` are (msg_type, words) as they
    came, of all connections.
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

    def publish(self, *values):
        self.writers[-1].write(publication(*values))


def four_inputs(_number, msg_type, message_id, _words):
    """Answer as a controller with four digital inputs does, whose values are 0 0 0 1."""
    if msg_type == INFO:
        return frame(INFO, message_id, 0, 1, DI, 0, 4, 2)
    if msg_type == SUB:
        return frame(SUB, message_id, 1, DI, 0, 1) + publication(0, 0, 0, 1)
    return frame(READ, message_id, 0, 1, DI, 3, 1, 1)


# --- with the simulated controller ------------------------------------------------------------


@pytest.mark.parametrize('dialect', [LITTLE_ENDIAN, BIG_ENDIAN])
async def test_values_are_told_at_first_and_when_one_changes(dialect):
    async with (
        simulated(dialect) as (controller, ports),
        Client(ports.io, dialect=dialect) as client,
    ):
        await client.known()
        assert client.values[DI, 0] == (0,) * 24
        assert client.values[DO, 0] == (0,) * 16
        assert len(client.values[FLAG, 0]) == 512
        await asyncio.sleep(0.3)  # publications go on, and say nothing new
        assert len(client.told) == 1
        controller.io.set_input(DI, 3, 1)
        await until(lambda: len(client.told) > 1)
        assert client.values[DI, 0][3] == 1
        assert client.values[GI, 0][0] == 8
        await asyncio.sleep(0.3)
        assert len(client.told) == 2


@pytest.mark.parametrize('profile', ['rc620', 'rc700a', 'generic', 'fanuc', 'abb', 'motoman'])
async def test_io_with_every_profile_of_the_simulated_controller(profile):
    """Through a whole driver: the way is the profile's, the byte order the state messages'."""
    async with (
        simulated(profile=profile) as (controller, ports),
        Harness(
            ports,
            io_port=ports.io,
            remote_port=ports.remote,
            io=load_controller_profile(profile).io,
        ) as harness,
    ):
        io = harness.driver.io
        await until(lambda: io.states)
        (answer,) = await io.write([IoSetting(DO, 2, 1)])
        assert answer.text == ''
        assert controller.io.read(DO, 2) == 1
        (answer,) = await io.read([IoAddress(DO, 2)])
        assert (answer.value, answer.text) == (1, '')


async def test_an_rc700a_with_an_io_server_by_the_profile_that_docs_show(tmp_path):
    """Remote Ethernet has no analogue points: that one is set shows which way it went."""
    page = (Path(__file__).parents[3] / 'docs/io.md').read_text(encoding='utf-8')
    (block,) = re.findall(r'```yaml\n(like: rc700a\n.*?)```', page, flags=re.DOTALL)
    file = tmp_path / 'rc700a_io_server.yaml'
    file.write_text(block, encoding='utf-8')
    profile = load_controller_profile(str(file))
    assert profile.ports.remote == load_controller_profile('rc700a').ports.remote

    async with (
        simulated(profile=str(file)) as (controller, ports),
        Harness(ports, io_port=ports.io, remote_port=ports.remote, io=profile.io) as harness,
    ):
        io = harness.driver.io
        await until(lambda: io.states)
        answers = await io.write([IoSetting(DO, 2, 1), IoSetting(AO, 1, -2500)])
        assert [answer.text for answer in answers] == ['', '']
        assert (controller.io.read(DO, 2), controller.io.read(AO, 1)) == (1, -2500)


def test_every_request_ends_whenever_the_connection_is_cut():
    """Cuts after random times, with requests on their way: an answer or a reason, and a return."""
    times = random.Random(11)

    async def ask(io):
        try:
            (answer,) = await io.read([IoAddress(DI, 3)])
        except IoUnavailableError as error:
            return str(error)
        return answer.value

    async def test():
        async with simulated() as (_, ports), Client(ports.io) as client:
            for _cut in range(20):
                await client.known()
                asked = [asyncio.create_task(ask(client.io)) for _ in range(5)]
                await asyncio.sleep(times.uniform(0.0, 0.004))
                client.io.link.transport.abort()
                for answer in await asyncio.gather(*asked):
                    assert answer == 0 or 'lost' in answer
                assert not client.io._asked
                await until(lambda: not client.io.states)
            await client.known()
            assert [isinstance(each, dict) for each in client.told] == [True, False] * 20 + [True]

    run(test())


async def test_reading_and_writing_points_and_groups():
    async with simulated() as (controller, ports), Client(ports.io) as client:
        await client.known()
        controller.io.set_input(AI, 1, -2500)
        written = await client.io.write(
            [
                IoSetting(DO, 15, 1),
                IoSetting(GO, 0, 0xA5),
                IoSetting(AO, 0, 5000),
                IoSetting(FLAG, 511, 1),
            ]
        )
        assert [(each.result, each.text) for each in written] == [(1, '')] * 4
        addresses = [(GO, 1000), (AI, 1), (AO, 0), (FLAG, 511), (DO, 7)]
        read = await client.io.read([IoAddress(*each) for each in addresses])
        assert [(each.io_type, each.index) for each in read] == addresses
        assert [each.value for each in read] == [0x80A5, -2500, 5000, 1, 1]
        await until(lambda: client.values[GO, 0][0] == 0xA5)


async def test_every_wrong_point_has_its_sentence_and_keeps_no_other_from_being_done():
    cases = [
        ((DO, 0, 1), ''),
        ((DO, 16, 1), 'DO 16 = 1: the controller has 0 to 15'),
        ((DI, 3, 1), 'DI 3 = 1: an input cannot be written'),
        ((DO, 2, 5), 'DO 2 = 5: must be 0 or 1'),
        ((AO, 0, 10001), "AO 0 = 10001: beyond the range of the controller's analogue outputs"),
        ((GO, 1, 256), 'GO 1 = 256: must be 0 to 255'),
        ((GO, 7, 1), 'GO 7 = 1: the controller has 0 to 1 and 1000 to 1000'),
        ((9, 4, 1), 'type 9, index 4 = 1: there is no such type, only 1 to 7'),
        ((DO, 1, 1), ''),
    ]

    async with simulated() as (controller, ports), Client(ports.io) as client:
        await client.known()
        answers = await client.io.write([IoSetting(*case) for case, _ in cases])
        for (case, text), answer in zip(cases, answers, strict=True):
            assert (answer.io_type, answer.index, answer.value) == case
            assert answer.text.startswith(text)
            assert (answer.result == SUCCESS) is (not text) is (not answer.text)
        assert controller.io.read(DO, 0) == controller.io.read(DO, 1) == 1
        (answer,) = await client.io.read([IoAddress(DI, 24)])
        assert answer.text == 'DI 24: the controller has 0 to 23'
        assert answer.value == 0


@pytest.mark.invariant(6)
async def test_no_values_while_the_io_server_does_not_run_and_again_when_it_does():
    """Invariant 6: an E-stop silences the I/O server; old values are not shown as known."""
    async with simulated() as (controller, ports), Client(ports.io, timeout=0.3) as client:
        await client.known()
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: not client.io.states)
        assert client.told[1:] == ['no values from the I/O server for 0.3 s']
        assert 'refused' in await client.rejection()
        with pytest.raises(IoUnavailableError, match='refused'):
            await client.io.write([IoSetting(DO, 0, 1)])
        await asyncio.sleep(1.0)
        assert len(client.told) == 2
        controller.apply(Event.ESTOP_RELEASE)
        controller.apply(Event.RESET)
        await client.known()
        assert client.told[2] == client.values
        assert client.io.link.statistics.connections == 1  # outputs would fall to safe


async def test_a_controller_that_returns_is_subscribed_to_again():
    async with simulated() as (_, ports), Client(ports.io) as client:
        await client.known()
        client.io.link.transport.abort()  # the cable
        await until(lambda: len(client.told) == 3)
        assert 'no I/O link' in client.told[1]
        assert client.told[2] == client.told[0]


# --- controllers without I/O, and bad ones ----------------------------------------------------


async def test_a_port_where_nobody_listens_is_said_once(caplog):
    caplog.set_level(logging.INFO)

    port = vacant_port()
    async with Client(port) as client:
        await until(lambda: client.io.link.attempt >= 5)
        assert len(client.told) == 1
        assert await client.rejection() == f'no I/O link: 127.0.0.1:{port}: Connection refused'
    assert len(caplog.messages) == 1


async def test_a_server_that_hangs_up_at_once_is_said_once(caplog):
    caplog.set_level(logging.INFO)

    async with ScriptedServer(lambda *_: None) as server, Client(server.port) as client:
        await until(lambda: client.io.link.statistics.connections >= 4)
        assert len(client.told) == 1
        assert 'closed by the controller' in client.told[0]
    assert len(caplog.messages) == 1


async def test_a_server_that_knows_no_io_is_asked_ever_less_and_said_once(caplog):
    caplog.set_level(logging.INFO)

    rejection = frame(INFO, reply_code=FAILURE)
    async with ScriptedServer(lambda *_: rejection) as server, Client(server.port) as client:
        await until(lambda: len(server.requests) == 3)
        began = now()
        await until(lambda: len(server.requests) == 4)
        assert now() - began > 0.9
        assert len(client.told) == 1
        assert 'does not know I/O requests' in client.told[0]
        assert client.io.link.statistics.connections == 1
    assert len(caplog.messages) == 1


async def test_something_else_on_the_port_is_said_once(caplog):
    caplog.set_level(logging.INFO)

    async def greet(_reader, writer):
        writer.write(b'SSH-2.0-OpenSSH_9.6\r\n')
        with contextlib.suppress(ConnectionError):
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(greet, '127.0.0.1', 0)
    async with server, Client(server.sockets[0].getsockname()[1]) as client:
        await until(lambda: client.io.link.statistics.connections >= 4)
        assert len(client.told) == 1
        assert 'length' in client.told[0]
        assert client.io.link.statistics.bad_frames['length'] >= 3
    assert len(caplog.messages) == 1


async def test_port_0_is_not_used(caplog):
    async with Client(0) as client:
        await until(lambda: client.told)
        assert client.told == ['I/O is not used: its port is 0']
        assert 'its port is 0' in await client.rejection()
    assert not caplog.messages


async def test_a_late_reply_answers_its_own_request_only():
    """The first read's reply comes after it was given up, with the second read's."""
    late = []

    def answer(number, msg_type, message_id, words):
        if msg_type != READ:
            return four_inputs(number, msg_type, message_id, words)
        late.append(frame(READ, message_id, 0, 1, DI, 3, 1, len(late)))
        return b'' if len(late) == 1 else late[0] + late[1]

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        assert await client.rejection((DI, 3)) == 'no reply from the I/O server within 0.2 s'
        (second,) = await client.io.read([IoAddress(DI, 3)])
        assert second.value == 1
        assert client.io.link.statistics.unsolicited_replies == 1


async def test_two_requests_at_a_time_find_their_replies_in_any_order():
    held = []

    def answer(number, msg_type, message_id, words):
        if msg_type != READ:
            return four_inputs(number, msg_type, message_id, words)
        held.append(frame(READ, message_id, 0, 1, DI, words[2], 1, words[2]))
        return held[1] + held[0] if len(held) == 2 else b''

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        first, second = await asyncio.gather(
            client.io.read([IoAddress(DI, 2)]), client.io.read([IoAddress(DI, 3)])
        )
        assert (first[0].value, second[0].value) == (2, 3)


@pytest.mark.parametrize(
    ('reply', 'said'),
    [
        (lambda message_id: frame(READ, message_id, 0, 1, DI, 1, 1, 1), 'about other points'),
        (lambda message_id: frame(READ, message_id, 0, 0), 'about other points'),
        (lambda message_id: frame(READ), 'makes no sense'),
        (lambda message_id: frame(READ, reply_code=FAILURE), 'refused'),
        (lambda message_id: None, 'I/O link was lost'),
    ],
    ids=['other address', 'no items', 'no body', 'FAILURE', 'cut'],
)
async def test_replies_that_are_none(reply, said):
    def answer(number, msg_type, message_id, words):
        if msg_type != READ:
            return four_inputs(number, msg_type, message_id, words)
        return reply(message_id)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert said in await client.rejection((DI, 3))


async def test_a_write_without_a_reply_says_that_it_may_have_been_done():
    def answer(number, msg_type, message_id, words):
        return b'' if msg_type == WRITE else four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        with pytest.raises(IoUnavailableError, match='may have been written'):
            await client.io.write([IoSetting(DO, 0, 1)])


async def test_ranges_that_were_not_subscribed_to_are_dropped_and_counted():
    async with ScriptedServer(four_inputs) as server, Client(server.port) as client:
        await client.known()
        server.writers[-1].write(publication(1, 1) + publication(7, start=4))
        bad = client.io.link.statistics.bad_frames
        await until(lambda: bad['range'] == 2)
        assert client.values == {(DI, 0): (0, 0, 0, 1)}


async def test_values_without_a_period_become_unknown_and_are_asked_for_again():
    """ScriptedServer publishes once only, when it is subscribed to."""
    async with (
        ScriptedServer(four_inputs) as server,
        Client(server.port, timeout=0.2) as client,
    ):
        await until(lambda: len(client.told) == 4)
        known = {(DI, 0): (0, 0, 0, 1)}
        silent = 'no values from the I/O server for 0.2 s'
        assert client.told == [known, silent, known, silent]
        asked = [msg_type for msg_type, _ in server.requests]
        assert asked[:4] == [INFO, SUB, INFO, SUB]


async def test_ranges_that_are_refused_do_not_keep_the_others():
    def answer(number, msg_type, message_id, words):
        if msg_type == INFO:
            return frame(INFO, message_id, 0, 2, DI, 0, 4, 2, FLAG, 0, 512, 2)
        outcomes = (DI, 0, SUCCESS, FLAG, 0, 65001)
        return publication(1, 1, 1, 1) + frame(SUB, message_id, 2, *outcomes)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert client.values == {(DI, 0): (1, 1, 1, 1)}


async def test_too_many_points_are_refused_before_they_are_sent():
    async with ScriptedServer(four_inputs) as server, Client(server.port) as client:
        await client.known()
        sent = len(server.requests)
        points = [(DI, 0)] * (MAX_POINTS + 1)
        assert await client.rejection(*points) == '1025 points in one request: at most 1024'
        assert len(server.requests) == sent


async def test_without_a_byte_order_it_waits_for_the_state_messages():
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


async def test_a_driver_without_io_works_and_one_with_io_follows_the_state():
    async with simulated(BIG_ENDIAN) as (_, ports):
        async with Harness(ports, io_port=ports.io) as harness:
            await harness.ready()
            await until(lambda: harness.driver.io.states)
        async with Harness(ports, io_port=vacant_port()) as harness:
            await harness.ready()
            await until(lambda: 'refused' in harness.driver.io.reason)
            assert harness.events.links[-1][0] == 'connected'
            assert harness.running


def test_sentences_where_the_ranges_are_not_known():
    assert sentence(2001, DO, 16, 1, ()) == 'DO 16 = 1: there is no such index'
    assert sentence(1001, AI, 0, None, ()) == 'AI 0: the controller has no AI'
    assert sentence(2002, GO, 1000, -1, ()) == 'GO 1000 = -1: must be 0 to 65535'
    assert sentence(77, DO, 1, 1, ()) == 'DO 1 = 1: result 77, which has no meaning here'
    twelve = [IoRange(DO, 0, 12, 3)]
    assert sentence(2002, GO, 1, 16, twelve) == 'GO 1 = 16: must be 0 to 15'


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('features', 'result', 'said'),
    [
        (0, 0, 'the controller has no I/O that it publishes'),
        (2, 2, 'the controller publishes no I/O: '),
    ],
)
async def test_inv9_a_controller_that_publishes_nothing_is_told(features, result, said):
    def talk(_number, msg_type, message_id, _words):
        if msg_type == INFO:
            return frame(INFO, message_id, 0, 1, DI, 0, 4, features)
        return frame(SUB, message_id, 1, DI, 0, result)

    async with ScriptedServer(talk) as server, Client(server.port) as client:
        await until(lambda: any(said in str(told) for told in client.told))
        assert client.io.place == f'127.0.0.1:{server.port}'
        assert not client.io.states
