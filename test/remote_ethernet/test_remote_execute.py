# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The commands of `execute`: invalid answers, retries before the login, silent ports."""

import asyncio
import socket

import pytest

from epson_driver.remote_ethernet.client import MAX_LOGINS, RemoteError, execute

HOST = '127.0.0.1'


@pytest.mark.parametrize(
    ('answer', 'error', 'text'),
    [
        (b'hello\r\n', ConnectionError, "'hello' is not a reply to Login"),
        (b'#GetStatus,1\r\n', ConnectionError, 'is not a reply to Login'),
        (b'!Login,what\r\n', ConnectionError, 'is not a reply to Login'),
        (b'', ConnectionError, 'closed by the controller before the reply to Login'),
        (b'x' * 200_000, ConnectionError, 'is longer than 65536 bytes'),
        (b'!Login,13\r\n', RemoteError, r'the password is wrong \(error 13\)'),
        (b'!Login,77\r\n', RemoteError, r'unknown error number \(error 77\)'),
    ],
)
async def test_invalid_answer_to_a_remote_command_raises_an_error(answer, error, text):
    async def serve(reader, writer):
        await reader.readline()
        writer.write(answer)
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, HOST, 0)
    port = server.sockets[0].getsockname()[1]
    with pytest.raises(error, match=text):
        await execute(HOST, port, ['Reset'], 20)
    server.close()


@pytest.mark.invariant(9)
@pytest.mark.parametrize('how', ['end', 'reset'])
async def test_inv9_connection_lost_before_the_login_is_retried(how):
    connections = 0
    asked = []

    async def serve(reader, writer):
        nonlocal connections
        connections += 1
        if connections < MAX_LOGINS:
            if how == 'reset':
                writer.transport.abort()
            writer.close()
            return
        for name in (b'Login', b'Reset'):
            asked.append(await reader.readline())
            writer.write(b'#%s,0\r\n' % name)
        writer.close()  # no answer to the logout is needed

    server = await asyncio.start_server(serve, HOST, 0)
    port = server.sockets[0].getsockname()[1]
    assert await execute(HOST, port, ['Reset'], 20) == ['0']
    assert asked == [b'$Login,\r\n', b'$Reset\r\n']
    assert connections == MAX_LOGINS
    with pytest.raises(ConnectionError, match=f'{HOST}:{port}: .*'):
        await execute(HOST, port, ['Reset', 'Stop'], 20)
    assert connections == MAX_LOGINS + 1  # a command is never repeated
    server.close()


async def test_silent_or_closed_remote_port_raises_an_error():
    with socket.create_server((HOST, 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(TimeoutError):
            await execute(HOST, port, ['Reset'], 0.1)
    with pytest.raises(ConnectionError, match=rf'{HOST}:{port}: '):
        await execute(HOST, port, ['Reset'], 20)
