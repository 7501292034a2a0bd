# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The network in memory ends connections and delays bytes like the operating system."""

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


def test_bytes_arrive_in_order_after_the_delay_followed_by_the_end():
    async def scenario(network):
        _, (_, writer), (reader, _) = await connected(network)
        start = asyncio.get_running_loop().time()
        writer.write(b'one ')
        writer.write(b'two')
        writer.close()
        assert await reader.read() == b'one two'
        assert 0.01 <= asyncio.get_running_loop().time() - start < 0.011

    run(scenario)


def test_closed_port_refuses_connections():
    async def scenario(_network):
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(HOST, 1)

    run(scenario)


def test_reset_drops_unread_bytes():
    async def scenario(network):
        port, (_, writer), (reader, _) = await connected(network)
        writer.write(b'lost')
        network.reset(port)
        with pytest.raises(ConnectionResetError):
            await reader.read()

    run(scenario)


def test_bytes_after_the_end_are_not_read():
    async def scenario(network):
        port, (_, writer), (reader, _) = await connected(network)
        network.half_close(port)
        writer.write(b'too late')
        assert await reader.read() == b''
        await asyncio.sleep(0.1)

    run(scenario)


def test_stalled_port_delays_bytes_until_it_is_released():
    async def scenario(network):
        port, (_, writer), (reader, _) = await connected(network)
        network.stall(port)
        writer.write(b'late')
        asyncio.get_running_loop().call_later(2.0, network.release, port)
        start = asyncio.get_running_loop().time()
        assert await reader.read(4) == b'late'
        assert asyncio.get_running_loop().time() - start >= 2.0

    run(scenario)


def test_unread_bytes_count_as_unsent_and_block_the_sender():
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


def test_killed_process_closes_its_connections_and_runs_no_more():
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


def test_stopped_process_runs_overdue_timers_in_order_later():
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
