# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ports on sockets."""

import asyncio
import socket
import struct
from contextlib import asynccontextmanager, suppress
from dataclasses import replace

import pytest
from support.controller_harness import FAILURE, MODEL, PROFILE, STOP, SUCCESS, frame, point
from support.event_loop import run, stand_still, until

from epson_driver.sim_controller.arm.planner_process import PlannerProcess
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.client_connections import MAX_CATCH_UP_SLOTS
from epson_driver.sim_controller.condition.states import Event, Motors
from epson_driver.sim_controller.network import tcp_connection
from epson_driver.sim_controller.network.port_server import HALF_CLOSED_S
from epson_driver.sim_controller.network.servers import ControllerServers, Ports

HOST = '127.0.0.1'
FREE = Ports(0, 0, 0, 0)
SLOW = 0.05  # of the maximum speed, so that the move lasts
FAR = (2.0, 0.5)


class Served:
    """Servers on free ports, and the clients of a test."""

    def __init__(self, servers, controller, ports):
        self.servers, self.controller, self.ports = servers, controller, ports
        self.writers = []

    async def connect(self, port='motion'):
        reader, writer = await asyncio.open_connection(HOST, getattr(self.ports, port))
        self.writers.append(writer)
        return reader, writer


def on_sockets(test, real_time=False):
    """Decorate a coroutine test: run it with running servers in the event loop of tests.

    real_time: for tests that depend on timers of the operating system.
    """

    def on_loop():
        async def main():
            async with serving() as served:
                await test(served)

        run(main(), real_time=real_time)

    on_loop.__name__ = test.__name__
    return on_loop


@asynccontextmanager
async def serving(profile=PROFILE, smooth=False):
    planner = PlannerProcess(MODEL.limits) if smooth else None
    controller = new_controller(MODEL, profile, planner=planner)
    servers = ControllerServers(controller, planner=planner)
    served = Served(servers, controller, await servers.open(HOST, FREE))
    cycle = asyncio.create_task(servers.run())
    try:
        yield served
        assert not cycle.done()
    finally:
        cycle.cancel()
        for writer in served.writers:
            writer.close()
        await servers.close()


async def read_frame(reader, order='<'):
    prefix = await reader.readexactly(4)
    data = await reader.readexactly(struct.unpack(order + 'i', prefix)[0])
    return (*struct.unpack_from(order + '3i', data), data[12:])


async def read_to_the_end(reader):
    with suppress(asyncio.IncompleteReadError, ConnectionResetError):
        while True:
            await read_frame(reader)


async def read_code(reader):
    msg_type, comm_type, reply_code, body = await read_frame(reader)
    assert (msg_type, comm_type, len(body)) == (10, 3, 44)
    return struct.unpack_from('<i', body)[0], reply_code


@on_sockets
async def test_points_are_executed_and_answered(served):
    served.controller.apply(Event.MOTORS_ON)
    reader, writer = await served.connect()
    for sequence, joints in enumerate([(), (0.1, -0.1), (0.0, 0.2), ()]):
        writer.write(point(sequence, joints))
        assert await read_code(reader) == (sequence, SUCCESS)
    await until(lambda: not served.controller.in_motion)


@pytest.mark.parametrize('port', ['motion', 'state'])
async def test_surplus_client_replaces_the_oldest_unless_the_arm_moves(port):
    """The behaviour of MotoROS, selected by `server.full` of the profile."""
    server = replace(PROFILE.server, full='replace', lost_client='keep', state_clients=1)

    async with serving(replace(PROFILE, server=server)) as served:
        served.controller.apply(Event.MOTORS_ON)
        commands = (await served.connect('motion'))[1]
        oldest = (await served.connect(port))[0] if port == 'state' else None
        commands.write(point(0, FAR, SLOW))
        await until(lambda: served.controller.in_motion)
        refused, _ = await served.connect(port)
        assert await rejected(refused)
        commands.write(point(STOP))
        await until(lambda: not served.controller.moving)
        newest, newest_writer = await served.connect(port)
        newest_writer.write(frame(1, 2, 0))
        assert (await read_until(newest, 1))[1:] == (3, SUCCESS, b'')
        if oldest is not None:
            await read_to_the_end(oldest)
        assert served.controller.condition.motors is Motors.ON


async def read_until(reader, msg_type):
    while True:
        received = await read_frame(reader)
        if received[0] == msg_type:
            return received


async def rejected(reader):
    try:
        return await reader.read() == b''
    except ConnectionResetError:
        return True


@pytest.mark.invariant(4)
@pytest.mark.parametrize('how', ['close', 'reset', 'half close'])
def test_inv4_lost_client_stops_the_arm_and_may_reconnect(how):
    async def test(served):
        controller = served.controller
        controller.apply(Event.MOTORS_ON)
        reader, writer = await served.connect()
        writer.write(point(0, FAR, SLOW))
        await until(lambda: controller.in_motion)
        sock = writer.get_extra_info('socket')
        if how == 'reset':
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
        if how == 'half close':
            writer.write_eof()
            assert await read_code(reader) == (0, FAILURE)
            assert await reader.read() == b''
        writer.close()
        await until(lambda: controller.condition.motors is Motors.OFF)
        assert not controller.in_motion
        stood = controller.joint_position()
        reader, writer = await served.connect()
        writer.write(point(0, FAR))
        assert await read_code(reader) == (0, FAILURE)
        assert controller.joint_position() == stood
        assert controller.status().error_code == 4031
        controller.apply(Event.MOTORS_ON)
        writer.write(point(0, (0.1,)))
        assert await read_code(reader) == (0, SUCCESS)

    on_sockets(test)()


@on_sockets
async def test_immediate_reconnection_is_accepted(served):
    topics = frame(999, 1, 0) * 1000  # several reads, so the end is detected late
    for index in range(50):
        reader, writer = await served.connect()
        writer.write(point(STOP))
        assert await read_code(reader) == (STOP, SUCCESS)
        writer.write(topics if index % 2 else b'')
        writer.close()


@pytest.mark.invariant(7)
@on_sockets
async def test_inv7_garbage_ends_the_connection_and_the_next_one_works(served):
    for garbage in (b'GET / HTTP/1.0\r\n\r\n', bytes(64), b'\xff' * 5000, point(0, order='>')):
        served.controller.apply(Event.MOTORS_ON)
        reader, writer = await served.connect()
        writer.write(garbage)
        assert await rejected(reader)
        assert served.controller.condition.motors is Motors.OFF
        assert served.controller.status().error_code == 8000
    served.controller.apply(Event.MOTORS_ON)
    reader, writer = await served.connect()
    writer.write(point(0))
    assert await read_code(reader) == (0, SUCCESS)


@pytest.mark.invariant(7)
def test_inv7_client_that_reads_no_replies_is_disconnected(caplog, monkeypatch):
    monkeypatch.delitem(tcp_connection.KEEPALIVE, 'TCP_USER_TIMEOUT')  # before a TCP timeout

    async def test(served):
        sock = socket.socket()
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # a small buffer
        sock.setblocking(False)
        await asyncio.get_running_loop().sock_connect(sock, (HOST, served.ports.motion))
        _, writer = await asyncio.open_connection(sock=sock)
        served.writers.append(writer)
        writer.transport.pause_reading()
        served.controller.apply(Event.MOTORS_ON)
        pings = frame(1, 2, 0, bytes(40)) * 1000

        async def ping_repeatedly():
            while True:
                writer.write(pings)
                await writer.drain()

        with pytest.raises(ConnectionError):
            await ping_repeatedly()
        await until(lambda: served.controller.condition.motors is Motors.OFF)

    on_sockets(test, real_time=True)()  # the system's buffers fill in real time
    assert 'does not read: disconnected' in caplog.text


@pytest.mark.invariant(7)
def test_inv7_flood_of_requests_does_not_stop_state_messages():
    async def main():
        async with serving() as served:
            state, _ = await served.connect('state')
            reader, writer = await served.connect()
            flood = frame(999, 2, 0) * 20_000
            answered = 0

            async def flood_repeatedly():
                nonlocal answered
                while True:
                    writer.write(flood)
                    for _ in range(20_000):
                        assert (await read_frame(reader))[:3] == (999, 3, 2)
                        answered += 1

            flooding = asyncio.create_task(flood_repeatedly())
            await until(lambda: answered)
            for _ in range(20):
                await read_frame(state)
            assert not flooding.done()
            flooding.cancel()
            with suppress(asyncio.CancelledError):
                await flooding

    run(main(), real_time=True)  # a flood uses processor time


# ---- smooth motion


def test_smooth_motion_runs_through_sockets_and_a_planner_process():
    async def main():
        async with serving(smooth=True) as served:
            served.controller.apply(Event.MOTORS_ON)
            reader, writer = await served.connect()
            for sequence in range(40):
                writer.write(point(sequence, (0.01 * sequence, -0.005 * sequence), 0.0, 0.03))
                assert await read_code(reader) == (sequence, SUCCESS)
            assert served.controller.status().in_motion == 1
            await until(lambda: not served.controller.in_motion)
            assert served.controller.joint_position().joints[0] == pytest.approx(0.39)
            writer.write(point(0, FAR, SLOW))
            assert await read_code(reader) == (0, SUCCESS)
            await until(lambda: served.controller.joint_position().joints[0] > 0.4)
            writer.write(point(STOP))
            assert await read_code(reader) == (STOP, SUCCESS)
            await until(lambda: not served.controller.in_motion)
            assert served.controller.joint_position().joints[0] < 1.9

    run(main(), real_time=True)


# ---- state port


@on_sockets
async def test_status_bytes_follow_ten_joint_positions(served):
    reader, _ = await served.connect('state')
    joints = bytes.fromhex('38000000 0a000000 01000000 00000000') + bytes(44)
    status = bytes.fromhex(
        '28000000 0d000000 01000000 00000000'
        '00000000 00000000 00000000 00000000 00000000 02000000 00000000'
    )
    assert await reader.readexactly(60 * 10 + 44) == joints * 10 + status
    served.controller.apply(Event.MOTORS_ON)
    status = status[:16] + bytes.fromhex(
        '01000000 00000000 00000000 00000000 00000000 02000000 01000000'
    )
    assert await reader.readexactly(60 * 10 + 44) == joints * 10 + status


@pytest.mark.invariant(7)
async def test_inv7_half_closed_state_client_is_disconnected_in_time():
    """A proxy without a client reads forever and must not block the driver."""
    server = replace(PROFILE.server, lost_client='keep', state_clients=3)

    async with serving(replace(PROFILE, server=server)) as served:

        async def client():
            reader, writer = await served.connect('state')
            await read_frame(reader)
            return writer, asyncio.create_task(read_to_the_end(reader))

        _, whole = await client()
        halves = [await client() for _ in range(2)]
        for writer, _ in halves:
            writer.write_eof()
        await asyncio.sleep(0.9 * HALF_CLOSED_S)
        assert served.servers.clients('state') == 3
        for _, half in halves:
            await half
        assert served.servers.clients('state') == 1
        for _ in halves:
            await client()
        assert await rejected((await served.connect('state'))[0])
        assert not whole.done()


@on_sockets
async def test_requests_on_the_state_port_are_answered_in_order(served):
    reader, writer = await served.connect('state')
    writer.write(frame(1, 2, 0) + frame(2, 2, 0) + frame(13, 2, 0, bytes(28)))
    writer.write(frame(10, 2, 0, bytes(44)) + point(0) + frame(7, 2, 0) + frame(1, 5, 0))
    writer.write(frame(0, 2, 0) + frame(13, 1, 0, bytes(28)))
    replies = []
    while len(replies) < 7:
        msg_type, comm_type, reply_code, body = await read_frame(reader)
        if comm_type == 3:
            replies.append((msg_type, reply_code, len(body)))
    assert replies == [
        (1, 1, 0),
        (2, 1, 12),
        (13, 1, 28),
        (10, 1, 44),
        (11, 2, 0),
        (7, 2, 0),
        (1, 2, 0),
    ]
    assert not served.controller.in_motion


@on_sockets
async def test_garbage_on_the_state_or_io_port_ends_one_connection(served):
    good, _ = await served.connect('state')
    for port in ('state', 'io'):
        reader, writer = await served.connect(port)
        writer.write(b'\xff' * 100)
        await read_to_the_end(reader)
    for _ in range(11):
        await read_frame(good)


@pytest.mark.parametrize('message', ['joint_position', 'joint_feedback'])
async def test_stalled_state_client_is_kept_for_two_seconds(message):
    """After a common stall the controller sends the missed slots into a small buffer."""
    profile = replace(PROFILE, state=replace(PROFILE.state, message=message))

    async with serving(profile) as served:
        sock = socket.socket()
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sock.setblocking(False)
        await asyncio.get_running_loop().sock_connect(sock, (HOST, served.ports.state))
        reader, writer = await asyncio.open_connection(sock=sock)
        served.writers.append(writer)
        await read_frame(reader)
        writer.transport.pause_reading()
        for _ in range(2):
            stand_still(1.0)
            await asyncio.sleep(0.01)
        writer.transport.resume_reading()
        for _ in range(3 * MAX_CATCH_UP_SLOTS):
            await read_frame(reader)
        assert served.servers.clients('state') == 1


@pytest.mark.invariant(6)
def test_inv6_state_client_that_does_not_read_is_disconnected(caplog, monkeypatch):
    monkeypatch.delitem(tcp_connection.KEEPALIVE, 'TCP_USER_TIMEOUT')  # before a TCP timeout

    async def main():
        profile = replace(PROFILE, state=replace(PROFILE.state, period=0.001))
        async with serving(profile) as served:
            sock = socket.socket()
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            sock.setblocking(False)
            await asyncio.get_running_loop().sock_connect(sock, (HOST, served.ports.state))
            good, _ = await served.connect('state')
            data = 0
            await until(lambda: served.servers.clients('state') == 2)
            while served.servers.clients('state') == 2:  # the other client is still served
                data += len((await read_frame(good))[3])
            assert served.servers.clients('state') == 1
            for _ in range(20):
                await read_frame(good)
            sock.close()

    run(main(), real_time=True)
    assert 'does not read: disconnected' in caplog.text


@on_sockets
async def test_used_or_invalid_port_is_refused_with_its_name(served):
    other = ControllerServers(new_controller(MODEL, PROFILE))
    taken = Ports(0, served.ports.state, 0, 0)
    with pytest.raises(OSError, match=rf'state port {HOST}:{served.ports.state}: .*in use'):
        await other.open(HOST, taken)
    with pytest.raises(OSError, match='motion port'):
        await other.open(HOST, Ports(70_000, 0, 0, 0))


@on_sockets
async def test_servers_close_while_clients_are_connected(served):
    reader, writer = await served.connect()
    state, _ = await served.connect('state')
    served.controller.apply(Event.MOTORS_ON)
    writer.write(point(0, FAR, SLOW))
    await until(lambda: served.controller.in_motion)
    await served.servers.close()
    await read_to_the_end(state)
    assert await read_code(reader) == (0, FAILURE)


# ---- remote port and its client


@pytest.mark.invariant(9)
async def test_exception_in_a_session_ends_the_controller(monkeypatch):
    controller = new_controller(MODEL, PROFILE)
    servers = ControllerServers(controller)
    ports = await servers.open(HOST, FREE)
    monkeypatch.setattr(controller.clients, 'connect', None)
    ended = asyncio.create_task(servers.run_until(asyncio.Event()))
    _, writer = await asyncio.open_connection(HOST, ports.motion)
    with pytest.raises(TypeError, match='not callable'):
        await ended
    writer.close()
    await servers.close()
