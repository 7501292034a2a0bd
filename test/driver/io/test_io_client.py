# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client's I/O by each of its ways, against simulated controllers and bad servers."""

import asyncio
import contextlib
import logging
import random
import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from support.driver_harness import Harness, simulated
from support.event_loop import now, run, until
from support.sim_process import vacant_port

from epson_driver.driver.io.io_client import MAX_POINTS, make_io
from epson_driver.driver.io.points import (
    IoUnavailableError,
    Told,
    ranges_of,
    rejection,
    sentence,
)
from epson_driver.driver.stopping.motors import Action, RemoteEthernetMotors
from epson_driver.profiles import load_controller_profile
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.turns import RemoteTurns
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

EVERY = pytest.mark.parametrize('profile', ['simulated', 'rc700a', 'motoman'])


class Client:
    """The I/O of a driver that runs, and every state that it told: the values, or the reason."""

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


def readings(message_id, words, value):
    """Return the reply to a READ, with `value(index)` for each of its points."""
    points = list(zip(words[1::2], words[2::2], strict=True))
    told = [word for kind, index in points for word in (kind, index, 1, value(index))]
    return frame(READ, message_id, 0, len(points), *told)


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


def four_inputs(_number, msg_type, message_id, words):
    """Answer as a controller with four digital inputs does, whose values are 0 0 0 1."""
    if msg_type == INFO:
        return frame(INFO, message_id, 0, 1, DI, 0, 4, 2)
    return readings(message_id, words, lambda index: int(index == 3))


def asked_once(msg_type, words):
    """Return whether a user asked, and not the client itself: it asks for all four inputs."""
    return msg_type == READ and words[0] != 4


@contextlib.asynccontextmanager
async def cell(profile, **options):
    """Yield a client that knows the values of a simulated controller, and that."""
    async with simulated(profile=profile) as (controller, ports):
        held = load_controller_profile(profile).io
        port = ports.remote if held.access == 'remote_ethernet' else ports.io
        async with Client(port, profile=held, **options) as client:
            await client.known()
            yield client, controller


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
        await asyncio.sleep(0.3)  # the questions go on, and the answers say nothing new
        assert len(client.told) == 1
        controller.io.set_input(DI, 3, 1)
        await until(lambda: len(client.told) > 1)
        assert client.values[DI, 0][3] == 1
        assert client.values[GI, 0][0] == 8
        await asyncio.sleep(0.3)
        assert len(client.told) == 2


@pytest.mark.parametrize('profile', ['simulated', 'rc700a', 'generic', 'fanuc', 'abb', 'motoman'])
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
                    assert answer == 0 or 'no I/O link' in answer
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
        (said,) = client.told[1:]
        assert 'its I/O server does not run now (E-stop' in said
        assert said == await client.rejection()
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


async def test_a_late_reply_answers_its_own_request_only():
    """The first read's reply comes after it was given up, with the second read's."""
    late = []

    def answer(number, msg_type, message_id, words):
        if not asked_once(msg_type, words):
            return four_inputs(number, msg_type, message_id, words)
        late.append(frame(READ, message_id, 0, 1, DI, 3, 1, len(late)))
        return b'' if len(late) == 1 else late[0] + late[1]

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        assert await client.rejection((DI, 3)) == 'no reply from the I/O server within 0.2 s'
        (second,) = await client.io.read([IoAddress(DI, 3)])
        assert second.value == 1
        assert client.io.link.statistics.unsolicited_replies == 1


async def test_requests_at_the_same_time_are_sent_one_after_the_other():
    held = []

    def answer(number, msg_type, message_id, words):
        if asked_once(msg_type, words):
            held.append(number)
        return four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        reads = [client.io.read([IoAddress(DI, index)]) for index in (2, 3)]
        answers = await asyncio.gather(*reads)
        assert [answer.value for (answer,) in answers] == [0, 1]
        assert len(held) == 2


@pytest.mark.parametrize(
    ('reply', 'said'),
    [
        (lambda message_id: frame(READ, message_id, 0, 1, DI, 1, 1, 1), 'about other points'),
        (lambda message_id: frame(READ, message_id, 0, 0), 'about other points'),
        (lambda message_id: frame(READ), 'makes no sense'),
        (lambda message_id: frame(READ, reply_code=FAILURE), 'refused'),
        (lambda message_id: None, 'no I/O link'),
    ],
    ids=['other address', 'no items', 'no body', 'FAILURE', 'cut'],
)
async def test_replies_that_are_none(reply, said):
    def answer(number, msg_type, message_id, words):
        if not asked_once(msg_type, words):
            return four_inputs(number, msg_type, message_id, words)
        return reply(message_id)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert said in await client.rejection((DI, 3))


async def test_a_write_without_a_reply_says_that_it_may_have_been_done():
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


async def test_publications_that_nobody_asked_for_change_nothing():
    async with ScriptedServer(four_inputs) as server, Client(server.port) as client:
        await client.known()
        server.writers[-1].write(frame(65206, 0, 1, DI, 0, 4, 1, 1, 1, 1, comm_type=1))
        await asyncio.sleep(0.3)
        assert client.told == [{(DI, 0): (0, 0, 0, 1)}]


@pytest.mark.invariant(6)
async def test_values_that_are_not_answered_become_unknown_and_are_asked_for_again():
    silent = False

    def answer(number, msg_type, message_id, words):
        return b'' if silent else four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port, timeout=0.2) as client:
        await client.known()
        silent = True
        await until(lambda: len(client.told) == 2)
        silent = False
        await until(lambda: len(client.told) == 3)
        known = {(DI, 0): (0, 0, 0, 1)}
        assert client.told == [known, 'no reply from the I/O server within 0.2 s', known]
        assert client.io.link.statistics.connections == 1


async def test_ranges_that_are_refused_do_not_keep_the_others(caplog):
    caplog.set_level(logging.INFO)

    def answer(number, msg_type, message_id, words):
        if msg_type == INFO:
            return frame(INFO, message_id, 0, 2, DI, 0, 1, 2, AI, 0, 1, 2)
        return frame(READ, message_id, 0, 2, DI, 0, 1, 1, AI, 0, 1003, 0)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert client.values == {(DI, 0): (1,)}
    assert 'not all can be read: AI 0: this index cannot do this' in caplog.text


@pytest.mark.invariant(7)
async def test_inv7_a_server_that_says_to_have_any_number_of_points_is_asked_for_few():
    def answer(number, msg_type, message_id, words):
        if msg_type == INFO:
            few = (DI, 0, 100, 2)
            return frame(INFO, message_id, 0, 3, DI, 0, 2**31 - 1, 2, *few, AI, -5, -1, 2)
        return four_inputs(number, msg_type, message_id, words)

    async with ScriptedServer(answer) as server, Client(server.port) as client:
        await client.known()
        assert client.values == {(DI, 0): (0, 0, 0, 1, *[0] * 96)}
        assert max(words[1] for msg_type, words in server.requests if msg_type == READ) == 60


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
async def test_inv9_a_controller_without_points_is_told():
    def talk(_number, _msg_type, message_id, _words):
        return frame(INFO, message_id, 0, 0)

    async with ScriptedServer(talk) as server, Client(server.port) as client:
        await until(lambda: client.told)
        assert client.told == ['the controller has no I/O whose values can be shown']
        assert client.io.place == f'127.0.0.1:{server.port}'
        assert not client.io.states


# --- all ways -----------------------------------------------------------------------------------


@EVERY
async def test_inputs_are_shown_as_they_change(profile):
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
        answers = await client.io.read([IoAddress(*each) for each in addresses])
        assert [answer.value for answer in answers] == [1, 0, 0x81, 1, 2, 0x5A]
        assert all(answer.result == IoResult.SUCCESS for answer in answers)


async def test_remote_ethernet_has_words_and_memory_bits():
    async with cell('rc700a') as (client, controller):
        controller.io.set_input(GI, 1000, 0xA55A)
        settings = [IoSetting(GO, 1000, 0xF00F), IoSetting(FLAG, 511, 1)]
        assert [each.text for each in await client.io.write(settings)] == ['', '']
        addresses = [IoAddress(GI, 1000), IoAddress(GO, 1000), IoAddress(FLAG, 511)]
        assert [each.value for each in await client.io.read(addresses)] == [0xA55A, 0xF00F, 1]


async def test_outputs_of_motoman_are_shown_too():
    async with cell('motoman') as (client, _):
        await client.io.write([IoSetting(DO, 39, 1)])
        await until(lambda: client.values[DO, 0][39] == 1)


@EVERY
@pytest.mark.parametrize(
    ('item', 'expected'),
    [
        ((AI, 2), 'AI 2: the controller has '),
        ((9, 0), 'type 9, index 0: there is no such type'),
        ((DI, 4000), 'DI 4000: the controller has 0 to '),
        ((DO, -1), 'DO -1: the controller has 0 to '),
        ((DI, 0, 1), 'DI 0 = 1: an input cannot be written'),
        ((DO, 0, 2), 'DO 0 = 2: must be 0 or 1'),
        ((GO, 0, 256), 'GO 0 = 256: must be 0 to 255'),
    ],
)
async def test_what_cannot_be_is_refused_in_the_words_of_every_way_and_the_rest_is_done(
    profile, item, expected
):
    async with cell(profile) as (client, _):
        ask, kind = (client.io.write, IoSetting) if len(item) == 3 else (client.io.read, IoAddress)
        good = (DO, 0, 1)[: len(item)]
        wrong, right = await ask([kind(*item), kind(*good)])
        assert wrong.text.startswith(expected)
        assert right.text == ''


def test_the_last_group_holds_no_more_than_its_points():
    ranges = ranges_of(IoProfile(digital_outputs=12), words=True, flags=False)
    given = ((1, 15), (1, 16), (1000, 4095), (1000, 4096))
    allowed = [rejection(GO, *each, ranges) for each in given]
    good, bad = IoResult.SUCCESS, IoResult.VALUE_OUT_OF_RANGE
    assert allowed == [good, bad, good, bad]
    assert rejection(FLAG, 0, None, ranges) is IoResult.TYPE_UNSUPPORTED


@EVERY
@pytest.mark.invariant(6)
async def test_where_nothing_listens_it_is_said_once_and_each_request_is_answered(profile, caplog):
    caplog.set_level(logging.INFO)
    async with Client(vacant_port(), profile=load_controller_profile(profile).io) as client:
        await asyncio.sleep(5.0)
        assert len(client.told) == 1
        assert 'refused' in client.told[0]
        assert 'Connection refused' in await client.rejection()
    assert len(caplog.messages) == 1


@pytest.mark.invariant(6)
async def test_a_cut_link_is_told_and_the_values_come_back():
    async with cell('motoman') as (client, controller):
        controller.faults.start(parse('cut port=io for=2'))
        await until(lambda: not client.io.states)
        assert 'no I/O link' in client.told[-1]
        await until(lambda: client.io.states)
        assert [isinstance(each, dict) for each in client.told] == [True, False, True]


@pytest.mark.invariant(9)
async def test_inv9_a_link_that_goes_between_two_points_leaves_it_open_whether_they_are_set():
    """MotoROS has a request for each point."""
    client = Client(1, profile=load_controller_profile('motoman').io)
    answers = iter([Told(), IoUnavailableError('no I/O link')])

    async def ask(_message, _timeout):
        if isinstance(answer := next(answers), Exception):
            raise answer
        return answer

    client.io._backend._ask = ask
    with pytest.raises(IoUnavailableError, match='no I/O link; the points may have been written'):
        await client.io.write([IoSetting(DO, 0, 1), IoSetting(DO, 1, 1)])


@EVERY
@pytest.mark.invariant(9)
async def test_a_port_that_never_answers_ends_each_request_in_its_time(profile):
    async def hear(reader, writer):
        await reader.read()
        writer.close()

    quiet = await asyncio.start_server(hear, '127.0.0.1', 0)
    port = quiet.sockets[0].getsockname()[1]
    held = load_controller_profile(profile).io
    said = 'no I/O link: a reply is missing' if profile == 'motoman' else 'may have been written'
    async with quiet, Client(port, profile=held, timeout=0.5) as client:
        await asyncio.sleep(0.2)
        async with asyncio.timeout(20.0):
            with pytest.raises(IoUnavailableError, match=said):
                await client.io.write([IoSetting(DO, 0, 1)])
        assert not client.io.states


@EVERY
@pytest.mark.invariant(9)
async def test_inv9_io_without_a_port_says_so_and_asks_nobody(profile, caplog):
    async with Client(0, profile=load_controller_profile(profile).io, timeout=0.25) as client:
        await until(lambda: client.told)
        assert not client.io.used
        assert client.told == [client.io.reason]
        assert re.match(r'I/O is not used: .*port.* is 0', client.io.reason)
        assert await client.rejection() == client.io.reason
    assert not caplog.messages


@EVERY
async def test_more_points_than_one_request_may_have_are_refused_at_once(profile):
    async with Client(1, profile=load_controller_profile(profile).io) as client:
        points = [(DI, 0)] * (MAX_POINTS + 1)
        assert await client.rejection(*points) == '1025 points in one request: at most 1024'


async def test_outputs_are_not_set_while_the_controller_is_not_ready_and_the_answer_says_why():
    async with cell('rc700a') as (client, controller):
        controller.apply(Event.ESTOP_PRESS)
        (read,) = await client.io.read([IoAddress(DI, 0)])
        assert read.text == ''
        (shown,) = await client.io.read([IoAddress(DO, 0)])
        assert shown.text.startswith('DO 0: not ready (error 20)')
        assert shown.result == 0


@pytest.mark.invariant(3)
async def test_the_motors_go_before_the_io_at_the_remote_port():
    """A real controller serves one client there: who asks for I/O gives way, and is told."""
    held = asyncio.Event()
    turns = RemoteTurns()

    async def hold():
        held.set()
        await asyncio.Event().wait()

    async with cell('rc700a', turns=turns) as (client, controller):
        holding = asyncio.create_task(turns.patient(hold))
        await held.wait()
        asked = asyncio.create_task(client.io.read([IoAddress(DI, 0)]))
        await asyncio.sleep(0.1)
        port = int(client.io.place.rpartition(':')[2])
        await RemoteEthernetMotors('127.0.0.1', port, turns).act(Action.MOTORS_OFF, 2.0)
        assert not controller.condition.powered
        await asyncio.gather(holding, return_exceptions=True)
        with pytest.raises(IoUnavailableError, match='needed for the motors'):
            await asked
        await until(lambda: client.io.states)


MORE = {'digital_inputs': 4000, 'digital_outputs': 4000}
"""What a profile says of a controller that has fewer."""


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('profile', 'said'),
    [('rc700a', '(error 15)'), ('motoman', 'the controller refused it: ')],
)
async def test_inv9_points_that_only_the_profile_has_are_told_and_not_shown_as_0(profile, said):
    async with simulated(profile=profile) as (_, ports):
        port = ports.remote if profile == 'rc700a' else ports.io
        more = replace(load_controller_profile(profile).io, **MORE)
        async with Client(port, profile=more) as client:
            await until(lambda: any(said in told for told in client.told))
            assert client.io.states == ()
            (answer,) = await client.io.read([IoAddress(DI, 3999)])
            assert answer.text
            assert answer.result != IoResult.SUCCESS


@pytest.mark.invariant(9)
async def test_inv9_an_answer_that_is_no_number_is_told_with_its_command():
    async def attend(reader, writer):
        while line := await reader.readline():
            name = line.decode().strip('$\r\n').split(',')[0]
            writer.write(f'#{name},{"0" if name == "Login" else "zz"}\r\n'.encode())
        writer.close()

    server = await asyncio.start_server(attend, '127.0.0.1', 0)
    port = server.sockets[0].getsockname()[1]
    async with Client(port, profile=load_controller_profile('rc700a').io) as client:
        await until(lambda: any("'zz' is no answer to " in told for told in client.told))
        assert client.io.states == ()
    server.close()
