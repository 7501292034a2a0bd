# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ports on real sockets."""

import asyncio
import socket
import struct
from contextlib import asynccontextmanager, suppress
from dataclasses import replace

import pytest
from support.controller_harness import FAILURE, MODEL, PROFILE, STOP, SUCCESS, frame, point
from support.event_loop import run, stand_still, until

from epson_driver.remote_ethernet.client import MAX_LOGINS, RemoteError, execute
from epson_driver.sim_controller.arm.planner_process import PlannerProcess
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.client_connections import MAX_CATCH_UP_SLOTS
from epson_driver.sim_controller.condition.states import Event, Motors
from epson_driver.sim_controller.network import tcp_connection
from epson_driver.sim_controller.network.port_server import HALF_CLOSED_S
from epson_driver.sim_controller.network.servers import ControllerServers, Ports

HOST = '127.0.0.1'
FREE = Ports(0, 0, 0, 0)
SLOW = 0.05  # of the maximum speed: a move that is surely still going on
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
    """Run a coroutine function with `served` in the event loop of tests.

    In real time where the system's own timers take part: a backlog that is full is one.
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


@on_sockets
async def test_one_byte_per_segment(served):
    served.controller.apply(Event.MOTORS_ON)
    reader, writer = await served.connect()
    for byte in point(0, (0.05,)) + frame(1, 2, 0):
        writer.write(bytes([byte]))
        await writer.drain()
        await asyncio.sleep(0)
    frames = [await read_frame(reader), await read_frame(reader)]
    assert sorted(header[:3] for header in frames) == [(1, 3, 1), (10, 3, 1)]


@on_sockets
async def test_a_second_motion_client_is_refused_and_the_first_goes_on(served):
    served.controller.apply(Event.MOTORS_ON)
    reader, writer = await served.connect()
    writer.write(point(0, (0.5,)))
    for _ in range(3):
        second, second_writer = await served.connect()
        second_writer.write(point(STOP))
        assert await rejected(second)
    assert await read_code(reader) == (0, SUCCESS)
    writer.write(point(1))
    assert await read_code(reader) == (1, SUCCESS)
    assert served.controller.condition.motors is Motors.ON


@pytest.mark.parametrize('port', ['motion', 'state'])
async def test_one_client_too_many_replaces_the_oldest_unless_the_arm_moves(port):
    """As MotoROS does, where the profile says so (`server.full`)."""
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
def test_invariant_4_a_lost_client_stops_the_arm_and_may_come_back(how):
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
async def test_a_client_that_reconnects_at_once_is_not_refused_for_its_own_past(served):
    topics = frame(999, 1, 0) * 1000  # several portions: its end is not seen at once
    for index in range(50):
        reader, writer = await served.connect()
        writer.write(point(STOP))
        assert await read_code(reader) == (STOP, SUCCESS)
        writer.write(topics if index % 2 else b'')
        writer.close()


@pytest.mark.invariant(7)
@on_sockets
async def test_invariant_7_garbage_ends_the_connection_and_the_next_one_works(served):
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
def test_invariant_7_a_client_that_does_not_read_its_replies_is_disconnected(caplog, monkeypatch):
    monkeypatch.delitem(tcp_connection.KEEPALIVE, 'TCP_USER_TIMEOUT')  # or TCP gives up first

    async def test(served):
        sock = socket.socket()
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # full soon
        sock.setblocking(False)
        await asyncio.get_running_loop().sock_connect(sock, (HOST, served.ports.motion))
        _, writer = await asyncio.open_connection(sock=sock)
        served.writers.append(writer)
        writer.transport.pause_reading()
        served.controller.apply(Event.MOTORS_ON)
        pings = frame(1, 2, 0, bytes(40)) * 1000

        async def ping_for_ever():
            while True:
                writer.write(pings)
                await writer.drain()

        with pytest.raises(ConnectionError):
            await ping_for_ever()
        await until(lambda: served.controller.condition.motors is Motors.OFF)

    on_sockets(test, real_time=True)()  # the system's buffers fill in their own time
    assert 'does not read: disconnected' in caplog.text


@pytest.mark.invariant(7)
def test_invariant_7_a_flood_of_requests_does_not_stop_the_state():
    async def main():
        async with serving() as served:
            state, _ = await served.connect('state')
            reader, writer = await served.connect()
            flood = frame(999, 2, 0) * 20_000
            answered = 0

            async def flood_for_ever():
                nonlocal answered
                while True:
                    writer.write(flood)
                    for _ in range(20_000):
                        assert (await read_frame(reader))[:3] == (999, 3, 2)
                        answered += 1

            flooding = asyncio.create_task(flood_for_ever())
            await until(lambda: answered)
            for _ in range(20):
                await read_frame(state)
            assert not flooding.done()
            flooding.cancel()
            with suppress(asyncio.CancelledError):
                await flooding

    run(main(), real_time=True)  # what a flood takes is the processor's time


# ---- smooth motion


def test_smooth_motion_through_sockets_and_a_process():
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
async def test_ten_joint_positions_then_a_status_byte_for_byte(served):
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


@on_sockets
async def test_the_state_shows_an_estop_and_the_arm_on_its_way(served):
    served.controller.apply(Event.MOTORS_ON)
    state, _ = await served.connect('state')
    reader, writer = await served.connect()
    writer.write(point(0, (1.0,), 0.5))
    seen = []
    pressed = False
    while not seen or seen[-1] != (0, 1, 2261, 1, 0, 2, 0):
        msg_type, _, _, body = await read_frame(state)
        if msg_type == 13:
            seen.append(struct.unpack('<7i', body))
        if served.controller.joint_position().joints[0] > 0.2 and not pressed:
            with served.servers.pacer.present() as controller:
                controller.apply(Event.ESTOP_PRESS)
            pressed = True
    assert (1, 0, 0, 0, 1, 2, 1) in seen
    assert await read_code(reader) == (0, FAILURE)


@on_sockets
async def test_several_state_clients_and_one_that_shuts_only_its_own_side(served):
    first, first_writer = await served.connect('state')
    second, _ = await served.connect('state')
    first_writer.write_eof()
    for _ in range(22):
        await read_frame(first)
        await read_frame(second)


@pytest.mark.invariant(7)
async def test_invariant_7_a_state_client_that_has_shut_its_own_side_gives_its_place_up():
    """A proxy whose client has gone reads on for ever: the driver must not be kept out."""
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
async def test_requests_on_the_state_port(served):
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
async def test_garbage_on_the_state_or_io_port_ends_that_connection_only(served):
    good, _ = await served.connect('state')
    for port in ('state', 'io'):
        reader, writer = await served.connect(port)
        writer.write(b'\xff' * 100)
        await read_to_the_end(reader)
    for _ in range(11):
        await read_frame(good)


@on_sockets
async def test_requests_on_the_io_port(served):
    reader, writer = await served.connect('io')
    writer.write(frame(1, 2, 0) + frame(65201, 2, 0, struct.pack('<4i', 7, 1, 1, 3)))
    writer.write(frame(65201, 2, 0, bytes(6)) + frame(13, 2, 0, bytes(28)))
    assert (await read_frame(reader))[:3] == (1, 3, 1)
    msg_type, comm_type, code, body = await read_frame(reader)
    assert (msg_type, comm_type, code) == (65201, 3, 1)
    assert struct.unpack_from('<i4x5i', body) == (7, 1, 1, 3, 1, 0)  # input 3: fine, and off
    assert (await read_frame(reader))[:3] == (65201, 3, 2)
    assert (await read_frame(reader))[:3] == (13, 3, 2)


@pytest.mark.parametrize('message', ['joint_position', 'joint_feedback'])
async def test_a_state_client_is_kept_that_was_not_scheduled_for_two_seconds(message):
    """Nor was the controller: it makes up for its slots at once, into a buffer that is small."""
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
def test_invariant_6_a_state_client_that_does_not_read_is_disconnected(caplog, monkeypatch):
    monkeypatch.delitem(tcp_connection.KEEPALIVE, 'TCP_USER_TIMEOUT')  # or TCP gives up first

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
            while served.servers.clients('state') == 2:  # the other one is served all the time
                data += len((await read_frame(good))[3])
            assert served.servers.clients('state') == 1
            for _ in range(20):
                await read_frame(good)
            sock.close()

    run(main(), real_time=True)
    assert 'does not read: disconnected' in caplog.text


@on_sockets
async def test_big_and_small_ports_are_refused_with_their_name(served):
    other = ControllerServers(new_controller(MODEL, PROFILE))
    taken = Ports(0, served.ports.state, 0, 0)
    with pytest.raises(OSError, match=rf'state port {HOST}:{served.ports.state}: .*in use'):
        await other.open(HOST, taken)
    with pytest.raises(OSError, match='motion port'):
        await other.open(HOST, Ports(70_000, 0, 0, 0))


@on_sockets
async def test_everything_closes_while_clients_are_connected(served):
    reader, writer = await served.connect()
    state, _ = await served.connect('state')
    served.controller.apply(Event.MOTORS_ON)
    writer.write(point(0, FAR, SLOW))
    await until(lambda: served.controller.in_motion)
    await served.servers.close()
    await read_to_the_end(state)
    assert await read_code(reader) == (0, FAILURE)


# ---- remote port and its client


@on_sockets
async def test_remote_commands_over_the_network(served):
    port = served.ports.remote
    assert await execute(HOST, port, ['GetStatus'], 20) == ['00100000001,0000']
    assert await execute(HOST, port, ['SetMotorsOn,1', 'GetMotor,0'], 20) == ['0', '1,1,0']
    assert served.controller.condition.motors is Motors.ON
    await execute(HOST, port, ['Sim,estop,press'], 20)
    with pytest.raises(RemoteError, match='does not accept it in its present condition') as caught:
        await execute(HOST, port, ['SetMotorsOn,1'], 20)
    assert (caught.value.command, caught.value.number) == ('SetMotorsOn,1', 20)
    with pytest.raises(RemoteError, match=r'Dance: the command is unknown.*error 11'):
        await execute(HOST, port, ['Dance'], 20)
    with pytest.raises(ValueError, match='not one command'):
        await execute(HOST, port, ['Reset\r\n$SetMotorsOn'], 20)


@on_sockets
async def test_remote_lines_with_either_ending_and_several_clients(served):
    first, first_writer = await served.connect('remote')
    second, second_writer = await served.connect('remote')
    first_writer.write(b'$Login\n$GetStatus\r\n')
    second_writer.write(b'$GetStatus\n')
    assert await first.readline() == b'#Login,0\r\n'
    assert await first.readline() == b'#GetStatus,00100000001,0000\r\n'
    assert await second.readline() == b'!GetStatus,11\r\n'
    first_writer.write(b'\xff\xfe\n')
    assert (await first.readline()).endswith(b',10\r\n')


@pytest.mark.invariant(7)
@on_sockets
async def test_invariant_7_a_remote_line_without_end_closes_that_connection(served):
    reader, writer = await served.connect('remote')
    writer.write(b'$' + b'x' * 100_000)
    assert await reader.readline() == b'!,12\r\n'
    assert await rejected(reader)
    assert await execute(HOST, served.ports.remote, ['GetStatus'], 20)


@pytest.mark.parametrize(
    ('answer', 'error', 'text'),
    [
        (b'hello\r\n', ConnectionError, "'hello' is no answer to Login"),
        (b'#GetStatus,1\r\n', ConnectionError, 'is no answer to Login'),
        (b'!Login,what\r\n', ConnectionError, 'is no answer to Login'),
        (b'', ConnectionError, 'closed by the controller before it answered Login'),
        (b'x' * 200_000, ConnectionError, 'does not end'),
        (b'!Login,13\r\n', RemoteError, r'the password is wrong \(error 13\)'),
        (b'!Login,77\r\n', RemoteError, r'unknown error number \(error 77\)'),
    ],
)
async def test_what_else_may_answer_a_remote_command(answer, error, text):
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
async def test_invariant_9_a_controller_that_hangs_up_before_the_login_is_tried_again(how):
    comes = 0
    asked = []

    async def serve(reader, writer):
        nonlocal comes
        comes += 1
        if comes < MAX_LOGINS:
            if how == 'reset':
                writer.transport.abort()
            writer.close()
            return
        for name in (b'Login', b'Reset'):
            asked.append(await reader.readline())
            writer.write(b'#%s,0\r\n' % name)
        writer.close()  # and no answer to the logout: all that was asked for is done

    server = await asyncio.start_server(serve, HOST, 0)
    port = server.sockets[0].getsockname()[1]
    assert await execute(HOST, port, ['Reset'], 20) == ['0']
    assert asked == [b'$Login,\r\n', b'$Reset\r\n']
    assert comes == MAX_LOGINS
    with pytest.raises(ConnectionError, match=f'{HOST}:{port}: .*'):
        await execute(HOST, port, ['Reset', 'Stop'], 20)
    assert comes == MAX_LOGINS + 1  # a command is never given twice
    server.close()


async def test_a_remote_port_that_is_silent_or_not_there():
    with socket.create_server((HOST, 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(TimeoutError):
            await execute(HOST, port, ['Reset'], 0.1)
    with pytest.raises(ConnectionError, match=rf'{HOST}:{port}: '):
        await execute(HOST, port, ['Reset'], 20)


@pytest.mark.invariant(9)
async def test_a_defect_in_what_serves_a_client_ends_the_controller(monkeypatch):
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
