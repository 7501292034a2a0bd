# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Turns and answers of Remote Ethernet."""

import asyncio

import numpy as np
import pytest
from support.event_loop import PATIENCE, run, until

from epson_driver.remote_ethernet.answers import ask_positions
from epson_driver.remote_ethernet.client import PreemptedError, RemoteError, RemoteTurns, execute


def ask(answer: bytes) -> None:
    """Send `SetMotorsOn,1` to a server that accepts the login and gives this answer."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(b'#Login,0\r\n')
        await reader.readline()
        writer.write(answer)
        await reader.read()
        writer.close()

    async def scenario() -> None:
        async with await asyncio.start_server(serve, '127.0.0.1', 0) as server:
            port = server.sockets[0].getsockname()[1]
            await execute('127.0.0.1', port, ['SetMotorsOn,1'], PATIENCE)

    run(scenario())


def test_refused_remote_command_has_its_error_number():
    with pytest.raises(RemoteError, match='error 16'):
        ask(b'!SetMotorsOn,16\r\n')


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    'answer',
    [
        b'!SetMotorsOn,' + b'9' * 5000 + b'\r\n',
        b'!SetMotorsOn,1234567890\r\n',
        b'!SetMotorsOn,\r\n',
        b'!SetMotorsOn,-1\r\n',
        '!SetMotorsOn,²\r\n'.encode(),
        b'\xff\x00' * 1000 + b'\r\n',
        b'\r\n',
    ],
    ids=['5,000 digits', '10 digits', 'none', 'negative', 'no decimal', 'bytes', 'nothing'],
)
def test_inv9_malformed_answer_is_a_connection_error(answer):
    """`int` raises ValueError for more than 4,300 digits."""
    with pytest.raises(ConnectionError, match='is not a reply to SetMotorsOn') as error:
        ask(answer)
    assert len(str(error.value)) < 600


@pytest.mark.invariant(9)
async def test_inv9_unanswered_login_is_retried_on_another_connection():
    """If the port's queue is full, the system retries increasingly rarely."""
    logins, ended = [], []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        logins.append(await reader.readline())
        if len(logins) == 3:
            for name in (b'Login', b'Reset', b'Logout'):
                writer.write(b'#%s,0\r\n' % name)
        await reader.read()
        writer.close()
        ended.append(writer)

    async with await asyncio.start_server(serve, '127.0.0.1', 0) as server:
        port = server.sockets[0].getsockname()[1]
        assert await execute('127.0.0.1', port, ['Reset'], PATIENCE) == ['0']
        await until(lambda: len(ended) == 3)
    assert logins == [b'$Login,\r\n'] * 3


async def test_refused_logout_is_not_a_failure():
    """Another client's statement may be running: error 21."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        for answer in (b'#Login,0', b'#Stop,0', b'!Logout,21'):
            await reader.readline()
            writer.write(answer + b'\r\n')
        writer.close()

    async with await asyncio.start_server(serve, '127.0.0.1', 0) as server:
        port = server.sockets[0].getsockname()[1]
        assert await execute('127.0.0.1', port, ['Stop'], PATIENCE) == ['0']


@pytest.mark.parametrize('host', ['a..b', 'a' * 70, 'nul\0'])
def test_invalid_host_name_is_a_connection_error(host):
    with pytest.raises(ConnectionError):
        run(execute(host, 5000, [], PATIENCE))


async def forever():
    await asyncio.Event().wait()


async def test_patient_dialogues_run_in_sequence_and_return_their_results():
    turns, log = RemoteTurns(), []

    async def dialogue(name):
        log.append(f'{name} starts')
        await asyncio.sleep(1.0)
        log.append(f'{name} ends')
        return name

    both = await asyncio.gather(*(turns.patient(lambda n=n: dialogue(n)) for n in 'ab'))
    assert both == ['a', 'b']
    assert log == ['a starts', 'a ends', 'b starts', 'b ends']


@pytest.mark.invariant(3)
async def test_inv3_urgent_dialogue_preempts_running_and_waiting_ones():
    turns, order = RemoteTurns(), []

    async def waiting():
        order.append('waiting')

    async def again():
        return 'again'

    running = asyncio.create_task(turns.patient(forever))
    await asyncio.sleep(0.1)
    next_one = asyncio.create_task(turns.patient(waiting))
    await asyncio.sleep(0.1)
    async with turns.urgent():
        order.append('urgent')
        with pytest.raises(PreemptedError, match='needed for the motors'):
            await running
    with pytest.raises(PreemptedError):
        await next_one
    assert order == ['urgent']
    assert await turns.patient(again) == 'again'


async def test_cancelled_or_failed_dialogue_frees_the_port():
    turns = RemoteTurns()
    running = asyncio.create_task(turns.patient(forever))
    await asyncio.sleep(0.1)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running

    async def fail():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        await turns.patient(fail)
    async with asyncio.timeout(1.0), turns.urgent():
        pass


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'motors', ['nan', 'inf', '1e999', '1_0', '١', '0x1', '', '1 2', '-', '1.0e']
)
async def test_inv7_only_finite_ascii_numbers_are_joints_and_motors(motors):
    async def printed(number):
        return await ask_positions(replying(f'"-90 2e1 {number}"'), ['rad', 'm'])

    assert await printed('1') == ((pytest.approx(-np.pi / 2), 0.02), True)
    with pytest.raises(ConnectionError, match='is not a reply to'):
        await printed(motors)


def replying(value):
    """Return a function with the same reply to each command."""

    async def ask(_command):
        return value

    return ask
