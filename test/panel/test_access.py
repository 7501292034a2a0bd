# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Who is let in to the panel, as rules."""

import pytest

from epson_driver.panel.access import Access, Rejection, is_loopback, own_names

PORT = 8080
HERE = '127.0.0.1'
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
