# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's web server and its access control."""

import asyncio
import contextlib
import functools
import http.client
import json
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from epson_driver.panel.access import LOOPBACK_NAMES, Access, is_loopback, own_names

pytest.importorskip('websockets')

from support.ros_peer import PATIENCE
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from epson_driver.panel.requests import message_of
from epson_driver.panel.web_server import WebServer, WebServerError
from epson_driver.panel.window import (
    HELD_S,
    MAX_BURST_S,
    MAX_LATE_S,
    MAX_MESSAGES_PER_S,
    BadMessageError,
    Window,
)

HERE = '127.0.0.1'


class Listener:
    """Records windows, requests and failures."""

    def __init__(self) -> None:
        self.windows: list[Window] = []
        self.asked: list[dict[str, Any]] = []
        self.left = threading.Event()
        self.failed: list[BaseException] = []

    def add(self, window: Window) -> None:
        self.windows.append(window)
        window.offer('', {'beat': '1'})

    def remove(self, _window: Window) -> None:
        self.left.set()

    def received(self, _window: Window, text: str | bytes) -> None:
        asked = message_of(text)
        self.asked.append(asked)
        if asked['do'] == 'fail':
            raise ZeroDivisionError

    def fail(self, _what: str, error: BaseException) -> None:
        self.failed.append(error)


@pytest.fixture
def listener() -> Listener:
    return Listener()


def serving(
    listener: Listener, host: str = HERE, port: int = 0, token: str | None = None
) -> WebServer:
    return WebServer(host, port, token, listener, listener.fail)


@pytest.fixture
def server(listener: Listener) -> Iterator[WebServer]:
    result = serving(listener)
    yield result
    result.stop()


def opened(port: int, origin: str | None = '', **options: Any) -> Any:
    """Open a websocket like the page, or with another `origin`."""
    own = f'http://{HERE}:{port}' if origin == '' else origin
    return connect(f'ws://{HERE}:{port}/', origin=own, open_timeout=PATIENCE, **options)


def get(port: int, path: str = '/', **headers: str) -> tuple[int, str, Any]:
    """Return status, body and headers of the answer to a GET."""
    connection = http.client.HTTPConnection(HERE, port, timeout=60)
    connection.request('GET', path, headers=headers)
    answer = connection.getresponse()
    result = answer.status, answer.read().decode(errors='replace'), answer.headers
    connection.close()
    return result


def listens_on(port: int) -> set[str]:
    """Return the listening addresses of a port, in the notation of /proc."""
    rows = []
    for name in ('tcp', 'tcp6'):
        text = Path('/proc/net', name).read_text(encoding='ascii')
        rows += [line.split() for line in text.splitlines()[1:]]
    return {
        row[1].split(':')[0] for row in rows if row[1].endswith(f':{port:04X}') and row[3] == '0A'
    }


def test_page_is_served_and_connects(server: WebServer) -> None:
    status, body, headers = get(server.port)
    assert status == 200
    assert '<html' in body
    assert "default-src 'none'" in headers['Content-Security-Policy']
    with opened(server.port) as client:
        assert json.loads(client.recv(PATIENCE)) == {'beat': 1, 'robot': ''}


def test_page_loads_local_files_only(server: WebServer) -> None:
    page = get(server.port)[1]
    named = set(re.findall(r'(?:src|href)="([^"]+)"', page))
    assert {'bundle.js', 'arm.js', 'panel.js', 'panel.css', 'bundle.css'} <= named
    for name in named:
        status, body, headers = get(server.port, f'/{name}')
        assert status == 200
        assert headers['X-Content-Type-Options'] == 'nosniff'
        named_inside = re.findall(r"from '\./([^']+)'", body) if name.endswith('panel.js') else []
        assert all(get(server.port, f'/{item}')[0] == 200 for item in named_inside)
    assert '//' not in ''.join(named)
    assert not re.search(r'<script>|\sstyle=|\son\w+=', page)  # the policy blocks them


def test_duplicate_header_is_rejected(server: WebServer) -> None:
    request = (
        f'GET / HTTP/1.1\r\nHost: {HERE}:{server.port}\r\nOrigin: http://{HERE}:{server.port}\r\n'
        'Origin: http://evil.example\r\n\r\n'
    )
    with socket.create_connection((HERE, server.port), timeout=60) as connection:
        connection.sendall(request.encode())
        assert connection.recv(100).startswith(b'HTTP/1.1 400 ')


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'text',
    ['', '[1]', '{"do": 1}', b'\x00\xff', '[' * 9000, 'x' * 20_000, ['{"do":', '"alive"}']],
    ids=['empty', 'list', 'number', 'bytes', 'deep', 'long', 'parts'],
)
def test_invalid_message_closes_only_that_connection(
    text: str | bytes | list[str], server: WebServer, listener: Listener
) -> None:
    with opened(server.port) as other, opened(server.port) as client:
        with contextlib.suppress(ConnectionClosed):
            client.send(text)
        with pytest.raises(ConnectionClosed) as closed:  # before or after its first message
            list(iter(lambda: client.recv(PATIENCE), None))
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code in (1008, 1009)
        assert listener.left.wait(PATIENCE)
        other.send('{"do": "alive"}')
        until = time.monotonic() + PATIENCE
        while not listener.asked:
            assert time.monotonic() < until
            time.sleep(0.01)
    assert listener.failed == []


class BlockingListener(Listener):
    """Each of the first two messages blocks the server until its gate opens."""

    def __init__(self) -> None:
        super().__init__()
        self.started = threading.Event()
        self.gates = [threading.Event(), threading.Event()]

    def received(self, window: Window, text: str | bytes) -> None:
        self.started.set()
        for gate in self.gates[len(self.asked) :][:1]:
            assert gate.wait(PATIENCE)
        super().received(window, text)


def bytes_accepted(port: int) -> int:
    """Return how many bytes can be sent while the server does not read."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        connection.connect((HERE, port))
        connection.setblocking(False)
        sent = 0
        with contextlib.suppress(BlockingIOError):
            while True:
                sent += connection.send(bytes(1000))
    return sent


@pytest.mark.invariant(3, 7)
def test_stop_overtakes_the_messages_of_a_flooding_window() -> None:
    """The server has hundreds of pending messages when another window requests STOP."""
    listener, sent, enough = BlockingListener(), 0, threading.Event()
    server = serving(listener)

    def flood(client: Any) -> None:
        nonlocal sent
        with contextlib.suppress(ConnectionClosed):
            while True:
                client.send('{"do":"alive"}')
                sent += 1
                if sent == 300:
                    enough.set()

    with opened(server.port) as other, opened(server.port) as client:
        flooding = threading.Thread(target=flood, args=[client])
        flooding.start()
        assert listener.started.wait(PATIENCE)
        assert bytes_accepted(server.port) < 50_000  # maximum that one iteration reads
        assert enough.wait(PATIENCE)
        listener.gates[0].set()
        while len(listener.asked) < 1:
            time.sleep(0.01)
        other.send('{"do":"stop"}')
        listener.gates[1].set()
        flooding.join(PATIENCE)
        with pytest.raises(ConnectionClosed) as closed:
            list(iter(lambda: client.recv(PATIENCE), None))
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008
        assert 'messages per second' in closed.value.rcvd.reason
        other.ping().wait(PATIENCE)
    server.stop()
    asked = [item['do'] for item in listener.asked]
    assert asked.index('stop') < 20
    assert listener.failed == []


@pytest.mark.invariant(7)
def test_flood_of_pings_closes_the_connection(server: WebServer) -> None:
    with opened(server.port, ping_interval=None) as client:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(2 * int(MAX_BURST_S * MAX_MESSAGES_PER_S)):
                client.ping()
        with pytest.raises(ConnectionClosed) as closed:
            list(iter(lambda: client.recv(PATIENCE), None))
        assert closed.value.rcvd is not None
        assert 'messages per second' in closed.value.rcvd.reason


def test_burst_of_ten_seconds_of_messages_is_accepted() -> None:
    window = Window(asyncio.new_event_loop())
    for _ in range(int(MAX_BURST_S * MAX_MESSAGES_PER_S)):
        window.count(5.0)
    with pytest.raises(BadMessageError, match='more than 100 messages'):
        window.count(5.0)
    for item in range(10_000):  # twice the rate of the page during a jog
        window.count(20.0 + item / 88.0)
    window._loop.close()


@pytest.mark.invariant(9)
def test_failure_in_a_request_is_reported(server: WebServer, listener: Listener) -> None:
    with opened(server.port) as client:
        client.send('{"do": "fail"}')
        assert listener.left.wait(PATIENCE)
    assert [type(item) for item in listener.failed] == [ZeroDivisionError]


def test_slow_window_receives_only_the_newest_parts(server: WebServer, listener: Listener) -> None:
    """While the connection is blocked, a new part replaces the waiting one."""
    long = 'x' * 100_000
    with opened(server.port, max_size=None) as client:
        client.recv(PATIENCE)
        (window,) = listener.windows
        for number in range(1000):
            window.offer('', {'beat': str(number), 'log': json.dumps(f'{number}{long}')})
            window.say(str(number))
        assert sum(map(len, window._waiting.values())) < 2 * len(long)
        result: dict[str, Any] = {}
        while result.get('beat') != 999:
            result |= json.loads(client.recv(PATIENCE))
        assert result['log'].startswith('999')


def test_only_changed_parts_are_sent(server: WebServer, listener: Listener) -> None:
    with opened(server.port) as client:
        client.recv(PATIENCE)
        (window,) = listener.windows
        window.offer('', {'beat': '1'})
        window.offer('/other', {'beat': '7'})  # not the shown robot
        window.offer('', {'beat': '2', 'io': '3'})
        assert json.loads(client.recv(PATIENCE)) == {'beat': 2, 'io': 3, 'robot': ''}
        window.choose('/other')
        window.offer('/other', {'beat': '2', 'io': '3'})
        assert json.loads(client.recv(PATIENCE)) == {'beat': 2, 'io': 3, 'robot': '/other'}


@pytest.mark.invariant(3)
async def test_delayed_message_is_late_and_silence_ends_a_jog_once() -> None:
    done: list[str] = []
    window = Window(asyncio.get_running_loop())
    assert not window.late(5.0, 100.0)  # the clocks differ by 95 s
    assert not window.late(6.0, 100.99 + MAX_LATE_S)
    assert window.late(7.0, 102.01 + MAX_LATE_S)
    assert not window.late(8.0, 102.9)  # quicker than the first
    assert window.late(9.0, 103.95 + MAX_LATE_S)
    for item in ('first', 'second', 'last'):
        window.after_silence(functools.partial(done.append, item))
        await asyncio.sleep(0)
    await asyncio.sleep(2 * HELD_S)
    assert done == ['last']


def test_port_in_use_is_an_error(server: WebServer) -> None:
    with pytest.raises(WebServerError, match=f'port {server.port} .*: .*another port'):
        serving(Listener(), port=server.port)


@pytest.mark.parametrize('host', ['192.0.2.1', 'no.such.host.invalid'])
def test_address_of_another_machine_is_an_error(host: str) -> None:
    with pytest.raises(WebServerError, match=host) as refused:
        serving(Listener(), host, token='secret')
    assert 'end the process' not in str(refused.value)


def test_other_machines_need_a_token(listener: Listener) -> None:
    with pytest.raises(WebServerError, match='a token is needed'):
        serving(listener, '0.0.0.0')
    server = serving(listener, '0.0.0.0', token='secret')
    try:
        assert get(server.port)[0] == get(server.port, '/panel.js')[0] == 403
        status, _, headers = get(server.port, '/?token=secret')
        assert status == 200
        cookie = headers['Set-Cookie'].partition(';')[0]
        assert get(server.port, '/panel.js', Cookie=cookie)[0] == 200
        with pytest.raises(InvalidStatus):
            opened(server.port)
        opened(server.port, additional_headers={'Cookie': cookie}).close()
    finally:
        server.stop()


def test_port_of_the_panel_is_free_after_its_end(listener: Listener) -> None:
    server = serving(listener)
    assert server.alive
    client = opened(server.port)
    server.stop()
    assert listens_on(server.port) == set()
    assert not server.alive
    client.close()
    assert listener.left.is_set()
    assert listener.failed == []


PORT = 8080

OWN = f'http://{HERE}:{PORT}'


def headers(**given: str | None) -> dict[str, str]:
    result = {'host': f'{HERE}:{PORT}'} | given
    return {name: value for name, value in result.items() if value is not None}


def rejection(
    access: Access, path: str = '/', arrived_at: str = HERE, **given: str | None
) -> str | None:
    return access.rejection(path, headers(**given), arrived_at)


LOCAL = Access(PORT, own_names(HERE))


@pytest.mark.parametrize(
    'origin',
    [
        'http://evil.example',
        f'http://evil.example:{PORT}',
        f'http://{HERE}:{PORT + 1}',
        f'http://{HERE}',
        f'https://{HERE}:{PORT}',
        f'{OWN}.evil.example',
        'null',
        'file://',
        '',
    ],
)
@pytest.mark.parametrize('upgrade', [None, 'websocket', 'WebSocket'])
def test_request_of_another_origin_is_rejected(origin: str, upgrade: str | None) -> None:
    result = rejection(LOCAL, origin=origin, upgrade=upgrade)
    assert result is not None
    assert 'is not the page of this panel' in result


def test_websocket_without_origin_is_rejected() -> None:
    result = rejection(LOCAL, upgrade='websocket')
    assert result == 'a websocket without an Origin is rejected'


def test_loopback_needs_no_token_and_has_three_names() -> None:
    assert all(map(is_loopback, ('127.0.0.1', '127.9.9.9', '::1', 'localhost')))
    assert not any(map(is_loopback, ('0.0.0.0', '::', '192.168.0.2', 'somewhere')))
    for name in (*LOOPBACK_NAMES, 'LOCALHOST'):
        own = f'{name}:{PORT}'
        assert rejection(LOCAL, host=own, origin=f'http://{own}', upgrade='websocket') is None


@pytest.mark.parametrize('host', ['evil.example:8080', '127.0.0.1', 'evil.example', '', None])
def test_unknown_host_name_is_rejected(host: str | None) -> None:
    result = rejection(LOCAL, host=host)
    assert result is not None
    assert result.startswith('this panel is not ')


def test_only_the_address_of_arrival_is_allowed() -> None:
    access = Access(PORT, own_names('0.0.0.0'))
    own = f'192.168.0.2:{PORT}'
    arrived = '192.168.0.2'
    assert rejection(access, arrived_at=arrived, host=own, origin=f'http://{own}') is None
    assert rejection(access, arrived_at='192.168.0.3', host=own) is not None


def test_every_request_needs_the_token() -> None:
    access = Access(PORT, own_names(HERE), 'secret')
    for given in ({}, {'origin': OWN, 'upgrade': 'websocket'}):
        result = rejection(access, **given)
        assert result is not None
        assert 'a token is needed' in result
        assert rejection(access, '/?token=secre', **given) is not None
        assert rejection(access, '/?token=secret&token=x', **given) is not None
        assert rejection(access, cookie='epson_driver_panel_8081=secret', **given) is not None
        assert rejection(access, cookie='epson_driver_panel_8080=secret', **given) is None
        assert rejection(access, '/?token=secret', **given) is None
    assert rejection(access, '/?token=secret', origin='http://evil.example') is not None


def test_security_policy_of_the_page_blocks_other_hosts_and_frames() -> None:
    sent = Access(PORT, own_names(HERE), 'secret').new_headers('/?token=secret')
    policy = dict(part.split(' ', 1) for part in sent['Content-Security-Policy'].split('; '))
    assert policy['default-src'] == "'none'"
    assert policy['frame-ancestors'] == "'none'"
    assert all('//' not in words and '*' not in words for words in policy.values())
    assert sent['X-Frame-Options'] == 'DENY'
    assert 'HttpOnly' in sent['Set-Cookie']
    assert 'SameSite=Strict' in sent['Set-Cookie']


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'cookie', ['', '\x00', '=;=;', 'a' * 10_000, 'epson_driver_panel_8080="', 'a@b=1']
)
def test_invalid_cookie_neither_authorizes_nor_hides_a_token(cookie: str) -> None:
    secret = Access(PORT, own_names(HERE), 'secret')
    assert rejection(secret, cookie=cookie) is not None
    assert rejection(secret, '/?token=secret', cookie=cookie) is None
    assert rejection(secret, cookie=f'{secret.cookie}=secret') is None
