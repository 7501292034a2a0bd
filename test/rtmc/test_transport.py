# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The transport of Real-time Motion Control over loopback, and its absence."""

import os
import select
import signal
import socket
import subprocess
import sys
import time
from contextlib import closing

import numpy as np
import pytest
from support.ros_peer import PATIENCE

from epson_driver.rtmc import transport
from epson_driver.rtmc.messages import MAX_MESSAGE_BYTES, MOVED_DATA, Request, RtmcMessage
from epson_driver.rtmc.transport import Transport, TransportError

HOST = '127.0.0.1'
CLIENT = f"""
import sys
from epson_driver.rtmc.messages import Request, RtmcMessage
from epson_driver.rtmc.transport import Transport
client = Transport('{HOST}', peer=('{HOST}', int(sys.argv[1])))
while not client.write(RtmcMessage(Request.STATUS).encode()):
    client.take(0.02)
sys.stdin.read()
"""


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HOST, 0))
        return free.getsockname()[1]


def arrival(side):
    """Return the next message or lost peer."""
    end = time.monotonic() + PATIENCE
    while (found := side.take(0.1)) is None:
        assert time.monotonic() < end
    return found


def write(side, data):
    """Write once a peer is connected."""
    end = time.monotonic() + PATIENCE
    while not side.write(data):
        assert time.monotonic() < end
        time.sleep(0.01)


def wakes(side, within=0.0):
    """Return whether the event of a side becomes readable."""
    return bool(select.select([side._call('event')], [], [], within)[0])


def test_replies_to_targets_wake_the_client_in_groups(port):
    reply = RtmcMessage(Request.MOVE, 0, 1, MOVED_DATA.pack(0, *[0.0] * 6, 0)).encode()
    with (
        closing(Transport(HOST, port)) as controller,
        closing(Transport(HOST, peer=(HOST, port))) as client,
    ):
        write(client, RtmcMessage(Request.STATUS).encode())
        arrival(controller)
        client.start(np.zeros(6))
        for _ in range(4):
            arrival(controller)
            write(controller, reply)
        arrival(controller)
        assert not wakes(client)
        write(controller, reply)
        assert wakes(client, PATIENCE)


def test_messages_for_a_quiet_side_wait_for_its_next_poll(port):
    data = RtmcMessage(Request.STATUS).encode()
    with closing(Transport(HOST, port)) as side:

        def wakes_for_a_message():
            side._call('receive', data, len(data), 0.0, 1)
            return wakes(side)

        assert not list(side.poll(quiet=True))
        assert not wakes_for_a_message()
        assert [arrival.data for arrival in side.poll(quiet=True)] == [data]
        assert not wakes_for_a_message()
        waiting = side.poll(quiet=False)
        assert wakes_for_a_message()
        assert len(list(waiting)) == 2


def test_request_and_reply_and_a_peer_that_leaves(port):
    with closing(Transport(HOST, port)) as controller:
        assert not controller.write(b'')
        with closing(Transport(HOST, peer=(HOST, port))) as client:
            request = RtmcMessage(Request.CONNECT, 1, data=b'secret').encode()
            write(client, request)
            sender, data, _ = arrival(controller)
            assert data == request
            largest = RtmcMessage(Request.MESSAGES, 0, 1, bytes(MAX_MESSAGE_BYTES - 16)).encode()
            write(controller, largest)
            assert arrival(client).data == largest
            for number in range(20):  # a notice directly before a reply is not lost
                write(controller, RtmcMessage(Request.STATUS_NOTICE, number).encode())
                write(controller, RtmcMessage(Request.STATUS, number).encode())
            taken = [arrival(client).data for _ in range(40)]
            assert len(set(taken)) == 40
        assert arrival(controller)[:2] == (sender, None)
        assert not controller.write(request)
    assert not controller.write(request)


@pytest.mark.slow
def test_first_request_of_each_client_can_be_answered_at_once(port):
    message = RtmcMessage(Request.STATUS).encode()
    with closing(Transport(HOST, port)) as controller:
        for _ in range(40):
            with closing(Transport(HOST, peer=(HOST, port))) as client:
                write(client, message)
                assert arrival(controller).data == message
                assert controller.write(message)
                assert arrival(client).data == message
            assert arrival(controller).data is None


@pytest.mark.parametrize('how', [signal.SIGKILL, signal.SIGSTOP])
def test_silent_peer_is_lost(port, how):
    with closing(Transport(HOST, port)) as controller:
        command = [sys.executable, '-c', CLIENT, str(port)]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as client:
            try:
                sender, data, _ = arrival(controller)
                assert data is not None
                client.send_signal(how)
                assert arrival(controller)[:2] == (sender, None)
            finally:
                client.kill()


@pytest.mark.invariant(9)
def test_inv9_process_that_ends_with_an_open_transport_keeps_its_exit_code(port):
    with closing(Transport(HOST, port)) as controller:
        script = CLIENT.replace('sys.stdin.read()', f'client.take({PATIENCE}); sys.exit(3)')
        with subprocess.Popen([sys.executable, '-c', script, str(port)]) as client:
            sender, data, _ = arrival(controller)
            write(controller, data)
            assert client.wait() == 3
        assert arrival(controller)[:2] == (sender, None)


def test_two_clients_are_told_apart(port):
    with (
        closing(Transport(HOST, port)) as controller,
        closing(Transport(HOST, peer=(HOST, port))) as one,
        closing(Transport(HOST, peer=(HOST, port))) as other,
    ):
        write(one, RtmcMessage(Request.STATUS, 1).encode())
        first = arrival(controller)
        write(other, RtmcMessage(Request.STATUS, 2).encode())
        second = arrival(controller)
        assert first.sender != second.sender


def test_address_of_another_machine_is_an_error():
    with pytest.raises(TransportError, match=r'192\.0\.2\.1:7000: .*assign'):
        Transport('192.0.2.1', 7000)


def test_used_port_is_an_error(port):
    with closing(Transport(HOST, port)), pytest.raises(TransportError, match='in use'):
        Transport(HOST, port)


def test_missing_file_descriptors_are_an_error():
    script = f"""
import os, resource
from epson_driver.rtmc.transport import Transport, TransportError
Transport('{HOST}').close()
most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
count = len(os.listdir('/proc/self/fd'))
for free in range(12):
    resource.setrlimit(resource.RLIMIT_NOFILE, (count + free - 1, most))
    try:
        Transport('{HOST}').close()
    except TransportError:
        print('refused')
"""
    found = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, env=os.environ, text=True
    )
    assert found.returncode == 0, found.stderr
    assert found.stdout.count('refused') > 3


def test_missing_package_is_reported_with_build_command(monkeypatch, tmp_path):
    transport.library.cache_clear()
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    try:
        with pytest.raises(TransportError, match=r'pip install \./interfaces/epson_rtmc'):
            Transport(HOST)
        (tmp_path / 'lib').mkdir()
        (tmp_path / 'lib' / transport.LIBRARY).write_bytes(b'not a library')
        with pytest.raises(TransportError, match='source your ROS 2'):
            Transport(HOST)
    finally:
        transport.library.cache_clear()


def test_library_is_loaded_only_when_it_is_needed():
    script = 'import epson_driver.rtmc.transport, sys; print(open("/proc/self/maps").read())'
    maps = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, check=True, env=os.environ, text=True
    ).stdout
    assert transport.LIBRARY not in maps
