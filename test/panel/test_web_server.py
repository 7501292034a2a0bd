# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's web server, and who may use it."""

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

from epson_driver.panel.access import Access, Rejection, is_loopback, own_names

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


class Visitors:
    """Who came, what they sent, and what has failed."""

    def __init__(self) -> None:
        self.windows: list[Window] = []
        self.asked: list[dict[str, Any]] = []
        self.left = threading.Event()
        self.failed: list[BaseException] = []

    def came(self, window: Window) -> None:
        self.windows.append(window)
        window.offer('', {'beat': '1'})

    def gone(self, _window: Window) -> None:
        self.left.set()

    def received(self, _window: Window, text: str | bytes) -> None:
        asked = message_of(text)
        self.asked.append(asked)
        if asked['do'] == 'fail':
            raise ZeroDivisionError

    def fail(self, _what: str, error: BaseException) -> None:
        self.failed.append(error)


@pytest.fixture
def visitors() -> Visitors:
    return Visitors()


def serving(
    visitors: Visitors, host: str = HERE, port: int = 0, token: str | None = None
) -> WebServer:
    return WebServer(host, port, token, visitors, visitors.fail)


@pytest.fixture
def server(visitors: Visitors) -> Iterator[WebServer]:
    found = serving(visitors)
    yield found
    found.stop()


def opened(port: int, origin: str | None = '', **options: Any) -> Any:
    """Open a websocket, as the page does unless `origin` says otherwise."""
    own = f'http://{HERE}:{port}' if origin == '' else origin
    return connect(f'ws://{HERE}:{port}/', origin=own, open_timeout=PATIENCE, **options)


def get(port: int, path: str = '/', **headers: str) -> tuple[int, str, Any]:
    """Return status, body and headers of the answer to a GET."""
    connection = http.client.HTTPConnection(HERE, port, timeout=60)
    connection.request('GET', path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, answer.read().decode(errors='replace'), answer.headers
    connection.close()
    return found


def listens_on(port: int) -> set[str]:
    """Return the addresses at which a port of this machine is open, as /proc has them."""
    rows = []
    for name in ('tcp', 'tcp6'):
        text = Path('/proc/net', name).read_text(encoding='ascii')
        rows += [line.split() for line in text.splitlines()[1:]]
    return {
        row[1].split(':')[0] for row in rows if row[1].endswith(f':{port:04X}') and row[3] == '0A'
    }


def test_it_listens_on_this_machine_alone(server: WebServer) -> None:
    assert listens_on(server.port) == {'0100007F'}


def test_the_own_page_connects(server: WebServer) -> None:
    status, body, headers = get(server.port)
    assert status == 200
    assert '<html' in body
    assert "default-src 'none'" in headers['Content-Security-Policy']
    with opened(server.port) as client:
        assert json.loads(client.recv(PATIENCE)) == {'beat': 1, 'robot': ''}


def test_every_file_that_the_page_names_is_there_and_none_is_elsewhere(server: WebServer) -> None:
    page = get(server.port)[1]
    named = set(re.findall(r'(?:src|href)="([^"]+)"', page))
    assert {'bundle.js', 'arm.js', 'panel.js', 'panel.css', 'bundle.css'} <= named
    for name in named:
        status, body, headers = get(server.port, f'/{name}')
        assert status == 200
        assert headers['X-Content-Type-Options'] == 'nosniff'
        named_inside = re.findall(r"from '\./([^']+)'", body) if name.endswith('panel.js') else []
        assert all(get(server.port, f'/{each}')[0] == 200 for each in named_inside)
    assert '//' not in ''.join(named)
    assert not re.search(r'<script>|\sstyle=|\son\w+=', page)  # the policy forbids them


@pytest.mark.parametrize('origin', ['http://evil.example', 'http://127.0.0.1:1', None])
def test_no_other_page_gets_a_websocket(server: WebServer, origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused:
        opened(server.port, origin)
    assert refused.value.response.status_code == 403


def test_no_other_page_gets_the_page(server: WebServer) -> None:
    assert get(server.port, Origin='http://evil.example')[0] == 403
    assert get(server.port, Host='evil.example')[0] == 403
    assert get(server.port, '/../../etc/passwd')[0] == 404


def test_a_header_that_is_there_twice_cannot_be_read_in_two_ways(server: WebServer) -> None:
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
    ['', 'x', '[1]', '{"do": 1}', b'\x00\xff', 'x' * 20_000, ['{"do":', '"alive"}']],
    ids=['empty', 'x', 'list', 'number', 'bytes', 'long', 'parts'],
)
def test_what_no_page_sends_ends_that_connection_alone(
    text: str | bytes | list[str], server: WebServer, visitors: Visitors
) -> None:
    with opened(server.port) as other, opened(server.port) as client:
        with contextlib.suppress(ConnectionClosed):
            client.send(text)
        with pytest.raises(ConnectionClosed) as closed:  # before its first message, or after it
            list(iter(lambda: client.recv(PATIENCE), None))
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code in (1008, 1009)
        assert visitors.left.wait(PATIENCE)
        other.send('{"do": "alive"}')
        until = time.monotonic() + PATIENCE
        while not visitors.asked:
            assert time.monotonic() < until
            time.sleep(0.01)
    assert visitors.failed == []


class HeldUp(Visitors):
    """Each of the first two messages blocks the server until its gate opens."""

    def __init__(self) -> None:
        super().__init__()
        self.begun = threading.Event()
        self.gates = [threading.Event(), threading.Event()]

    def received(self, window: Window, text: str | bytes) -> None:
        self.begun.set()
        for gate in self.gates[len(self.asked) :][:1]:
            assert gate.wait(PATIENCE)
        super().received(window, text)


def taken(port: int) -> int:
    """Return how many bytes a connection takes that the server does not read."""
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
def test_a_window_that_floods_comes_after_the_stop_of_another_and_is_closed() -> None:
    """The server has read hundreds of its messages when the other one asks for STOP."""
    visitors, sent, enough = HeldUp(), 0, threading.Event()
    server = serving(visitors)

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
        assert visitors.begun.wait(PATIENCE)
        assert taken(server.port) < 50_000  # the most that a turn of its loop can read
        assert enough.wait(PATIENCE)
        visitors.gates[0].set()
        while len(visitors.asked) < 1:
            time.sleep(0.01)
        other.send('{"do":"stop"}')
        visitors.gates[1].set()
        flooding.join(PATIENCE)
        with pytest.raises(ConnectionClosed) as closed:
            list(iter(lambda: client.recv(PATIENCE), None))
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008
        assert 'messages per second' in closed.value.rcvd.reason
        other.ping().wait(PATIENCE)
    server.stop()
    asked = [each['do'] for each in visitors.asked]
    assert asked.index('stop') < 20
    assert visitors.failed == []


@pytest.mark.invariant(7)
def test_a_flood_of_pings_ends_that_connection(server: WebServer) -> None:
    with opened(server.port, ping_interval=None) as client:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(2 * int(MAX_BURST_S * MAX_MESSAGES_PER_S)):
                client.ping()
        with pytest.raises(ConnectionClosed) as closed:
            list(iter(lambda: client.recv(PATIENCE), None))
        assert closed.value.rcvd is not None
        assert 'messages per second' in closed.value.rcvd.reason


def test_a_slow_line_may_deliver_the_messages_of_ten_seconds_together() -> None:
    window = Window(asyncio.new_event_loop())
    for _ in range(int(MAX_BURST_S * MAX_MESSAGES_PER_S)):
        window.count(5.0)
    with pytest.raises(BadMessageError, match='more than 100 messages'):
        window.count(5.0)
    for each in range(10_000):  # twice the rate of the page during a jog
        window.count(20.0 + each / 88.0)
    window._loop.close()


@pytest.mark.invariant(9)
def test_what_fails_in_a_request_is_told(server: WebServer, visitors: Visitors) -> None:
    with opened(server.port) as client:
        client.send('{"do": "fail"}')
        assert visitors.left.wait(PATIENCE)
    assert [type(each) for each in visitors.failed] == [ZeroDivisionError]


def test_a_window_that_does_not_read_keeps_only_what_is_newest(
    server: WebServer, visitors: Visitors
) -> None:
    """Its line is full: what is offered meanwhile takes the place of what waits."""
    long = 'x' * 100_000
    with opened(server.port, max_size=None) as client:
        client.recv(PATIENCE)
        (window,) = visitors.windows
        for number in range(1000):
            window.offer('', {'beat': str(number), 'log': json.dumps(f'{number}{long}')})
            window.say(str(number))
        assert sum(map(len, window._waiting.values())) < 2 * len(long)
        found: dict[str, Any] = {}
        while found.get('beat') != 999:
            found |= json.loads(client.recv(PATIENCE))
        assert found['log'].startswith('999')


def test_only_news_are_sent_and_another_robot_is_all_news(
    server: WebServer, visitors: Visitors
) -> None:
    with opened(server.port) as client:
        client.recv(PATIENCE)
        (window,) = visitors.windows
        window.offer('', {'beat': '1'})
        window.offer('/other', {'beat': '7'})  # a robot that it does not show
        window.offer('', {'beat': '2', 'io': '3'})
        assert json.loads(client.recv(PATIENCE)) == {'beat': 2, 'io': 3, 'robot': ''}
        window.choose('/other')
        window.offer('/other', {'beat': '2', 'io': '3'})
        assert json.loads(client.recv(PATIENCE)) == {'beat': 2, 'io': 3, 'robot': '/other'}


def test_what_a_line_has_held_up_is_late() -> None:
    window = Window(asyncio.new_event_loop())
    assert not window.late(5.0, 100.0)  # the clocks differ by 95 s
    assert not window.late(6.0, 100.99 + MAX_LATE_S)
    assert window.late(7.0, 102.01 + MAX_LATE_S)
    assert not window.late(8.0, 102.9)  # quicker than the first
    assert window.late(9.0, 103.95 + MAX_LATE_S)
    window._loop.close()


async def test_what_follows_silence_is_done_once_after_the_last_request() -> None:
    done: list[str] = []
    window = Window(asyncio.get_running_loop())
    for each in ('first', 'second', 'last'):
        window.after_silence(functools.partial(done.append, each))
        await asyncio.sleep(0)
    await asyncio.sleep(2 * HELD_S)
    assert done == ['last']


def test_a_port_that_is_taken_is_an_error_and_not_another_port(server: WebServer) -> None:
    with pytest.raises(WebServerError, match=f'port {server.port} .* cannot be opened: .*--port'):
        serving(Visitors(), port=server.port)


@pytest.mark.parametrize('host', ['192.0.2.1', 'no.such.host.invalid'])
def test_an_address_of_somebody_else_is_an_error(host: str) -> None:
    with pytest.raises(WebServerError, match=host) as refused:
        serving(Visitors(), host, token='secret')
    assert 'end the process' not in str(refused.value)


def test_other_machines_are_let_in_with_a_token_only(visitors: Visitors) -> None:
    with pytest.raises(WebServerError, match='a token is needed'):
        serving(visitors, '0.0.0.0')
    server = serving(visitors, '0.0.0.0', token='secret')
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


def test_the_port_is_free_again_afterwards(visitors: Visitors) -> None:
    server = serving(visitors)
    assert server.alive
    client = opened(server.port)
    server.stop()
    assert listens_on(server.port) == set()
    assert not server.alive
    client.close()
    assert visitors.left.is_set()
    assert visitors.failed == []


PORT = 8080

OWN = f'http://{HERE}:{PORT}'


def headers(**given: str | None) -> dict[str, str]:
    found = {'host': f'{HERE}:{PORT}'} | given
    return {name: value for name, value in found.items() if value is not None}


def rejection(
    access: Access, path: str = '/', arrived_at: str = HERE, **given: str | None
) -> Rejection | None:
    return access.rejection(path, headers(**given), arrived_at)


LOCAL = Access(PORT, own_names(HERE))


@pytest.mark.parametrize('name', ['127.0.0.1', 'localhost', '[::1]', 'LOCALHOST'])
def test_the_own_page_is_let_in(name: str) -> None:
    host = f'{name}:{PORT}'
    assert rejection(LOCAL, host=host) is None
    assert rejection(LOCAL, host=host, origin=f'http://{host}') is None
    assert rejection(LOCAL, host=host, origin=f'http://{host}', upgrade='websocket') is None


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
def test_another_page_is_not_let_in(origin: str, upgrade: str | None) -> None:
    found = rejection(LOCAL, origin=origin, upgrade=upgrade)
    assert found is not None
    assert found.status == 403
    assert 'is not the page of this panel' in found.text


def test_a_websocket_without_an_origin_is_not_let_in() -> None:
    found = rejection(LOCAL, upgrade='websocket')
    assert found == Rejection(403, 'a websocket without an Origin is not let in')


@pytest.mark.parametrize('host', ['evil.example:8080', '127.0.0.1', 'evil.example', '', None])
def test_a_name_that_somebody_else_made_point_here_is_not_let_in(host: str | None) -> None:
    found = rejection(LOCAL, host=host)
    assert found is not None
    assert found.status == 403


def test_a_host_that_is_reached_by_its_address_is_let_in_under_that_address_alone() -> None:
    access = Access(PORT, own_names('0.0.0.0'))
    own = f'192.168.0.2:{PORT}'
    arrived = '192.168.0.2'
    assert rejection(access, arrived_at=arrived, host=own, origin=f'http://{own}') is None
    assert rejection(access, arrived_at='192.168.0.3', host=own) is not None


def test_the_token_is_wanted_from_everybody_and_for_everything() -> None:
    access = Access(PORT, own_names(HERE), 'secret')
    for given in ({}, {'origin': OWN, 'upgrade': 'websocket'}):
        found = rejection(access, **given)
        assert found is not None
        assert 'a token is needed' in found.text
        assert rejection(access, '/?token=secre', **given) is not None
        assert rejection(access, '/?token=secret&token=x', **given) is not None
        assert rejection(access, cookie='epson_driver_panel_8081=secret', **given) is not None
        assert rejection(access, cookie='epson_driver_panel_8080=secret', **given) is None
        assert rejection(access, '/?token=secret', **given) is None
    assert rejection(access, '/?token=secret', origin='http://evil.example') is not None


def test_a_cookie_that_is_none_is_no_token() -> None:
    access = Access(PORT, own_names(HERE), 'secret')
    for cookie in ('', '\x00', '=;=;', 'a' * 10_000, 'epson_driver_panel_8080="'):
        assert rejection(access, cookie=cookie) is not None


def test_the_page_may_ask_nobody_else_and_be_shown_in_no_frame() -> None:
    sent = Access(PORT, own_names(HERE), 'secret').new_headers('/?token=secret')
    policy = dict(part.split(' ', 1) for part in sent['Content-Security-Policy'].split('; '))
    assert policy['default-src'] == "'none'"
    assert policy['frame-ancestors'] == "'none'"
    assert all('//' not in words and '*' not in words for words in policy.values())
    assert sent['X-Frame-Options'] == 'DENY'
    assert 'HttpOnly' in sent['Set-Cookie']
    assert 'SameSite=Strict' in sent['Set-Cookie']


@pytest.mark.parametrize('host', ['127.0.0.1', '127.9.9.9', '::1', 'localhost'])
def test_loopback_is_this_machine_alone(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize('host', ['0.0.0.0', '::', '192.168.0.2', 'somewhere'])
def test_everything_else_is_reached_by_others(host: str) -> None:
    assert not is_loopback(host)


def test_at_port_80_a_browser_leaves_the_port_out() -> None:
    plain = Access(80, own_names(HERE))
    assert rejection(plain, host=HERE, origin=f'http://{HERE}') is None
    assert rejection(plain, host=f'{HERE}:80') is None
    assert rejection(plain, host='evil.example') is not None
    assert rejection(LOCAL, host=HERE) is not None


@pytest.mark.invariant(7)
def test_a_cookie_that_is_none_lets_nobody_in_and_hides_no_token() -> None:
    secret = Access(PORT, own_names(HERE), 'secret')
    odd = 'a@b=1'
    assert rejection(secret, cookie=odd) is not None
    assert rejection(secret, '/?token=secret', cookie=odd) is None
    assert rejection(secret, cookie=f'{secret.cookie}=secret') is None
