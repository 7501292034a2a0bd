# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The texts of socket errors: what went wrong, once, without the address."""

import errno
import os
import socket

import pytest
from support.event_loop import PATIENCE, run

from epson_driver.remote_ethernet.client import execute
from epson_driver.socket_errors import reason


def test_the_address_is_not_in_the_reason() -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken:
        address = taken.getsockname()
        with pytest.raises(OSError, match='address') as caught:
            socket.create_server(address)
    assert str(address[1]) in str(caught.value)
    assert reason(caught.value) == os.strerror(errno.EADDRINUSE)


@pytest.mark.parametrize(
    ('error', 'text'),
    [
        (ConnectionRefusedError(errno.ECONNREFUSED, 'Connect call failed'), 'Connection refused'),
        (
            socket.gaierror(socket.EAI_NONAME, 'Name or service not known'),
            'Name or service not known',
        ),
        (OSError('Multiple exceptions: …'), 'Multiple exceptions: …'),
        (OverflowError('bind(): port must be 0-65535.'), 'bind(): port must be 0-65535.'),
        (TimeoutError(), ''),
    ],
)
def test_reasons(error: Exception, text: str) -> None:
    assert reason(error) == text


def test_a_host_that_cannot_be_found_is_told_without_a_number() -> None:
    with pytest.raises(ConnectionError) as caught:
        run(execute('no such host', 5000, [], PATIENCE))
    text = str(caught.value)
    assert text.startswith('no such host:5000: ')
    assert 'Errno' not in text
