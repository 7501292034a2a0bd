# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Real-time Motion Control on the network, over loopback."""

import asyncio
import socket
import time
from contextlib import asynccontextmanager, closing, suppress
from dataclasses import replace

import pytest
from support.event_loop import run
from support.ros_peer import PATIENCE

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.rtmc.messages import Request, RtmcMessage, RtmcStatus, decode
from epson_driver.rtmc.transport import Transport, TransportError
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.rtmc_port import RtmcPort

HOST = '127.0.0.1'
REMOTE = load_controller_profile('remote')
PROFILE = replace(REMOTE, rtmc=replace(REMOTE.rtmc, port=7000))


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HOST, 0))
        return free.getsockname()[1]


@asynccontextmanager
async def served(port):
    servers = ControllerServers(
        new_controller(load_robot_model('c8_c901s'), PROFILE), rtmc_port=port
    )
    await servers.open(HOST, Ports(0, 0, 0, 0))
    running = asyncio.create_task(servers.run())
    try:
        yield running
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError, ZeroDivisionError):
            await running
        await servers.close()


def send(client, number, low=0):
    end = time.monotonic() + PATIENCE
    while not client.write(RtmcMessage(number, low, 0, b'\0').encode()):
        assert time.monotonic() < end
        time.sleep(0.01)


def received(client, number, within=PATIENCE):
    """Return the next message with a number, or None, and skip others."""
    end = time.monotonic() + within
    while time.monotonic() < end:
        arrival = client.take(0.1)
        if arrival is not None and (message := decode(arrival.data)).number == number:
            return message
    return None


def session(port):
    with closing(Transport(HOST, peer=(HOST, port))) as client:
        end = time.monotonic() + PATIENCE
        reply = None
        while reply is None:  # not answered until the previous client is lost
            assert time.monotonic() < end
            send(client, Request.CONNECT, 1)
            reply = received(client, Request.CONNECT, 1.0)
        assert reply.high
        for _ in range(3):
            assert received(client, Request.STATUS_NOTICE)
        send(client, Request.STATUS)
        return RtmcStatus.decode(received(client, Request.STATUS))


def test_each_of_two_successive_clients_gets_replies_and_notices(port):
    async def main():
        async with served(port) as running:
            for _ in range(2):
                assert not (await asyncio.to_thread(session, port)).error
            assert not running.done()

    run(main(), real_time=True)


def test_exception_in_real_time_motion_ends_the_servers(port, monkeypatch):
    monkeypatch.setattr(RtmcPort, 'receive', lambda *_: 1 // 0)

    async def main():
        async with served(port) as running:
            with closing(Transport(HOST, peer=(HOST, port))) as client:
                await asyncio.to_thread(send, client, Request.CONNECT, 1)
                with pytest.raises(ZeroDivisionError):
                    await asyncio.wait_for(running, PATIENCE)

    run(main(), real_time=True)


def test_occupied_port_is_an_error_at_the_start(port):
    async def main():
        with closing(Transport(HOST, port)), pytest.raises(TransportError, match='in use'):
            async with served(port):
                pass

    run(main(), real_time=True)
