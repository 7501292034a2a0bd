# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""I/O by Remote Ethernet and by MotoROS' messages, against the simulated controllers."""

import asyncio
import contextlib
import re
from dataclasses import replace

import pytest
from support.driver_harness import simulated
from support.event_loop import until
from support.sim_process import vacant_port

from epson_driver.driver.io.io_access import make_io
from epson_driver.driver.io.io_driver import IoUnavailableError
from epson_driver.driver.io.polled_io import MAX_POINTS, ranges_of, rejection
from epson_driver.driver.stopping.motors import Action, RemoteEthernetMotors
from epson_driver.profiles import load_controller_profile
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.turns import RemoteTurns
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_text import parse
from epson_driver.simple_message import LITTLE_ENDIAN, IoAddress, IoResult, IoSetting

DI, DO, AI, AO, GI, GO, FLAG = range(1, 8)

BOTH = pytest.mark.parametrize('profile', ['rc700a', 'motoman'])


@contextlib.asynccontextmanager
async def io_at(profile, ports, *, timeout=1.0, turns=None):
    """Run the I/O of a driver; `told` on it has every state that it told."""
    io = make_io(
        load_controller_profile(profile).io,
        '127.0.0.1',
        (ports[0], ports[1]),
        byte_order=LITTLE_ENDIAN.byte_order,
        timeout=timeout,
        turns=turns or RemoteTurns(),
    )
    io.told = []
    io.on_states = lambda: io.told.append(io.reason or {i.io_type: i.values for i in io.states})
    task = asyncio.create_task(io.run())
    try:
        yield io
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def cell(profile, **options):
    async with (
        simulated(profile=profile) as (controller, ports),
        io_at(profile, (ports.io, ports.remote), **options) as io,
    ):
        await until(lambda: io.states)
        yield io, controller


@BOTH
async def test_inputs_are_shown_as_they_change(profile):
    async with cell(profile) as (io, controller):
        controller.io.set_input(DI, 3, 1)
        await until(lambda: io.told[-1][DI][3] == 1)
        assert len(io.told[-1][DI]) == controller.io.profile.digital_inputs
        controller.io.set_input(DI, 3, 0)
        await until(lambda: io.told[-1][DI][3] == 0)


@BOTH
async def test_points_and_groups_are_read_and_written(profile):
    async with cell(profile) as (io, controller):
        controller.io.set_input(GI, 1, 0x81)
        written = await io.write([IoSetting(DO, 1, 1), IoSetting(GO, 1, 0x5A)])
        assert [answer.text for answer in written] == ['', '']
        addresses = [(DI, 8), (DI, 9), (GI, 1), (DO, 1), (GO, 0), (GO, 1)]
        answers = await io.read([IoAddress(*each) for each in addresses])
        assert [answer.value for answer in answers] == [1, 0, 0x81, 1, 2, 0x5A]
        assert all(answer.result == IoResult.SUCCESS for answer in answers)


async def test_remote_ethernet_has_words_and_memory_bits():
    async with cell('rc700a') as (io, controller):
        controller.io.set_input(GI, 1000, 0xA55A)
        settings = [IoSetting(GO, 1000, 0xF00F), IoSetting(FLAG, 511, 1)]
        assert [each.text for each in await io.write(settings)] == ['', '']
        addresses = [IoAddress(GI, 1000), IoAddress(GO, 1000), IoAddress(FLAG, 511)]
        assert [each.value for each in await io.read(addresses)] == [0xA55A, 0xF00F, 1]


async def test_outputs_of_motoman_are_shown_too():
    async with cell('motoman') as (io, _):
        await io.write([IoSetting(DO, 39, 1)])
        await until(lambda: io.told[-1][DO][39] == 1)


@BOTH
@pytest.mark.parametrize(
    ('item', 'expected'),
    [
        ((AI, 0), 'AI 0: the controller has no AI'),
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
    async with cell(profile) as (io, _):
        ask, kind = (io.write, IoSetting) if len(item) == 3 else (io.read, IoAddress)
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


@BOTH
@pytest.mark.invariant(6)
async def test_where_nothing_listens_it_is_said_once_and_each_request_is_answered(profile):
    async with io_at(profile, (vacant_port(), vacant_port())) as io:
        await until(lambda: io.told)
        await asyncio.sleep(5.0)
        assert len(io.told) == 1
        assert 'refused' in io.told[0]
        with pytest.raises(IoUnavailableError, match='refused'):
            await io.read([IoAddress(DI, 0)])


@pytest.mark.invariant(6)
async def test_a_cut_link_is_told_and_the_values_come_back():
    async with cell('motoman') as (io, controller):
        controller.faults.start(parse('cut port=io for=2'))
        await until(lambda: not io.states)
        assert 'no I/O link' in io.told[-1]
        await until(lambda: io.states)
        assert [isinstance(each, dict) for each in io.told] == [True, False, True]


@BOTH
@pytest.mark.invariant(9)
async def test_a_port_that_never_answers_ends_each_request_in_its_time(profile):
    async def hear(reader, writer):
        await reader.read()
        writer.close()

    quiet = await asyncio.start_server(hear, '127.0.0.1', 0)
    port = quiet.sockets[0].getsockname()[1]
    async with quiet, io_at(profile, (port, port), timeout=0.5) as io:
        await asyncio.sleep(0.2)
        async with asyncio.timeout(20.0):
            with pytest.raises(IoUnavailableError, match='may have been written'):
                await io.write([IoSetting(DO, 0, 1)])
        assert not io.states


@BOTH
async def test_a_port_of_0_is_not_used_and_says_so(profile):
    async with io_at(profile, (0, 0)) as io:
        assert not io.used
        with pytest.raises(IoUnavailableError, match=r'I/O is not used: .*port.* is 0'):
            await io.read([IoAddress(DI, 0)])


async def test_outputs_are_not_set_while_the_controller_is_not_ready_and_the_answer_says_why():
    async with cell('rc700a') as (io, controller):
        controller.apply(Event.ESTOP_PRESS)
        (read,) = await io.read([IoAddress(DI, 0)])
        assert read.text == ''
        (shown,) = await io.read([IoAddress(DO, 0)])
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

    async with cell('rc700a', turns=turns) as (io, controller):
        holding = asyncio.create_task(turns.patient(hold))
        await held.wait()
        asked = asyncio.create_task(io.read([IoAddress(DI, 0)]))
        await asyncio.sleep(0.1)
        port = int(io.place.rpartition(':')[2])
        await RemoteEthernetMotors('127.0.0.1', port, turns).act(Action.MOTORS_OFF, 2.0)
        assert not controller.condition.powered
        await asyncio.gather(holding, return_exceptions=True)
        with pytest.raises(IoUnavailableError, match='needed for the motors'):
            await asked
        await until(lambda: io.states)


MORE = {'digital_inputs': 4000, 'digital_outputs': 4000}
"""What a profile says of a controller that has fewer."""


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('profile', 'said'),
    [('rc700a', '(error 15)'), ('motoman', 'the controller refused it: ')],
)
async def test_inv9_points_that_only_the_profile_has_are_told_and_not_shown_as_0(profile, said):
    async with simulated(profile=profile) as (_, ports):
        io = make_io(
            replace(load_controller_profile(profile).io, **MORE),
            '127.0.0.1',
            (ports.io, ports.remote),
            byte_order=LITTLE_ENDIAN.byte_order,
            timeout=1.0,
            turns=RemoteTurns(),
        )
        reasons = []
        io.on_states = lambda: reasons.append(io.reason)
        task = asyncio.create_task(io.run())
        await until(lambda: any(said in reason for reason in reasons))
        assert io.states == ()
        (answer,) = await io.read([IoAddress(DI, 3999)])
        assert answer.text
        assert answer.result != IoResult.SUCCESS
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@BOTH
async def test_inv9_io_without_a_port_says_so_and_asks_nobody(profile):
    async with io_at(profile, (0, 0), timeout=0.25) as io:
        await until(lambda: io.told)
        assert not io.used
        assert io.timeout == 0.25
        assert io.told == [io.reason]
        with pytest.raises(IoUnavailableError, match=re.escape(io.reason)):
            await io.read([IoAddress(DI, 0)])


@BOTH
async def test_more_points_than_one_request_may_have_are_refused_at_once(profile):
    async with io_at(profile, (1, 1)) as io:
        with pytest.raises(IoUnavailableError, match=f'{MAX_POINTS + 1} points in one request'):
            await io.read([IoAddress(DI, 0)] * (MAX_POINTS + 1))


@pytest.mark.invariant(9)
async def test_inv9_an_answer_that_is_no_number_is_told_with_its_command():
    async def attend(reader, writer):
        while line := await reader.readline():
            name = line.decode().strip('$\r\n').split(',')[0]
            writer.write(f'#{name},{"0" if name == "Login" else "zz"}\r\n'.encode())
        writer.close()

    server = await asyncio.start_server(attend, '127.0.0.1', 0)
    port = server.sockets[0].getsockname()[1]
    async with io_at('rc700a', (0, port)) as io:
        await until(lambda: any("'zz' is no answer to " in told for told in io.told))
        assert io.states == ()
    server.close()
