# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The network in memory ends connections, and holds bytes back, as the system's does."""

import asyncio

import pytest

from simulation.network import HIGH_WATER_BYTES, HOST, PROCESS, Network
from simulation.virtual_loop import VirtualLoop


def run(scenario, delay=0.01):
    network = Network(lambda: delay)
    loop = VirtualLoop(network)
    try:
        loop.run_until_complete(scenario(network))
    finally:
        loop.bury()


async def connected(network):
    listener = network.create_server((HOST, 0))
    port = listener.getsockname()[1]
    reader, writer = await asyncio.open_connection(HOST, port)
    sock, _ = listener.accept()
    return port, (reader, writer), await asyncio.open_connection(sock=sock)


def test_bytes_come_in_order_after_the_delay_and_then_the_end():
    async def scenario(network):
        _, (_, writer), (reader, _) = await connected(network)
        began = asyncio.get_running_loop().time()
        writer.write(b'one ')
        writer.write(b'two')
        writer.close()
        assert await reader.read() == b'one two'
        assert 0.01 <= asyncio.get_running_loop().time() - began < 0.011

    run(scenario)


def test_a_port_on_which_nobody_listens_refuses():
    async def scenario(_network):
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(HOST, 1)

    run(scenario)


def test_a_reset_drops_what_was_not_read():
    async def scenario(network):
        port, (_, writer), (reader, _) = await connected(network)
        writer.write(b'lost')
        network.reset(port)
        with pytest.raises(ConnectionResetError):
            await reader.read()

    run(scenario)


def test_nothing_is_read_behind_the_end():
    async def scenario(network):
        port, (_, writer), (reader, _) = await connected(network)
        network.half_close(port)
        writer.write(b'too late')
        assert await reader.read() == b''
        await asyncio.sleep(0.1)

    run(scenario)


def test_a_stalled_port_holds_back_everything_until_it_is_released():
    async def scenario(network):
        port, (_, writer), (reader, _) = await connected(network)
        network.stall(port)
        writer.write(b'late')
        asyncio.get_running_loop().call_later(2.0, network.release, port)
        began = asyncio.get_running_loop().time()
        assert await reader.read(4) == b'late'
        assert asyncio.get_running_loop().time() - began >= 2.0

    run(scenario)


def test_what_nobody_reads_counts_as_unsent_and_whoever_sends_waits():
    async def scenario(network):
        _, (_, writer), (reader, _) = await connected(network)
        writer.write(bytes(4 * HIGH_WATER_BYTES))
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.0):
                await writer.drain()
        assert writer.transport.get_write_buffer_size() > 0
        left = 4 * HIGH_WATER_BYTES
        while left:
            left -= len(await reader.read(HIGH_WATER_BYTES))
        await writer.drain()

    run(scenario)


def test_a_process_that_dies_closes_its_connections_and_does_nothing_more():
    async def scenario(network):
        loop = asyncio.get_running_loop()
        beats = []

        async def beat():
            _, writer = await asyncio.open_connection(HOST, port)
            while True:
                writer.write(b'.')
                beats.append(loop.time())
                await asyncio.sleep(0.1)

        listener = network.create_server((HOST, 0))
        port = listener.getsockname()[1]
        token = PROCESS.set('peer')
        task = asyncio.create_task(beat())
        PROCESS.reset(token)
        await asyncio.sleep(0.35)
        reader, _ = await asyncio.open_connection(sock=listener.accept()[0])
        loop.kill('peer')
        count = len(beats)
        assert await reader.read() == b'.' * count
        await asyncio.sleep(1.0)
        assert len(beats) == count
        assert not task.done()

    run(scenario)


def test_a_process_that_hangs_does_afterwards_what_is_overdue():
    async def scenario(_network):
        loop = asyncio.get_running_loop()
        seen = []
        token = PROCESS.set('peer')
        for after in (0.2, 0.1):
            loop.call_later(after, seen.append, after)
        PROCESS.reset(token)
        loop.hang('peer')
        await asyncio.sleep(1.0)
        assert not seen
        loop.go_on('peer')
        await asyncio.sleep(0.01)
        assert seen == [0.1, 0.2]

    run(scenario)
